"""FSK on points whose depth is known, without noise and with it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, PlanarScan, qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.methods.depth_uncertainty import fsk_with_uncertainty
from handbench.radar.methods.fsk import depth_step_m, masked_mean
from handbench.radar.methods.fsk_config import SETTLING, ThreeToneConfig, TwoToneConfig
from handbench.radar.simulation.effects.sensor import strongest_amplitude, thermal_noise
from handbench.support.errors import HandbenchError
from tests.radar.direct_echoes import direct_echoes
from tests.radar.direct_sums import direct_sum
from tests.radar.simulated_points import (
    TONES_HZ,
    around,
    bumpy,
    point_capture,
    points_capture,
    strongest_z_m,
    surface_points,
)
from tests.strategies import examples


def anywhere(edge_m=0.15):
    lateral = st.integers(-round(1000 * edge_m), round(1000 * edge_m)).map(lambda mm: mm / 1000)
    return st.tuples(lateral, lateral, st.floats(0.245, 0.325))


@examples(8)
@given(point_m=anywhere())
def test_3fsk_with_the_off_axis_term_finds_a_point_anywhere_within_a_tenth_of_a_millimetre(point_m):
    config = ThreeToneConfig(off_axis=True, fine_filter_px=1, corrections=SETTLING)
    depth = fsk_with_uncertainty(point_capture(point_m), config)
    assert abs(strongest_z_m(depth) - point_m[2]) < 1e-4


@examples(8)
@given(point_m=anywhere(edge_m=0.05).filter(lambda point_m: np.hypot(*point_m[:2]) <= 0.05))
def test_3fsk_as_in_the_paper_finds_a_point_near_the_axis(point_m):
    """Within a tenth of a millimetre, which the filters leave, and what the paper's factor 2 leaves
    off the axis: of each of its three corrections s − 1, s being 2 over the path's true derivative.
    The first is of 0.45 m − z. Further off the filters leave more: 0.5 mm at (50, 50, 245) mm."""
    depth = fsk_with_uncertainty(point_capture(point_m), ThreeToneConfig())
    rise = [
        np.mean(point_m[2] / np.linalg.norm(leg_m - point_m, axis=1))
        for leg_m in (qar50().tx_m, qar50().rx_m)
    ]
    left_m = (2 / sum(rise) - 1) ** 3 * (0.45 - point_m[2])
    assert abs(strongest_z_m(depth) - point_m[2]) < 1e-4 + left_m


def test_sign_and_scale_of_the_depth_step():
    # z_e = z + 1 mm: φ = 4πΔf·1 mm/c, so that Δz = −1 mm.
    phase = 4 * np.pi * 200e6 * 1e-3 / SPEED_OF_LIGHT_M_S
    step = depth_step_m(np.array([np.exp(1j * phase)]), np.array([1.0 + 0j]), 200e6)
    assert step[0] == pytest.approx(-1e-3, rel=1e-12)


@examples(30)
@given(step_mm=st.floats(-374, 374), scale=st.floats(1e-12, 1e12))
def test_depth_step_is_unambiguous_to_375_mm_and_independent_of_amplitude(step_mm, scale):
    phase = 4 * np.pi * 200e6 * 1e-3 * step_mm / SPEED_OF_LIGHT_M_S
    images = scale * np.exp(1j * np.array([0.3 + phase, 0.3]))
    step = depth_step_m(images[:1], images[1:], 200e6)[0]
    assert step == pytest.approx(-1e-3 * step_mm, abs=1e-9)


def test_two_tone_precision_follows_the_phase_noise():
    # σ_z = c/(4πΔf)·σ_φ: 0.030 rad at 200 MHz are 3.58 mm. 60 draws give the deviation to ±9 %
    # (1σ): 30 % is 3σ.
    point_m = (0.0, 0.0, 0.29)
    clean = point_capture(point_m).samples[0]
    strongest = strongest_amplitude(clean[0], TONES_HZ[0], qar50(), np.array([point_m]))
    config = TwoToneConfig(
        **around(point_m, half_m=0.0), first_depth_m=0.29
    )  # in focus from the start
    depths = []
    for repeat in range(60):
        samples = thermal_noise(clean, TONES_HZ, 0.030, strongest, (1, repeat))
        depths.append(
            fsk_with_uncertainty(RadarCapture(samples[None], TONES_HZ, qar50()), config).z_m[0, 0]
        )
    expected = SPEED_OF_LIGHT_M_S / (4 * np.pi * 200e6) * 0.030
    assert np.std(depths, ddof=1) == pytest.approx(expected, rel=0.3)
    assert np.mean(depths) == pytest.approx(0.29, abs=4 * expected / np.sqrt(60))


def test_noise_repeats_with_its_seed_and_differs_without():
    clean = np.ones((2, 94, 94), np.complex64)
    draws = [thermal_noise(clean, TONES_HZ[:2], 0.1, 1e4, (3, frame)) for frame in (0, 0, 1)]
    assert np.array_equal(draws[0], draws[1])
    assert not np.array_equal(draws[0], draws[2])
    assert not np.array_equal(draws[0][0], draws[0][1])
    assert np.array_equal(thermal_noise(clean[1:], TONES_HZ[1:2], 0.1, 1e4, (3, 0))[0], draws[0][1])
    assert (draws[0] - clean).std() == pytest.approx(
        0.1 * 1e4 / 94, rel=0.02
    )  # 17 672 draws: 0.4 % (1σ)


def test_masked_mean_ignores_what_is_off_target():
    values = np.array([[1.0, np.nan, 5.0], [1.0, 1.0, 5.0], [np.nan, np.nan, 5.0]])
    smooth = masked_mean(values, 3)
    assert smooth[0, 0] == pytest.approx(1.0)
    assert smooth[1, 1] == pytest.approx((1 + 1 + 1 + 5 + 5 + 5) / 6)
    assert np.isnan(smooth[0, 1])
    assert np.array_equal(masked_mean(values, 1), values, equal_nan=True)


@examples(30)
@given(seed=st.integers(0, 999), size=st.sampled_from([3, 5, 9]))
def test_masked_mean_weighs_pixels_and_a_weight_of_one_is_none(seed, size):
    generator = np.random.default_rng(seed)
    values = np.where(
        generator.random((12, 15)) < 0.6, generator.normal(0.3, 0.01, (12, 15)), np.nan
    )
    weight = generator.random((12, 15)) + 0.01
    half, (y, x) = size // 2, generator.permutation(np.argwhere(np.isfinite(values)))[0]
    window = np.s_[max(y - half, 0) : y + half + 1, max(x - half, 0) : x + half + 1]
    known = np.isfinite(values[window])
    expected = np.average(values[window][known], weights=weight[window][known])
    assert masked_mean(values, size, weight)[y, x] == pytest.approx(expected, rel=1e-12)
    even = masked_mean(values, size, np.full(values.shape, 7.0))
    assert np.allclose(even, masked_mean(values, size), rtol=1e-12, equal_nan=True)


@examples(30)
@given(offset=st.floats(-1e6, 1e6), size=st.integers(1, 9), seed=st.integers(0, 99))
def test_masked_mean_keeps_a_constant_whatever_its_offset(offset, size, seed):
    known = np.random.default_rng(seed).random((20, 30)) < 0.4
    values = np.where(known, offset, np.nan)
    assert np.allclose(masked_mean(values, size)[known], offset, rtol=1e-15, atol=1e-12)


def test_3fsk_is_the_papers_iteration_written_out():
    capture = points_capture(surface_points(bumpy, 0.015, 0.001), phase_noise_rad=0.0264)
    config = ThreeToneConfig(**around((0, 0)), coarse_filter_px=3, fine_filter_px=1)
    coarse = fsk_with_uncertainty(capture, TwoToneConfig(**around((0, 0))))
    on_target = np.isfinite(coarse.z_m)
    z_m = masked_mean(coarse.z_m, 3)
    x, y = np.meshgrid(coarse.x_m, coarse.y_m)
    points = np.stack([x, y, z_m], axis=-1)[on_target]
    o1, o2, o3 = (
        direct_sum(capture.samples[0, f : f + 1], TONES_HZ[f : f + 1], qar50(), points)
        for f in range(3)
    )
    f1, f2, f3 = TONES_HZ
    from_f1 = -SPEED_OF_LIGHT_M_S * np.angle(o1 * np.conj(o3)) / (4 * np.pi * (f1 - f3))
    from_f2 = -SPEED_OF_LIGHT_M_S * np.angle(o2 * np.conj(o3)) / (4 * np.pi * (f2 - f3))
    expected = z_m[on_target] + (from_f1 + from_f2) / 2
    # Imaging in float32 is worth a relative 3e-6 of the strongest pixel, 1e-5 at the threshold: 0.5
    # µm.
    assert np.allclose(
        fsk_with_uncertainty(capture, config).z_m[on_target], expected, rtol=0, atol=5e-7
    )


def test_tones_that_were_not_measured_are_refused():
    with pytest.raises(HandbenchError, match=r"79\.5000 GHz"):
        fsk_with_uncertainty(point_capture((0, 0, 0.29), TONES_HZ[:2]), ThreeToneConfig())


@pytest.mark.parametrize("first_depth_m", [0.1, 0.45, 0.6, 0.7, 0.9])
def test_a_depth_one_period_off_is_flagged(first_depth_m):
    # c/(2·200 MHz) = 750 mm: from ± 375 mm on z_e settles on the next period.
    config = TwoToneConfig(**around((0, 0)), first_depth_m=first_depth_m)
    depth = fsk_with_uncertainty(point_capture((0.0, 0.0, 0.28)), config)
    periods = (strongest_z_m(depth) - 0.28) / 0.749481
    assert periods == pytest.approx(1 if first_depth_m > 0.655 else 0, abs=0.01)
    assert (depth.wrapped == (periods > 0.5)).all()


def test_an_aperture_without_width_has_no_focus_to_tell_by():
    one = PlanarScan(np.zeros((1, 3)))
    samples = direct_echoes(np.array([[0.0, 0.0, 0.28]]), np.ones(1), TONES_HZ, one)
    depth = fsk_with_uncertainty(
        RadarCapture(samples[None].astype(np.complex64), TONES_HZ, one),
        TwoToneConfig(**around((0, 0))),
    )
    assert not depth.wrapped.any()


def test_an_empty_image_is_refused():
    capture = RadarCapture(np.zeros((1, 3, 94, 94), np.complex64), TONES_HZ, qar50())
    with pytest.raises(HandbenchError, match="zero everywhere"):
        fsk_with_uncertainty(capture, TwoToneConfig(**around((0, 0))))
