"""The effect "motion": while one tone after another is measured, the target moves, and its fingers.
Every tone sees the surface at its own time. A hand's fingers move first, then the target turns
about its pivot, then it is displaced.

The effects that shape the echoes (shadows, skin, bounces, …) are applied to the scene at few
moments. Until the surface has moved by MOMENT_M, the facets of a moment are moved along with their
faces and keep their shadows and layers; then the effects are applied anew. Bounces are weak: they
are computed once per moment, and their phase follows the mean motion of the facets.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from handbench.radar.imaging.exact import path_lengths
from handbench.radar.imaging.steering import phasor
from handbench.radar.simulation.forward import Scatterers
from handbench.radar.simulation.meshes import unit
from handbench.radar.simulation.scene import Body, EchoScene, Motion, generator
from handbench.radar.simulation.scene_echoes import Echoes
from handbench.support.errors import HandbenchError

MOMENT_M = 2e-3  # motion of a surface's fastest point after which its shadows are computed anew
DIFFERENCE_S = 1e-4  # between the two times of a velocity's difference: 9 Hz err by 1e-6


def motion(echoes: Echoes) -> None:
    """Let every tone of every frame see the target where it is at that time."""
    echoes.moving = True


def moving_samples(echoes: Echoes) -> np.ndarray:
    """Sum all echoes of the moving target and balls: complex64 [frame, f, t, r]."""
    scene, moment = echoes.scene, echoes
    shape = (echoes.frames, len(scene.time_s), *echoes.array.channels)
    samples = np.empty(shape, np.complex64)
    for frame, (start_s, tremor_rad) in enumerate(frame_starts(scene, echoes.frames)):
        for tone in np.argsort(scene.time_s, kind="stable"):
            now = scene_at(scene, start_s + float(scene.time_s[tone]), tremor_rad)
            if _distance_m(moment.scene, now) > MOMENT_M:
                near = _distance_m(scene, now) <= MOMENT_M
                moment = echoes if near else echoes.of(now)
            samples[frame, tone] = _moved_echo(moment, now, [int(tone)])[0]
    return samples


def _distance_m(scene: EchoScene, other: EchoScene) -> float:
    """Return by how much the fastest point of the target differs between two scenes."""
    return float(np.linalg.norm(other.points_m - scene.points_m, axis=1).max())


def _moved_echo(moment: Echoes, now: EchoScene, tones: list[int]) -> np.ndarray:
    """Sum the echoes [f, t, r] of some tones f, with the target as it is in the scene `now`, from
    those of a moment near to it."""
    facets = moment.facets
    if facets is not None:
        facets = moved_facets(facets, moment.scene.body, now.body)
    moved = replace(moment, scene=now, facets=facets)
    samples = moved.sums(tones)
    if moment.bounced is not None:
        middles_m = (state.points_m.mean(axis=0) for state in (moment, moved))
        before_m, after_m = (path_lengths(moment.array, middle_m) for middle_m in middles_m)
        turns = phasor(after_m - before_m, now.frequencies_hz[tones][:, None, None], -1)
        samples += moment.bounced[tones] * turns
    return samples


def moved_facets(facets: Scatterers, before: Body, after: Body) -> Scatterers:
    """Return the facets of a body after its vertices have moved: each facet moves with its face, by
    the affine map F that takes the face's corners and unit normal to the new ones. Its normal n
    becomes that of F⁻ᵀn, and its area grows by det F."""
    assert facets.face is not None and facets.normal is not None
    used, face = np.unique(facets.face, return_inverse=True)
    (from_m, edges), (to_m, moved) = (_face_frames(body, used) for body in (before, after))
    maps = moved @ np.linalg.inv(edges)
    offset_m = np.einsum("pij,pj->pi", maps[face], facets.position_m - from_m[face])
    normal = np.einsum("pji,pj->pi", np.linalg.inv(maps)[face], facets.normal)
    weight = facets.weight * np.linalg.det(maps)[face]
    return replace(facets, position_m=to_m[face] + offset_m, weight=weight, normal=unit(normal))


def _face_frames(body: Body, face: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the first corner [m, 3] of each face and its frame [m, 3, 3], whose columns are two
    edges and the unit normal."""
    a, b, c = (body.vertices_m[body.faces[face, i]] for i in range(3))
    return a, np.stack([b - a, c - a, unit(np.cross(b - a, c - a))], axis=2)


def frame_starts(scene: EchoScene, frames: int) -> list[tuple[float, float]]:
    """Return when each frame starts: (seconds since the movement began, phase of the tremor when
    it began). If the scene has a frame period, one movement goes on through all frames; otherwise
    each frame has its own, with its own phase of the tremor."""
    phases = [0.0] * frames
    if scene.motion.amplitude_m:
        seeds = [scene.seeds("motion", 0, frame) for frame in range(frames)]
        phases = [generator(seed).uniform(0, 2 * np.pi) for seed in seeds]
    if scene.frame_period_s is None:
        return [(0.0, phase) for phase in phases]
    return [(frame * scene.frame_period_s, phases[0]) for frame in range(frames)]


def displacement_m(motion: Motion, time_s: np.ndarray, phase_rad: float) -> np.ndarray:
    """Return the target's displacement [f], in metres, at the times time_s [f], relative to its
    place at time 0. phase_rad: phase of the tremor at time 0."""
    sine = np.sin(2 * np.pi * motion.frequency_hz * time_s + phase_rad) - np.sin(phase_rad)
    return motion.amplitude_m * sine + motion.velocity_m_s * time_s


def moved_as_a_whole(
    scene: EchoScene, points_m: np.ndarray, time_s: float, tremor_rad: float
) -> np.ndarray:
    """Return where points [n, 3] of the target are after its rotation and displacement."""
    motion = scene.motion
    turn = Rotation.from_rotvec(np.radians(motion.rotation_deg_s) * time_s).as_matrix()
    from_pivot_m = points_m - (scene.origin_m + motion.pivot_m)
    offset_m = displacement_m(motion, np.array(time_s), tremor_rad) * motion.along
    return points_m + from_pivot_m @ (turn - np.eye(3)).T + offset_m


def surface_m(
    scene: EchoScene, vertices_m: np.ndarray, time_s: float, tremor_rad: float
) -> np.ndarray:
    """Return where the vertices [n, 3] of the target's surface are, which at time 0 are at
    vertices_m."""
    shaped_m = vertices_m if scene.bent is None else scene.bent(time_s)
    return moved_as_a_whole(scene, shaped_m, time_s, tremor_rad)


def velocity_m_s(
    scene: EchoScene, vertices_m: np.ndarray, time_s: float, tremor_rad: float
) -> np.ndarray:
    """Return the velocities [n, 3] of these vertices, by a central difference."""
    before_m, behind_m = (
        surface_m(scene, vertices_m, time_s + step_s, tremor_rad)
        for step_s in (-DIFFERENCE_S / 2, DIFFERENCE_S / 2)
    )
    return (behind_m - before_m) / DIFFERENCE_S


def scene_at(scene: EchoScene, time_s: float, tremor_rad: float) -> EchoScene:
    """Return the scene with its target where it is at a time. Raises HandbenchError if it then
    reaches behind the plane of the array."""
    balls = tuple(
        replace(ball, centre_m=moved_as_a_whole(scene, ball.centre_m[None], time_s, tremor_rad)[0])
        for ball in scene.balls
    )
    target = scene.target
    if target is not None:
        target = replace(target, vertices_m=surface_m(scene, target.vertices_m, time_s, tremor_rad))
    nearest_m = min(
        [ball.centre_m[2] - ball.radius_m for ball in balls]
        + ([] if target is None else [float(target.vertices_m[:, 2].min())])
    )
    if nearest_m <= 0:
        raise HandbenchError(
            f"target.motion: after {time_s:.3g} s the target extends {-1e3 * nearest_m:.0f} mm "
            "behind the plane of the array; let it move more slowly, simulate fewer frames, or "
            "enlarge target.distance_m"
        )
    return replace(scene, target=target, balls=balls)
