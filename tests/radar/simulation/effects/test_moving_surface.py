"""A target that moves in any way: every tone sees the surface at its own time."""

from dataclasses import replace

import numpy as np
import pytest

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray, qar50
from handbench.radar.simulation.causes import Motion
from handbench.radar.simulation.movement import frame_starts, surface_m, velocity_m_s
from handbench.radar.simulation.scene import Body, EchoScene
from handbench.radar.simulation.scene_echoes import bare_echoes
from handbench.radar.simulation.selection import choose
from handbench.radar.simulation.simulate import simulate_scene
from handbench.support.errors import HandbenchError
from tests.radar.simulation.effects.plates import joined, plate, sheet, sphere_body

FEW = AntennaArray(qar50().tx_m[::8], qar50().rx_m[::8])
TONES_HZ = np.array([82e9, 81.8e9, 79.5e9, 82e9])
RELIEF_M, PERIOD_M = 1.5e-3, 0.03  # of a wavy surface


def moving(target: Body, step_s=1e-3, times_s=None, **given) -> EchoScene:
    """A body before a thin array, with keys of [target.motion] or of the scene."""
    motion = {key: value for key, value in given.items() if key not in EchoScene.__annotations__}
    times_s = step_s * np.arange(4) if times_s is None else np.asarray(times_s)
    scene = EchoScene(FEW, TONES_HZ, times_s, target, origin_m=np.array([0, 0, 0.3]))
    others = {key: given[key] for key in given.keys() - motion.keys()}
    return replace(scene, motion=Motion.model_validate(motion), **others)


def simulated(scene: EchoScene, *effects: str, frames=1):
    """Samples [frame, f, t, r] of the scene with these effects."""
    return simulate_scene(scene, choose(scene, effects), frames).capture.samples


def difference(found: np.ndarray, expected: np.ndarray) -> float:
    """The largest relative L2 difference of a tone."""
    off = np.linalg.norm(found - expected, axis=(-2, -1))
    return float((off / np.linalg.norm(expected, axis=(-2, -1))).max())


def turn_about_x(angle_rad: float) -> np.ndarray:
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


def wave(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return RELIEF_M * np.sin(2 * np.pi * x / PERIOD_M) * np.cos(2 * np.pi * y / PERIOD_M)


def wavy_normals(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Normals of z = wave(x, y) towards −z."""
    k = 2 * np.pi / PERIOD_M
    slopes = (
        RELIEF_M * k * np.cos(k * x) * np.cos(k * y),
        -RELIEF_M * k * np.sin(k * x) * np.sin(k * y),
    )
    normal = np.stack([*slopes, -np.ones_like(x)], axis=-1)
    return normal / np.linalg.norm(normal, axis=-1, keepdims=True)


@pytest.mark.parametrize("oblique", [False, True])
def test_a_tipping_surface_against_a_sum_over_its_points(oblique):
    """At each tone's time, the sum over the triangles' centres with exact distances, written down
    here. The fast summation errs by 1e-5, and the smooth normals of a mesh of 0.6 mm by 2e-3."""
    body, rate_rad_s, pivot_m = sheet(0.03, 6e-4, 0.3, wave), np.radians(100.0), [0, 0.01, 0.302]
    scene = moving(body, 5e-3, rotation_deg_s=[100.0, 0, 0], pivot_m=[0, 0.01, 0.002])
    found = simulated(scene, *(["obliquity"] if oblique else []), "motion")[0]
    flat_m = body.vertices_m[body.faces].mean(axis=1)
    for tone, (frequency_hz, time_s) in enumerate(zip(TONES_HZ, scene.time_s, strict=True)):
        turn = turn_about_x(rate_rad_s * time_s)
        corners_m = (body.vertices_m - pivot_m) @ turn.T + pivot_m
        a, b, c = corners_m[body.faces].swapaxes(0, 1)
        centre_m, weight = (a + b + c) / 3, np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
        legs = [centre_m - antennas_m[:, None] for antennas_m in (FEW.tx_m, FEW.rx_m)]
        ranges_m = [np.linalg.norm(leg, axis=2) for leg in legs]
        gains = [1 / range_m for range_m in ranges_m]
        if oblique:
            normal = wavy_normals(*flat_m[:, :2].T) @ turn.T
            cosines = [-np.einsum("api,pi->ap", leg, normal) for leg in legs]
            gains = [g * np.sqrt(np.maximum(c * g, 0)) for g, c in zip(gains, cosines, strict=True)]
        k = 2 * np.pi * frequency_hz / SPEED_OF_LIGHT_M_S
        tx, rx = (g * np.exp(-1j * k * r) for g, r in zip(gains, ranges_m, strict=True))
        assert difference(found[tone], (tx * weight) @ rx.T) < (2e-3 if oblique else 5e-5)


def test_a_surface_that_has_moved_far_is_seen_as_a_new_one():
    """A bead before a plate: after 5 mm, it hides another part of it. Until 2 mm, shadows stay on
    their faces, and the part of the plate that they falsely hide is a tenth of the echo."""
    finger = sphere_body(4e-3, (0.0, 0.0, 0.27))
    wall = plate((-0.02, -0.02, 0.3), (0.0, 0.04, 0.0), (0.04, 0.0, 0.0), 40)
    faces = np.arange(len(joined(finger, wall).faces)) < len(finger.faces)
    still = joined(finger, wall)

    def bent(time_s: float) -> np.ndarray:
        moved_m = still.vertices_m.copy()
        moved_m[np.unique(still.faces[faces])] += [1.0 * time_s, 0, 0]
        return moved_m

    scene = moving(still, times_s=[0.0, 1e-3, 5e-3, 6e-3], bent=bent)
    shadows = ("obliquity", "shadow")
    found = simulated(scene, *shadows, "motion")[0]
    for tone, near in ((0, 1e-5), (1, 0.1), (2, 1e-5), (3, 0.1)):
        there = Body(bent(scene.time_s[tone]), still.faces)
        expected = simulated(moving(there), *shadows)[0, tone]
        assert difference(found[tone], expected) < near


def test_frames_follow_each_other_only_with_a_period():
    body, velocity = sphere_body(6e-3, (0.0, 0.0, 0.3)), [0.0, 0.5, 0.0]
    scene = moving(body, velocity_m_s=0.5, direction=velocity, amplitude_m=1e-4)
    apart = simulated(scene, "motion", frames=2)
    assert difference(apart[1, :1], apart[0, :1]) < 1e-6
    running = replace(scene, frame_period_s=0.01)
    capture = simulate_scene(running, choose(running, ("motion",)), 3).capture
    assert capture.times_s.tolist() == scene.time_s.tolist()
    assert capture.frame_times_s == pytest.approx([0, 0.01, 0.02])
    for frame, start in enumerate(frame_starts(running, 3)):
        there = Body(surface_m(running, body.vertices_m, *start), body.faces)
        expected = bare_echoes(moving(there)).samples()[0]
        assert difference(capture.samples[frame, 0], expected) < 3e-5
    # one tremor goes on: it is back where it was after its period
    periods = replace(running, frame_period_s=1 / 9.0)
    first, second = (
        surface_m(periods, body.vertices_m, *start) for start in frame_starts(periods, 2)
    )
    assert second - first == pytest.approx(np.tile(np.array(velocity) / 9, (len(first), 1)))


def test_a_rigid_body_turns_about_its_pivot_and_has_the_velocities_of_one():
    body, at = sphere_body(0.02, (0.0, 0.0, 0.3)), (0.2, 0.4)
    scene = moving(
        body,
        rotation_deg_s=[30.0, 0, 0],
        pivot_m=[0.01, 0.02, 0.0],
        velocity_m_s=0.1,
        amplitude_m=0,
    )
    pivot_m, along = np.array([0.01, 0.02, 0.3]), np.array([0, 0, 1.0])
    turned_m = (body.vertices_m - pivot_m) @ turn_about_x(np.radians(6.0)).T
    found_m = surface_m(scene, body.vertices_m, *at)
    assert np.abs(found_m - (turned_m + pivot_m + 0.02 * along)).max() < 1e-15
    expected = np.cross([np.radians(30.0), 0, 0], turned_m) + 0.1 * along
    assert np.abs(velocity_m_s(scene, body.vertices_m, *at) - expected).max() < 1e-9
    assert np.array_equal(surface_m(scene, body.vertices_m, 0.0, 0.4), body.vertices_m)


def test_a_surface_that_does_not_move_echoes_as_one_at_rest():
    bead = sphere_body(8e-3, (0.0, 0.0, 0.3))
    still = moving(bead, bent=lambda time_s: bead.vertices_m)
    effects = ("obliquity", "shadow")
    found = simulated(still, *effects, "motion")
    assert difference(found, simulated(moving(bead), *effects)) < 2e-5  # twice the summation's


def test_a_target_that_flies_through_the_array_is_refused():
    scene = moving(sphere_body(0.02, (0, 0, 0.3)), velocity_m_s=-100.0, frame_period_s=1.0)
    with pytest.raises(HandbenchError, match=r"target\.motion: after 0\.003 s the target extends"):
        simulated(scene, "motion")
