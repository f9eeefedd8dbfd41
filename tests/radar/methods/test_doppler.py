"""Velocities and depths of moving surfaces by a tone that is measured twice: echoes are summed here
in float64, each tone at its own time, without code of the product."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from handbench.bench.stages.image import image
from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.methods.evidence import require_evidence
from handbench.radar.methods.registry import method
from tests.radar.direct_sums import direct_echoes
from tests.radar.simulated_points import around
from tests.refusals import refuse

TONES_HZ = np.array([82e9, 81.8e9, 79.5e9, 82e9])
EVENLY_S = (0.0, 1e-3, 2e-3, 3e-3)
WIDE_M = 0.05  # half the surface's width; its border is not scored
LIMIT_M_S = SPEED_OF_LIGHT_M_S / (4 * 82e9 * EVENLY_S[-1])


def surface_m(x_m, y_m):
    return 0.31 + 0.0015 * np.sin(2 * np.pi * x_m / 0.06) * np.cos(2 * np.pi * y_m / 0.07)


@cache
def capture(motion="tips", speed_m_s=0.1, order=(0, 1, 2, 3), times_s=EVENLY_S):
    """4 000 scatterers that tip about x, or move along z or along x, with speed_m_s at the edge,
    and noise 34 dB below them."""
    rng, times_s = np.random.default_rng(5), np.array(times_s)
    xy_m = rng.uniform(-WIDE_M, WIDE_M, (4000, 2))
    points_m = np.c_[xy_m, surface_m(*xy_m.T)]
    velocity_m_s = np.zeros_like(points_m)
    velocity_m_s[:, 0 if motion == "x" else 2] = speed_m_s
    if motion == "tips":
        velocity_m_s *= points_m[:, 1:2] / WIDE_M
    moved_m = [points_m + velocity_m_s * (time_s - times_s[0]) for time_s in times_s]
    tones = zip(moved_m, TONES_HZ, strict=True)
    samples = np.concatenate(
        [direct_echoes(at_m, np.ones(4000), [hz], qar50()) for at_m, hz in tones]
    )
    white = rng.standard_normal((*samples.shape, 2)) @ [1, 1j] * np.sqrt(0.5)
    samples += 0.02 * np.sqrt((np.abs(samples) ** 2).mean()) * white
    kept = list(order)
    samples = samples[None, kept].astype(np.complex64)
    return RadarCapture(samples, TONES_HZ[kept], qar50(), times_s=times_s[kept])


def mapped(id, echoes, **settings):
    pixels = around((0, 0), half_m=0.045, step_m=0.0015)
    return image(echoes, method(id), method(id).configure(pixels | settings, id))


def errors(depth, speed_m_s=0.1, motion="tips"):
    """Errors of depth and of velocity, and true radial velocities, of the pixels on target."""
    x_m, y_m = np.meshgrid(depth.x_m, depth.y_m)
    z_m, on = surface_m(x_m, y_m), np.isfinite(depth.z_m)
    along_m = {"tips": y_m / WIDE_M * z_m, "z": z_m, "x": x_m}[motion]
    true_m_s = speed_m_s * along_m / np.sqrt(x_m**2 + y_m**2 + z_m**2)
    velocity_m_s = np.nan if depth.velocity_m_s is None else depth.velocity_m_s
    return (depth.z_m - z_m)[on], (velocity_m_s - true_m_s)[on], true_m_s[on]


def mae(values):
    return float(np.abs(values).mean())


def test_depth_is_freed_of_motion_and_velocity_is_found():
    """A script that shares no code reached 0.17 mm and 7 %; 3-FSK alone errs by about f/Δf·v·T: 48
    ms of half the edge's speed. σ is 1.15 of the noise (its tails), and the estimate adds 5 %."""
    still, moving = capture(speed_m_s=0.0), capture()
    rest_m = mae(errors(mapped("3fsk", still), 0.0)[0])
    depth = mapped("3fsk-doppler", still)
    z_m, velocity_m_s, _ = errors(depth, 0.0)
    assert mae(z_m) < 1.1 * rest_m and mae(velocity_m_s) < 2e-3
    sigma_m_s = np.nanmedian(depth.velocity_sigma_m_s)
    assert sigma_m_s == pytest.approx(1.2 * velocity_m_s.std(), rel=0.08)
    assert mae(errors(mapped("3fsk", moving))[0]) > 8 * rest_m
    depth = mapped("3fsk-doppler", moving)
    z_m, velocity_m_s, true_m_s = errors(depth)
    assert mae(z_m) < min(0.25e-3, 1.2 * rest_m)
    assert mae(velocity_m_s) < 0.1 * mae(true_m_s) and abs(velocity_m_s.mean()) < 1e-3
    assert depth.velocity_limit_m_s == pytest.approx(LIMIT_M_S)
    for values in (depth.velocity_m_s, depth.velocity_sigma_m_s):
        np.testing.assert_array_equal(np.isfinite(values), np.isfinite(depth.z_m))
    assert np.nanmean(depth.p_gross) < 0.05
    coarse_m, freed_m = (mae(errors(mapped(id, moving))[0]) for id in ("2fsk", "2fsk-doppler"))
    assert coarse_m > 15 * freed_m


@pytest.mark.parametrize(
    ("order", "times_s"),
    [
        ((2, 3, 0, 1), EVENLY_S),  # tones in any order in the file
        ((0, 1, 2, 3), (5.0, 5.0004, 5.0021, 5.003)),  # of a clock, unequally spaced
    ],
    ids=("order", "unequal"),
)
def test_any_order_and_spacing_of_tones(order, times_s):
    moving = capture(order=order, times_s=times_s)
    z_m, velocity_m_s, true_m_s = errors(mapped("3fsk-doppler", moving))
    assert mae(z_m) < 0.5e-3 and mae(velocity_m_s) < 0.12 * mae(true_m_s)


def test_a_ladder_frees_every_rung():
    depth = mapped("nfsk-doppler", capture(), tones_hz=TONES_HZ[:3].tolist())
    z_m, velocity_m_s, true_m_s = errors(depth)
    assert mae(z_m) < 0.25e-3 and mae(velocity_m_s) < 0.1 * mae(true_m_s)


@pytest.mark.parametrize("share", (-0.9, 0.9, 1.2))
def test_velocities_repeat_beyond_their_limit(share):
    depth = mapped("3fsk-doppler", capture("z", share * LIMIT_M_S))
    seen = share if abs(share) < 1 else share - 2
    assert np.nanmedian(depth.velocity_m_s) == pytest.approx(seen * LIMIT_M_S, rel=0.05)
    assert abs(share) > 1 or np.median(np.abs(errors(depth)[0])) < 0.3e-3


def test_lateral_motion_has_a_radial_part_off_the_axis_alone():
    _, velocity_m_s, _ = errors(mapped("3fsk-doppler", capture("x")), motion="x")
    assert mae(velocity_m_s) < 0.01  # speckle of the moving scatterers: a tenth of their speed


@pytest.mark.parametrize(
    ("changed", "place"),
    [
        ({"times_s": None}, "times_s"),
        ({"times_s": np.zeros(4)}, "82, 81.8, 79.5 GHz"),
        ({"frequencies_hz": np.array([82e9, 81.8e9, 79.5e9, 81e9])}, "82, 81.8, 79.5 GHz"),
        ({"samples": capture().samples * [[[1]], [[1]], [[1]], [[0]]]}, "82 GHz"),
    ],
)
def test_a_capture_without_velocities_is_refused(changed, place):
    config = method("3fsk-doppler").configure({}, "3fsk-doppler")
    refuse(lambda: require_evidence(replace(capture(), **changed), config), place)
