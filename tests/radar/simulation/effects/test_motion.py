"""Motion between tones: its depth error has the sign and the size of theory, and the displaced
echoes are right."""

import numpy as np
import pytest

from handbench.radar.simulation.causes import Motion
from handbench.radar.simulation.movement import displacement_m
from tests.radar.simulation.effects.small_scenes import (
    NEAR_SIDE_M,
    TONES_HZ,
    bead_scene,
    depth_shift_m,
    simulated,
)


@pytest.mark.parametrize(("low", "high"), [(0, 2), (1, 2)])
@pytest.mark.parametrize("velocity_m_s", [2.2e-3, -4e-3])
def test_velocity_moves_the_depth_by_f_over_delta_f_times_v_t(low, high, velocity_m_s):
    scene = bead_scene({"motion": {"velocity_m_s": velocity_m_s}})
    error_m = depth_shift_m(simulated(scene).capture, simulated(scene, "motion").capture, low, high)
    tones_hz, time_s = TONES_HZ[[low, high]], scene.time_s[[low, high]]
    # z + (f_b δ_b − f_a δ_a)/(f_b − f_a): away from the radar counts as further; an antenna sees
    # cos θ of the velocity.
    moved = velocity_m_s * (tones_hz @ (time_s * [-1, 1])) / np.ptp(tones_hz)
    antennas_m = np.concatenate([scene.array.tx_m, scene.array.rx_m])
    cosine = 0.296 / np.linalg.norm(NEAR_SIDE_M - antennas_m, axis=1)
    assert error_m / moved == pytest.approx(cosine.mean(), abs=2e-3)


def test_tremor_starts_where_the_target_is_and_swings_by_its_amplitude():
    time_s = np.linspace(0, 1, 10_001)
    offset_m = displacement_m(Motion(amplitude_m=5e-5, frequency_hz=9.0), time_s, 0.3)
    assert offset_m[0] == 0
    assert np.ptp(offset_m) == pytest.approx(1e-4, rel=1e-4)
    assert np.count_nonzero(np.diff(np.sign(offset_m - offset_m.mean()))) == pytest.approx(
        18, abs=1
    )


def test_frames_have_their_own_tremor():
    scene = bead_scene({"motion": {"amplitude_m": 1e-4}}, time_s=(0.0, 0.03, 0.05))
    first, second = simulated(scene, "motion", frames=2).capture.samples
    assert np.array_equal(first, simulated(scene, "motion", frames=1).capture.samples[0])
    assert np.linalg.norm(first[0] - second[0]) < 1e-6 * np.linalg.norm(
        first[0]
    )  # nothing has moved at the first tone
    assert np.linalg.norm(first[2] - second[2]) > 1e-2 * np.linalg.norm(first[2])
