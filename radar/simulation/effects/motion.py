"""The effect "motion": while one tone after another is measured, the target moves. Every tone sees
the surface at its own time.

The effects that shape the echoes (shadows, skin, bounces, …) are applied to the scene at few
moments. Until the surface has moved by MOMENT_M, the facets of a moment are moved along with their
faces and keep their shadows and layers; then the effects are applied anew. Bounces are weak: they
are computed once per moment, and their phase follows the mean motion of the facets.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from handbench.radar.imaging.exact import path_lengths
from handbench.radar.imaging.steering import phasor
from handbench.radar.simulation.forward import Scatterers
from handbench.radar.simulation.movement import frame_starts, scene_at
from handbench.radar.simulation.physics.meshes import unit
from handbench.radar.simulation.scene import Body, EchoScene
from handbench.radar.simulation.scene_echoes import Echoes

MOMENT_M = 2e-3  # motion of a surface's fastest point after which its shadows are computed anew


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
