"""FSK on points whose depth is known, without noise and with it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaPairs, qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.methods.depth_uncertainty import fsk_with_uncertainty
from handbench.radar.methods.fsk import Fsk, depth_step_m, fsk
from handbench.radar.methods.pixels import masked_mean
from handbench.radar.methods.registry import PAIR_HZ
from handbench.radar.simulation.effects.sensor import strongest_amplitude, thermal_noise
from handbench.support.errors import HandbenchError
from tests.radar.direct_sums import direct_sum
from tests.radar.simulated_points import (
    TONES_HZ,
    around,
    bumpy,
    exact_capture,
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
    config = Fsk(off_axis=True, filter_px=1, corrections=5)
    depth = fsk_with_uncertainty(point_capture(point_m), config)
    assert abs(strongest_z_m(depth) - point_m[2]) < 1e-4


def test_sign_and_scale_of_the_depth_step():
    # z_e = z + 1 mm: φ = 4πΔf·1 mm/c, so that Δz = −1 mm.
    phase = 4 * np.pi * 200e6 * 1e-3 / SPEED_OF_LIGHT_M_S
    step = depth_step_m(np.array([np.exp(1j * phase)]), np.array([1.0 + 0j]), 200e6)
    assert step[0] == pytest.approx(-1e-3, rel=1e-12)


def test_two_tone_precision_follows_the_phase_noise():
    # σ_z = c/(4πΔf)·σ_φ: 0.030 rad at 200 MHz are 3.58 mm. 60 draws give the deviation to ±9 %
    # (1σ): 30 % is 3σ.
    point_m = (0.0, 0.0, 0.29)
    clean = point_capture(point_m).samples[0]
    strongest = strongest_amplitude(clean[0], TONES_HZ[0], qar50(), np.array([point_m]))
    pixel = around(point_m, half_m=0.0)
    config = Fsk(tones_hz=PAIR_HZ, **pixel, first_depth_m=0.29)  # in focus from the start
    depths = []
    for repeat in range(60):
        samples = thermal_noise(clean, TONES_HZ, 0.030, strongest, (1, repeat))
        depths.append(
            fsk_with_uncertainty(RadarCapture(samples[None], TONES_HZ, qar50()), config).z_m[0, 0]
        )
    expected = SPEED_OF_LIGHT_M_S / (4 * np.pi * 200e6) * 0.030
    assert np.std(depths, ddof=1) == pytest.approx(expected, rel=0.3)
    assert np.mean(depths) == pytest.approx(0.29, abs=4 * expected / np.sqrt(60))


def test_3fsk_is_the_papers_iteration_written_out():
    capture = points_capture(surface_points(bumpy, 0.015, 0.001), phase_noise_rad=0.0264)
    config = Fsk(**around((0, 0)), filter_px=3)
    coarse = fsk_with_uncertainty(capture, Fsk(tones_hz=PAIR_HZ, filter_px=1, **around((0, 0))))
    on_target = np.isfinite(coarse.z_m)
    z_m = masked_mean(coarse.z_m, 3)
    x, y = np.meshgrid(coarse.x_m, coarse.y_m)
    points = np.stack([x, y, z_m], axis=-1)[on_target]
    o1, o2, o3 = direct_sum(capture.samples[0], TONES_HZ, qar50(), points, apart=True)
    f1, f2, f3 = TONES_HZ
    from_f1 = -SPEED_OF_LIGHT_M_S * np.angle(o1 * np.conj(o3)) / (4 * np.pi * (f1 - f3))
    from_f2 = -SPEED_OF_LIGHT_M_S * np.angle(o2 * np.conj(o3)) / (4 * np.pi * (f2 - f3))
    expected = z_m[on_target] + (from_f1 + from_f2) / 2
    # Imaging in float32 is worth a relative 3e-6 of the strongest pixel, 1e-5 at the threshold: 0.5
    # µm.
    depth, (_, step) = fsk(capture, config)
    assert np.allclose(step.z_m[on_target], expected, rtol=0, atol=5e-7)
    assert np.array_equal(depth.z_m, masked_mean(step.z_m, 3), equal_nan=True)


def test_tones_that_were_not_measured_are_refused():
    with pytest.raises(HandbenchError, match=r"79\.5000 GHz"):
        fsk_with_uncertainty(point_capture((0, 0, 0.29), TONES_HZ[:2]), Fsk())


@pytest.mark.parametrize("first_depth_m", [0.1, 0.45, 0.6, 0.7, 0.9])
def test_a_depth_one_period_off_is_flagged(first_depth_m):
    # c/(2·200 MHz) = 750 mm: from ± 375 mm on z_e settles on the next period.
    config = Fsk(tones_hz=PAIR_HZ, filter_px=1, **around((0, 0)), first_depth_m=first_depth_m)
    depth = fsk_with_uncertainty(point_capture((0.0, 0.0, 0.28)), config)
    periods = (strongest_z_m(depth) - 0.28) / 0.749481
    assert periods == pytest.approx(1 if first_depth_m > 0.655 else 0, abs=0.01)
    assert (depth.wrapped == (np.isfinite(depth.z_m) & (periods > 0.5))).all()


def test_an_aperture_without_width_has_no_focus_to_tell_by():
    capture = exact_capture(
        (0.0, 0.0, 0.28), array=AntennaPairs(np.zeros((1, 3)), np.zeros((1, 3)))
    )
    config = Fsk(tones_hz=PAIR_HZ, filter_px=1, **around((0, 0)))
    assert not fsk_with_uncertainty(capture, config).wrapped.any()
