"""Joint depth: a scatterer in closed form, odds of the second maximum by Monte Carlo, a map beside
an outline."""

import numpy as np
import pytest

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.imaging.cpu.steering import phasor
from handbench.radar.methods.alignment import align, beside_nearer
from handbench.radar.methods.registry import method
from handbench.support.errors import HandbenchError

TONES_HZ = np.array([82.0e9, 81.8e9, 80.5e9, 77.0e9, 72.0e9])


def point_capture(at_m, tones_hz=TONES_HZ):
    """A scatterer's echoes, a float64 sum that shares no code with the simulator."""
    array = qar50()
    tx_m, rx_m = (
        np.linalg.norm(np.array(at_m) - antennas_m, axis=1)
        for antennas_m in (array.tx_m, array.rx_m)
    )
    samples = np.stack([phasor(tx_m[:, None] + rx_m, f, -1) for f in tones_hz])
    return RadarCapture(samples[None].astype(np.complex64), np.asarray(tones_hz), array)


def around(at_m, **more):
    """A configuration of the pixels within 6 mm of a point."""
    axes = {
        name: {"start_m": at - 0.006, "stop_m": at + 0.006, "step_m": 0.001}
        for name, at in zip("xy", at_m[:2], strict=True)
    }
    return axes | {"tolerance": 1e-4} | more


PLACES_M = [
    (0.0, 0.0, 0.3),
    (0.011, -0.007, 0.2874),
    (0.1, -0.08, 0.26),
    (-0.12, 0.1, 0.31),
    (0.14, 0.14, 0.28),
]


@pytest.mark.parametrize("at_m", PLACES_M)
def test_a_scatterer_is_found_anywhere_in_the_volume(at_m):
    """To 0.02 mm in its own pixel, up to the corners of the image, and without doubt. Unfiltered: a
    lobe off the axis is tilted, and its outline in the first plane is not even. First plane: the
    point stays in so small an image."""
    chosen = method("joint")
    config = chosen.configure(around(at_m, first_depth_m=0.3, fine_filter_px=1), "test")
    depth = chosen.run(point_capture(at_m), config, 0).depth
    assert depth.z_m[6, 6] == pytest.approx(at_m[2], abs=2e-5)
    assert not depth.wrapped[6, 6] and depth.sigma_m[6, 6] < 2e-5


@pytest.mark.parametrize("at_m", PLACES_M)
def test_aligned_broadband_finds_it_too(at_m):
    chosen = method("broadband-aligned")
    capture = point_capture(at_m, np.linspace(72e9, 82e9, 16))
    depth = chosen.run(capture, chosen.configure(around(at_m, count=16), "test"), 0).depth
    assert depth.z_m[6, 6] == pytest.approx(at_m[2], abs=2e-5) and not depth.wrapped[6, 6]


def noisy(offs_m, sigma, seed, tones_hz=TONES_HZ):
    """Images [f, n] of unit scatterers with white noise of that rms."""
    draws = np.random.default_rng(seed)
    noise = (
        sigma
        / 2**0.5
        * (draws.standard_normal((2, len(tones_hz), len(offs_m))) * [[[1.0]], [[1j]]]).sum(axis=0)
    )
    return np.exp(-4j * np.pi * tones_hz[:, None] / SPEED_OF_LIGHT_M_S * offs_m) + noise


def test_uneven_tones_reach_the_cramer_rao_bound():
    """At 0.1 rad, within ±30 mm: within 1.05 of the bound, none a period off."""
    offs_m = np.random.default_rng(0).uniform(-0.02, 0.02, 3000)
    found = align(noisy(offs_m, 0.1, 1), TONES_HZ, np.full(3000, 2.0), 0.03)
    k = 4 * np.pi * TONES_HZ / SPEED_OF_LIGHT_M_S
    bound_m = 0.1 / 2**0.5 / np.sqrt(((k - k.mean()) ** 2).sum())
    assert (found.shift_m - offs_m).std() == pytest.approx(bound_m, rel=0.05)


def test_the_second_maximum_is_as_likely_as_it_says():
    """At noise that puts some a period off: of pixels told more than 10 % likely wrong most wrong
    ones are among, and below 1 % hardly any is."""
    offs_m = np.random.default_rng(2).uniform(-0.02, 0.02, 6000)
    found = align(noisy(offs_m, 0.5, 3), TONES_HZ, np.full(6000, 2.0), 0.03)
    wrong = np.abs(found.shift_m - offs_m) > 0.005
    assert wrong.mean() > 0.01
    assert wrong[found.other > 0.1].sum() > 0.7 * wrong.sum()
    assert wrong[found.other < 0.01].mean() < 0.01


def test_what_lies_behind_an_outline_is_told():
    """A step of 30 mm: the far pixels within the reach of the near ones, no others, and none across
    a small step."""
    z_m = np.full((5, 20), 0.26)
    z_m[:, 10:] = 0.29
    z_m[0, 0] = np.nan
    hidden = beside_nearer(z_m, (2, 3), 0.0075)
    assert hidden[:, 10:13].all() and not hidden[:, :10].any() and not hidden[:, 13:].any()
    assert not beside_nearer(np.where(z_m > 0.28, 0.265, z_m), (2, 3), 0.0075).any()


def test_equal_tones_and_too_few_are_refused():
    for tones in ([82e9, 81e9], [82e9, 81e9, 81e9]):
        with pytest.raises(HandbenchError, match="three different tones"):
            method("joint").configure({"tones_hz": tones}, "config")
