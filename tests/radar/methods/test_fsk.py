"""FSK on points whose depth is known, without noise and with it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray, AntennaPairs, qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.methods.depth_uncertainty import fsk_with_uncertainty
from handbench.radar.methods.fsk import Fsk, fsk
from handbench.radar.methods.pixels import masked_mean
from handbench.radar.methods.registry import LADDER_HZ, PAIR_HZ
from handbench.radar.simulation.effects.sensor import strongest_amplitude, thermal_noise
from tests.radar.direct_sums import direct_echoes, direct_sum
from tests.radar.simulated_points import (
    TONES_HZ,
    around,
    bumpy,
    depth_by,
    error_m,
    exact_capture,
    point_capture,
    points_capture,
    strongest_z_m,
    surface_points,
)
from tests.strategies import examples

C = SPEED_OF_LIGHT_M_S
MM = st.integers(-150, 150).map(lambda mm: mm / 1000)
NEAR_AXIS = st.integers(-50, 50).map(lambda mm: mm / 1000)


@examples(8)
@given(point_m=st.tuples(MM, MM, st.floats(0.245, 0.325)))
def test_3fsk_with_the_off_axis_term_finds_a_point_anywhere_within_a_tenth_of_a_millimetre(point_m):
    config = Fsk(**around(point_m), off_axis=True, filter_px=1, corrections=5)
    depth = fsk_with_uncertainty(point_capture(point_m), config)
    assert abs(strongest_z_m(depth) - point_m[2]) < 1e-4


@examples(5)
@given(point_m=st.tuples(NEAR_AXIS, NEAR_AXIS, st.floats(0.26, 0.31)))
def test_the_ladder_finds_a_point_near_the_axis_within_five_micrometres(point_m):
    """Off the axis the factor 2 leaves a few per cent of each correction, and the next rung a few
    per cent of that: 1.6 µm (measured). A filter over the point's own neighbours would be worth 30
    µm."""
    pixels = around(point_m, half_m=0.006)
    config = Fsk(tones_hz=LADDER_HZ, **pixels, first_depth_m=0.3, filter_px=1)
    depth = fsk_with_uncertainty(point_capture(point_m, LADDER_HZ), config)
    assert abs(strongest_z_m(depth) - point_m[2]) < 5e-6
    assert not depth.wrapped.any()


def test_two_tone_precision_follows_the_phase_noise():
    """σ_z = c/(4πΔf)·σ_φ: 0.030 rad at 200 MHz are 3.58 mm. 60 draws give the deviation to ±9 %
    (1σ): 30 % is 3σ."""
    point_m = (0.0, 0.0, 0.29)
    clean = point_capture(point_m).samples[0]
    strongest = strongest_amplitude(clean[0], TONES_HZ[0], qar50(), np.array([point_m]))
    # in focus from the start
    config = Fsk(tones_hz=PAIR_HZ, **around(point_m, half_m=0.0), first_depth_m=0.29)
    noisy = (thermal_noise(clean, TONES_HZ, 0.030, strongest, (1, repeat)) for repeat in range(60))
    captures = (RadarCapture(samples[None], TONES_HZ, qar50()) for samples in noisy)
    depths_m = [fsk(capture, config)[0].z_m[0, 0] for capture in captures]
    expected_m = C / (4 * np.pi * 200e6) * 0.030
    assert np.std(depths_m, ddof=1) == pytest.approx(expected_m, rel=0.3)
    assert np.mean(depths_m) == pytest.approx(0.29, abs=4 * expected_m / np.sqrt(60))


# Two points, both out of focus at 0.45 m: their common peak leads between them, and the next one to
# the stronger.
POINTS_M, WEIGHTS = np.array([[-0.01, 0.0, 0.34], [0.012, 0.0, 0.26]]), np.array([1.0, 1.4])
FEW = AntennaArray(qar50().tx_m[::8], qar50().rx_m[::8])
PIXELS = around((0.0, 0.0), half_m=0.02, step_m=0.002)


def two_fsk(corrections):
    """The paper's 2-FSK in float64 sums: the planes z_e, and the depths [ny, nx] of the last one,
    NaN below the threshold."""
    planes_m, samples = [0.45], direct_echoes(POINTS_M, WEIGHTS, TONES_HZ[:2], FEW)
    x, y = np.meshgrid(*(PIXELS[axis].values_m() for axis in "xy"))
    while True:
        points_m = np.stack([x, y, np.full(x.shape, planes_m[-1])], axis=-1).reshape(-1, 3)
        images = direct_sum(samples, TONES_HZ[:2], FEW, points_m, apart=True)
        amplitude = np.abs(images).mean(axis=0)
        step_m = -C / (4 * np.pi * 0.2e9) * np.angle(images[0] * np.conj(images[1]))
        if len(planes_m) > corrections:
            seen = 20 * np.log10(amplitude / amplitude.max()) >= -10.0
            return planes_m, np.where(seen, planes_m[-1] + step_m, np.nan).reshape(x.shape)
        planes_m.append(planes_m[-1] + step_m[amplitude.argmax()])


@pytest.mark.parametrize("corrections", [1, 3])
def test_2fsk_corrects_the_plane_as_often_as_configured(corrections):
    """The paper's once. Imaging in float32 is worth 1e-5 rad at the threshold, and 119 mm is a
    radian."""
    capture = exact_capture(POINTS_M, TONES_HZ, WEIGHTS, FEW)
    values = {} if corrections == 1 else {"corrections": corrections}
    z_m = depth_by("2fsk", capture, PIXELS, **values).z_m
    planes_m, expected_m = two_fsk(corrections)
    np.testing.assert_allclose(z_m, expected_m, rtol=0, atol=5e-6)
    assert planes_m[1] == pytest.approx(POINTS_M[:, 2].mean(), abs=0.01)
    assert corrections == 1 or planes_m[2] == pytest.approx(POINTS_M[1, 2], abs=0.001)


@pytest.mark.parametrize("refinements", [1, 2])
def test_3fsk_is_the_papers_iteration_written_out(refinements):
    capture = points_capture(surface_points(bumpy, 0.015, 0.001), phase_noise_rad=0.0264)
    pair = Fsk(tones_hz=PAIR_HZ, filter_px=1, **around((0, 0)))
    coarse = fsk_with_uncertainty(capture, pair)
    on_target = np.isfinite(coarse.z_m)
    x, y = (axis[on_target] for axis in np.meshgrid(coarse.x_m, coarse.y_m))
    z_m = masked_mean(coarse.z_m, 3)[on_target]
    f1, f2, f3 = TONES_HZ
    for _ in range(refinements):
        points_m = np.stack([x, y, z_m], axis=-1)
        o1, o2, o3 = direct_sum(capture.samples[0], TONES_HZ, qar50(), points_m, apart=True)
        from_f1 = -C * np.angle(o1 * np.conj(o3)) / (4 * np.pi * (f1 - f3))
        from_f2 = -C * np.angle(o2 * np.conj(o3)) / (4 * np.pi * (f2 - f3))
        z_m = z_m + (from_f1 + from_f2) / 2
    config = Fsk(**around((0, 0)), filter_px=3, refinements=refinements)
    depth, (_, *steps) = fsk(capture, config)
    # Imaging in float32 is worth a relative 3e-6 of the strongest pixel, 1e-5 at the threshold: 0.5
    # µm a step.
    np.testing.assert_allclose(steps[-1].z_m, z_m, rtol=0, atol=5e-7 * refinements)
    np.testing.assert_array_equal(depth.z_m, masked_mean(steps[-1].pixels.on_map(steps[-1].z_m), 3))


@pytest.mark.parametrize("first_depth_m", [0.1, 0.45, 0.6, 0.7, 0.9])
def test_a_depth_one_period_off_is_flagged(first_depth_m):
    # c/(2·200 MHz) = 750 mm: from ± 375 mm on z_e settles on the next period.
    config = Fsk(tones_hz=PAIR_HZ, filter_px=1, **around((0, 0)), first_depth_m=first_depth_m)
    depth = fsk_with_uncertainty(point_capture((0.0, 0.0, 0.28)), config)
    periods = (strongest_z_m(depth) - 0.28) / 0.749481
    assert periods == pytest.approx(1 if first_depth_m > 0.655 else 0, abs=0.01)
    assert (depth.wrapped == (np.isfinite(depth.z_m) & (periods > 0.5))).all()


def test_an_aperture_without_width_has_no_focus_to_tell_by():
    nowhere = AntennaPairs(np.zeros((1, 3)), np.zeros((1, 3)))
    config = Fsk(tones_hz=PAIR_HZ, filter_px=1, **around((0, 0)))
    assert not fsk_with_uncertainty(
        exact_capture((0, 0, 0.28), array=nowhere), config
    ).wrapped.any()


def stepped(x, y):
    """Two planes 90 mm apart: a filter across their edge is off by up to 45 mm, beyond the third
    tone's ±30 mm."""
    return np.where(x < 5e-4, 0.26, 0.35)


def test_dropped_pixels_do_not_reach_their_neighbours():
    edge = points_capture(surface_points(stepped, half_m=0.024, pitch_m=0.006))
    pixels = around((0, 0), half_m=0.024)
    kept, dropped = (
        fsk_with_uncertainty(edge, Fsk(**pixels, filter_px=11, drop_doubtful=drop))
        for drop in (False, True)
    )
    np.testing.assert_array_equal(dropped.wrapped, kept.wrapped)
    on_target = np.isfinite(kept.z_m) & ~kept.wrapped
    np.testing.assert_array_equal(np.isfinite(dropped.z_m), on_target)
    kept_m, dropped_m = (np.nanmax(np.abs(error_m(map_, stepped))) for map_ in (kept, dropped))
    assert dropped_m < 0.5 * kept_m


def test_a_smooth_surface_raises_few_false_alarms():
    """At the paper's noise, without the last filter: 2.8 % over four draws (measured), 0.6 to 5.6 %
    in single ones."""
    points_m = surface_points(bumpy, half_m=0.03, pitch_m=0.000625)
    config = Fsk(**around((0, 0), half_m=0.024), filter_px=1)
    captures = (points_capture(points_m, TONES_HZ, 0.0264, seed) for seed in range(2))
    maps = [fsk_with_uncertainty(capture, config) for capture in captures]
    assert np.mean([depth.wrapped[np.isfinite(depth.z_m)].mean() for depth in maps]) < 0.06
