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

from handbench.radar.imaging.cpu.steering import phasor
from handbench.radar.simulation.movement import frame_starts, scene_at
from handbench.radar.simulation.physics.facets import Facets, unit
from handbench.radar.simulation.scene import Body, EchoScene
from handbench.radar.simulation.scene_echoes import Echoes, bare_echoes

MOMENT_M = 2e-3  # motion of a surface's fastest point after which its shadows are computed anew


def motion(echoes: Echoes, samples: np.ndarray) -> np.ndarray:
    """Let every tone of every frame see the target where it is at that time."""
    scene, moving = echoes.scene, samples.copy()
    moment = echoes
    for frame, start in enumerate(frame_starts(scene, echoes.frames)):
        for tone in np.argsort(scene.time_s, kind="stable"):
            now = scene_at(scene, start.after(float(scene.time_s[tone])))
            if _distance_m(moment.scene, now) > MOMENT_M:
                near = _distance_m(scene, now) <= MOMENT_M
                moment = echoes if near else _moment(echoes, now)
            moving[frame, tone] = _moved_echo(moment, now, [int(tone)])[0]
    return moving


def _moment(echoes: Echoes, now: EchoScene) -> Echoes:
    """Return the echoes of the scene `now`, shaped by the same effects."""
    moment = bare_echoes(now, tolerance=echoes.tolerance)
    for effect in echoes.shaping:
        moment.shape(effect)
    return moment


def _distance_m(scene: EchoScene, other: EchoScene) -> float:
    """Return by how much the fastest point of the target differs between two scenes."""
    away_m = _points_m(other) - _points_m(scene)
    return float(np.linalg.norm(away_m, axis=1).max())


def _points_m(scene: EchoScene) -> np.ndarray:
    """Return the vertices of the target and the balls' centres [n, 3]."""
    surface = [] if scene.target is None else [scene.target.vertices_m]
    return np.concatenate([*surface, *(ball.centre_m[None] for ball in scene.balls)])


def _moved_echo(moment: Echoes, now: EchoScene, tones: list[int]) -> np.ndarray:
    """Sum the echoes [f, t, r] of some tones f, with the target as it is in the scene `now`, from
    those of a moment near to it."""
    surface = moment.surface
    if surface is not None and now.target is not None:
        facets = moved_facets(surface.facets, surface.body, now.target)
        surface = replace(surface, facets=facets, body=now.target)
    moved = replace(moment, scene=now, surface=surface)
    samples = moved.sums(tones)
    if moment.bounced is not None:
        longer_m = _path_m(moved) - _path_m(moment)
        turns = phasor(longer_m, now.frequencies_hz[tones][:, None, None], -1)
        samples += moment.bounced[tones] * turns
    return samples


def _path_m(echoes: Echoes) -> np.ndarray:
    """Return the path of each channel by way of the mean of the target's points: [t, r]."""
    middle_m = echoes.points_m.mean(axis=0)
    tx_m, rx_m = (leg.lengths_m(middle_m) for leg in echoes.array.legs)
    return tx_m[:, None] + rx_m


def moved_facets(facets: Facets, before: Body, after: Body) -> Facets:
    """Return the facets of a body after its vertices have moved: each facet moves with its face, by
    the affine map F that takes the face's corners and unit normal to the new ones. Its normal n
    becomes that of F⁻ᵀn, and its area grows by det F."""
    used, face = np.unique(facets.face, return_inverse=True)
    (from_m, edges), (to_m, moved) = (_face_frames(body, used) for body in (before, after))
    maps = (moved @ np.linalg.inv(edges))[face]
    return replace(
        facets,
        position_m=to_m[face] + np.einsum("pij,pj->pi", maps, facets.position_m - from_m[face]),
        area_m2=facets.area_m2 * np.linalg.det(maps),
        normal=unit(np.einsum("pji,pj->pi", np.linalg.inv(maps), facets.normal)),
    )


def _face_frames(body: Body, face: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the first corner [m, 3] of each face and its frame [m, 3, 3], whose columns are two
    edges and the unit normal."""
    a, b, c = (body.vertices_m[body.faces[face, i]] for i in range(3))
    return a, np.stack([b - a, c - a, unit(np.cross(b - a, c - a))], axis=2)
