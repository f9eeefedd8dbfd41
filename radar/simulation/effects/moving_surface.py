"""Echoes of a target that moves in any way: every tone sees the surface at its own time.

The effects that shape the echoes (shadows, skin, multiple bounces, …) are applied to the scene at
few moments. Until the surface has moved by MOMENT_M, the facets of a moment are moved along with
their faces and keep their shadows and layers; then the effects are applied anew. Extra echoes
(multiple bounces, foam) are weak: they are computed once per moment, and their phase follows the
mean motion of the facets.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from handbench.radar.imaging.cpu.steering import phasor
from handbench.radar.simulation.movement import Instant, frame_starts, scene_at
from handbench.radar.simulation.physics.facets import face_vectors, unit, vertex_normals
from handbench.radar.simulation.physics.sight import barycentric
from handbench.radar.simulation.scene import Body, EchoScene
from handbench.radar.simulation.scene_echoes import Echoes, ScatteringSurface, bare_echoes

MOMENT_M = 2e-3  # motion of a surface's fastest point after which its shadows are computed anew


def echoes_at_each_tone(echoes: Echoes) -> np.ndarray:
    """Compute the samples of a moving target, to which the effects so far have been applied at the
    start of its movement: complex64 [frame, f, t, r]."""
    scene = echoes.scene
    starts, measured = (
        frame_starts(scene, echoes.frames),
        defaultdict[Instant, list[tuple[int, int]]](list),
    )
    for frame, tone in np.ndindex(echoes.frames, len(scene.time_s)):
        measured[starts[frame].after(float(scene.time_s[tone]))].append((frame, tone))
    samples = np.empty((echoes.frames, len(scene.time_s), *echoes.array.channels), np.complex64)
    start = moment = Moment(echoes)
    for at in sorted(measured, key=lambda at: at[::-1]):
        now = scene_at(scene, at)
        if moment.distance_m(now) > MOMENT_M:
            near = start.distance_m(now) <= MOMENT_M
            moment = start if near else Moment(_applied_at(echoes, now))
        tones = sorted({tone for _, tone in measured[at]})
        echo = moment.echo(now, tones)
        for frame, tone in measured[at]:
            samples[frame, tone] = echo[tones.index(tone)]
    return samples


def _applied_at(echoes: Echoes, scene: EchoScene) -> Echoes:
    """Return the state after the same effects, with the target as it is in `scene`."""
    bare = bare_echoes(scene, echoes.frames, echoes.tolerance)
    state = replace(bare, timed=echoes.timed)
    for effect in echoes.applied:
        state = state.through(effect)
    return state


@dataclass(frozen=True, eq=False)
class Moment:
    """A moment of a movement: the state of a simulation whose effects were applied then."""

    echoes: Echoes

    def distance_m(self, scene: EchoScene) -> float:
        """Return how far the fastest point of the target is in another scene from here."""
        away_m = _points_m(scene) - _points_m(self.echoes.scene)
        return float(np.linalg.norm(away_m, axis=1).max())

    def echo(self, scene: EchoScene, tones: list[int]) -> np.ndarray:
        """Compute the samples [f, t, r] of some tones f, with the target as it is in `scene`."""
        before, body = self.echoes, scene.target
        surface = before.surface
        if surface is not None and body is not None:
            surface = self._moved(surface, body)
        now = replace(before, scene=scene, surface=surface)
        samples = now.echo(now.array, tones)
        if before.extra:
            longer_m = _path_m(now) - _path_m(before)
            turns = phasor(longer_m, scene.frequencies_hz[tones][:, None, None], -1)
            samples += self._extra[tones] * turns
        return samples

    @cached_property
    def _extra(self) -> np.ndarray:
        return np.asarray(self.echoes.extra_echoes())

    @cached_property
    def _places(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Where the facets are on their faces: barycentric coordinates [p, 3], heights [p] above
        the faces in metres, and +1 or −1 [p] for normals outwards or inwards."""
        surface = self.echoes.surface
        assert surface is not None
        facets, body = surface.facets, surface.body
        corners_m = body.vertices_m[body.faces[facets.face]]
        share = barycentric(corners_m, facets.position_m)
        above_m = facets.position_m - np.einsum("pc,pci->pi", share, corners_m)
        height_m = (above_m * _normals(body, facets.face)).sum(axis=1)
        outwards = (facets.normal * _smooth_normals(body, facets.face, share)).sum(axis=1)
        return share, height_m, np.sign(outwards)

    def _moved(self, surface: ScatteringSurface, body: Body) -> ScatteringSurface:
        """Return the surface with its facets moved along with the faces of a moved body."""
        (share, height_m, outwards), face = self._places, surface.facets.face
        areas = [
            np.linalg.norm(face_vectors(b.vertices_m, b.faces[face]), axis=1)
            for b in (surface.body, body)
        ]
        facets = replace(
            surface.facets,
            position_m=np.einsum("pc,pci->pi", share, body.vertices_m[body.faces[face]])
            + height_m[:, None] * _normals(body, face),
            area_m2=surface.facets.area_m2 * areas[1] / areas[0],
            normal=outwards[:, None] * _smooth_normals(body, face, share),
        )
        return replace(surface, body=body, facets=facets)


def _points_m(scene: EchoScene) -> np.ndarray:
    """Return the vertices of the target and the balls' centres [n, 3]."""
    surface = [] if scene.target is None else [scene.target.vertices_m]
    return np.concatenate([*surface, *(ball.centre_m[None] for ball in scene.balls)])


def _path_m(echoes: Echoes) -> np.ndarray:
    """Return the path of each channel by way of the mean of the target's points: [t, r]."""
    middle_m = echoes.points_m.mean(axis=0)
    tx_m, rx_m = (leg.lengths_m(middle_m) for leg in echoes.array.legs)
    return tx_m[:, None] + rx_m


def _normals(body: Body, face: np.ndarray) -> np.ndarray:
    """Return the outward unit normals [p, 3] of faces."""
    return unit(face_vectors(body.vertices_m, body.faces[face]))


def _smooth_normals(body: Body, face: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Return unit normals [p, 3] interpolated between those at the corners of faces; share [p, 3]:
    barycentric coordinates."""
    corners = vertex_normals(body)[body.faces[face]]
    return unit(np.einsum("pc,pci->pi", share, corners))
