"""A target that moves in any way: every tone sees the surface at its own time."""

from dataclasses import replace

import numpy as np
import pytest

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray, qar50
from handbench.radar.simulation.effects.motion import (
    displacement_m,
    frame_starts,
    surface_m,
    velocity_m_s,
)
from handbench.radar.simulation.scene import Body, EchoScene, Motion
from handbench.radar.simulation.scene_echoes import bare_echoes
from tests.radar.simulation.effects import small_scenes
from tests.radar.simulation.effects.plates import joined, plate, sheet, sphere_body
from tests.refusals import refuse

FEW = AntennaArray(qar50().tx_m[::8], qar50().rx_m[::8])
TONES_HZ = np.array([82e9, 81.8e9, 79.5e9, 82e9])
RELIEF_M, WAVES_PER_M = 1.5e-3, 2 * np.pi / 0.03  # of a wavy surface
BEAD = sphere_body(8e-3, (0.0, 0.0, 0.3))


def moving(target: Body, motion=(), times_s=(0.0, 1e-3, 2e-3, 3e-3), **given) -> EchoScene:
    """A body before a thin array, with keys of [target.motion] and of the scene."""
    scene = EchoScene(FEW, TONES_HZ, np.array(times_s), target, origin_m=np.array([0, 0, 0.3]))
    return replace(scene, motion=Motion.model_validate(dict(motion)), **given)


def simulated(scene: EchoScene, *effects: str, frames=1):
    """Samples [frame, f, t, r] of the scene with these effects."""
    return small_scenes.simulated(scene, *effects, frames=frames).capture.samples


def difference(found: np.ndarray, expected: np.ndarray) -> float:
    """The largest relative L2 difference of a tone."""
    off = np.linalg.norm(found - expected, axis=(-2, -1))
    return float((off / np.linalg.norm(expected, axis=(-2, -1))).max())


def turn_about_x(angle_rad: float) -> np.ndarray:
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


def wave(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return RELIEF_M * np.sin(WAVES_PER_M * x) * np.cos(WAVES_PER_M * y)


def wavy_normals(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Normals of z = wave(x, y) towards −z."""
    (sx, cx), (sy, cy) = ((np.sin(a), np.cos(a)) for a in (WAVES_PER_M * x, WAVES_PER_M * y))
    slope = RELIEF_M * WAVES_PER_M
    normal = np.stack([slope * cx * cy, -slope * sx * sy, -np.ones_like(x)], axis=-1)
    return normal / np.linalg.norm(normal, axis=-1, keepdims=True)


@pytest.mark.parametrize("oblique", [False, True])
def test_a_tipping_surface_against_a_sum_over_its_points(oblique):
    """At each tone's time, the sum over the triangles' centres with exact distances, written down
    here. The fast summation errs by 1e-5, and the smooth normals of a mesh of 0.6 mm by 2e-3."""
    body, rate_rad_s, pivot_m = sheet(0.03, 6e-4, 0.3, wave), np.radians(100.0), [0, 0.01, 0.302]
    motion = {"rotation_deg_s": [100.0, 0, 0], "pivot_m": [0, 0.01, 0.002]}
    scene = moving(body, motion, 5e-3 * np.arange(4))
    samples = simulated(scene, *(["obliquity"] if oblique else []), "motion")[0]
    flat_m = body.vertices_m[body.faces].mean(axis=1)
    for tone, (frequency_hz, time_s) in enumerate(zip(TONES_HZ, scene.time_s, strict=True)):
        turn = turn_about_x(rate_rad_s * time_s)
        corners_m = (body.vertices_m - pivot_m) @ turn.T + pivot_m
        a, b, c = corners_m[body.faces].swapaxes(0, 1)
        normal, weight = wavy_normals(*flat_m[:, :2].T) @ turn.T, np.cross(b - a, c - a) / 2
        waves = []
        for antennas_m in (FEW.tx_m, FEW.rx_m):
            leg_m = (a + b + c) / 3 - antennas_m[:, None]
            range_m = np.linalg.norm(leg_m, axis=2)
            cosine = -np.einsum("api,pi->ap", leg_m, normal) / range_m if oblique else 1
            phase_rad = 2 * np.pi * frequency_hz / SPEED_OF_LIGHT_M_S * range_m
            waves.append(np.sqrt(np.maximum(cosine, 0)) / range_m * np.exp(-1j * phase_rad))
        expected = waves[0] * np.linalg.norm(weight, axis=1) @ waves[1].T
        assert difference(samples[tone], expected) < (2e-3 if oblique else 5e-5)


def test_a_surface_that_has_moved_far_is_seen_as_a_new_one():
    """A bead before a plate: after 5 mm, it hides another part of it. Until 2 mm, shadows stay on
    their faces, and the part of the plate that they falsely hide is a tenth of the echo."""
    finger = sphere_body(4e-3, (0.0, 0.0, 0.27), 3)
    still = joined(finger, plate((-0.02, -0.02, 0.3), (0.0, 0.04, 0.0), (0.04, 0.0, 0.0), 20))
    part = np.arange(len(still.vertices_m))[:, None] < len(finger.vertices_m)

    def bent(time_s: float) -> np.ndarray:
        return still.vertices_m + part * [1.0 * time_s, 0, 0]

    scene = moving(still, times_s=[0.0, 1e-3, 5e-3, 6e-3], bent=bent)
    samples = simulated(scene, "obliquity", "shadow", "motion")[0]
    for tone, near in ((0, 1e-5), (1, 0.1), (2, 1e-5), (3, 0.1)):
        there = Body(bent(scene.time_s[tone]), still.faces)
        expected = simulated(moving(there), "obliquity", "shadow")[0, tone]
        assert difference(samples[tone], expected) < near


def test_frames_follow_each_other_only_with_a_period():
    velocity = [0.0, 0.5, 0.0]
    motion = {"velocity_m_s": 0.5, "direction": velocity, "amplitude_m": 1e-4}
    scene = moving(BEAD, motion)
    first, second = simulated(scene, "motion", frames=2)
    np.testing.assert_array_equal(first, simulated(scene, "motion")[0])
    # nothing has moved at the first tone; each frame has its own tremor
    assert difference(second[:1], first[:1]) < 1e-6 and difference(second[3:], first[3:]) > 1e-4
    running = replace(scene, frame_period_s=0.01)
    capture = small_scenes.simulated(running, "motion", frames=3).capture
    assert capture.times_s.tolist() == scene.time_s.tolist()
    assert capture.frame_times_s == pytest.approx([0, 0.01, 0.02])
    for frame, start in enumerate(frame_starts(running, 3)):
        there = Body(surface_m(running, BEAD.vertices_m, *start), BEAD.faces)
        expected = bare_echoes(moving(there)).samples()[0]
        assert difference(capture.samples[frame, 0], expected) < 3e-5
    # one tremor goes on: it is back where it was after its period
    starts = frame_starts(replace(running, frame_period_s=1 / 9.0), 2)
    before_m, after_m = (surface_m(running, BEAD.vertices_m, *start) for start in starts)
    np.testing.assert_allclose(after_m, before_m + np.array(velocity) / 9, atol=1e-12)


def test_tremor_starts_where_the_target_is_and_swings_by_its_amplitude():
    time_s = np.linspace(0, 1, 10_001)
    offset_m = displacement_m(Motion(amplitude_m=5e-5, frequency_hz=9.0), time_s, 0.3)
    assert offset_m[0] == 0 and np.ptp(offset_m) == pytest.approx(1e-4, rel=1e-4)
    swings = np.count_nonzero(np.diff(np.sign(offset_m - offset_m.mean())))
    assert swings == pytest.approx(18, abs=1)


def test_a_rigid_body_turns_about_its_pivot_and_has_the_velocities_of_one():
    motion = {"rotation_deg_s": [30.0, 0, 0], "pivot_m": [0.01, 0.02, 0.0], "velocity_m_s": 0.1}
    scene, at = moving(BEAD, motion | {"amplitude_m": 0}), (0.2, 0.4)
    pivot_m, along = np.array([0.01, 0.02, 0.3]), np.array([0, 0, 1.0])
    turned_m = (BEAD.vertices_m - pivot_m) @ turn_about_x(np.radians(6.0)).T
    there_m = surface_m(scene, BEAD.vertices_m, *at)
    np.testing.assert_allclose(there_m, turned_m + pivot_m + 0.02 * along, atol=1e-15)
    expected = np.cross([np.radians(30.0), 0, 0], turned_m) + 0.1 * along
    np.testing.assert_allclose(velocity_m_s(scene, BEAD.vertices_m, *at), expected, atol=1e-9)
    np.testing.assert_array_equal(surface_m(scene, BEAD.vertices_m, 0.0, 0.4), BEAD.vertices_m)


def test_a_target_that_flies_through_the_array_is_refused():
    scene = moving(BEAD, {"velocity_m_s": -100.0}, frame_period_s=1.0)
    refuse(lambda: simulated(scene, "motion"), "target.motion", "0.003 s")
