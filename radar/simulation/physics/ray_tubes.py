"""Ray tubes from every transmitter over one mirror onto the same body, traced once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from radar.data.arrays import AntennaArray
from radar.simulation.physics.bounces import Patches, Tubes, land, mirror
from radar.simulation.physics.facets import face_vectors, quarters, unit, vertex_normals
from radar.simulation.physics.line_of_sight import lines, points_in_sight
from radar.simulation.scene import Body
from radar.support.rays import OWN_SURFACE_M, Rays

CREASE = 0.85  # cosine between a face and its corner's normal below which the corner lies on an edge of the body
COARSE = 2  # times as long are the patches that are tried first,
TRIAL_M = 0.2  # with antennas so far apart, the ends of all lines among them
STRIDE_M = 0.08  # between the antennas whose sight is asked first


class Hits(NamedTuple):
    """n rays of transmitters that a mirror throws back onto the body: transmitter, patch (the mirror) and face (where
    it lands) [n], end_m [n, 3] there."""

    transmitter: np.ndarray
    patch: np.ndarray
    face: np.ndarray
    end_m: np.ndarray


class Mirrors(NamedTuple):
    """m mirrors as patches; part [m]: the coarse patch that each is a part of; face [m]: the body's face; all of the
    body's faces as patches."""

    patches: Patches
    coarse: Patches
    part: np.ndarray
    face: np.ndarray
    surface: Patches


@dataclass(frozen=True)
class Traced:
    """Hits in the order of the transmitters of an array; seen float32 [faces, r]: 1 where a receiver sees the face."""

    hits: Hits
    mirrors: Mirrors
    seen: np.ndarray
    array: AntennaArray

    def tubes(self, chosen: np.ndarray) -> Tubes:
        """The tubes around some of the hits, by index [n]."""
        transmitter, patch, face = (column[chosen] for column in self.hits[:3])
        return landed(transmitter, patch, face, self.mirrors.patches, self.mirrors.surface, self.array.tx_m)


def landed(
    transmitter: np.ndarray, patch: np.ndarray, face: np.ndarray, patches: Patches, surface: Patches, tx_m: np.ndarray
) -> Tubes:
    """Tubes of transmitters, patches and faces by index [n]."""
    n = len(face)
    start_m, end_m, normal, longer_m = (np.empty((n, 3)) for _ in range(4))
    length_m, root_m2, edge_m, caustics = np.empty(n), np.empty(n), np.empty((n, 3, 3)), np.zeros(n, np.int8)
    tubes = Tubes(transmitter, patch, face, start_m, end_m, normal, length_m, root_m2, edge_m, longer_m, caustics)
    land(tubes, patches, tx_m, surface)
    return tubes


def mirrors_of(rays: Rays, body: Body, antennas_m: np.ndarray, longest_m: float) -> Mirrors:
    """The patches that mirror some antennas [a, 3] onto the body, split until no edge is longer than longest_m; coarser
    ones that make no tube with a few of the antennas are left out."""
    surface = patches_of(body.vertices_m[body.faces], corner_normals(body))
    whole, whole_face = split(surface, COARSE * longest_m)
    chosen = np.flatnonzero(_lit_twice(rays, whole, surface, antennas_m))
    coarse = Patches(*(column[chosen] for column in whole))
    patches, part = split(coarse, longest_m)
    return Mirrors(patches, coarse, part, whole_face[chosen[part]], surface)


def trace(rays: Rays, mirrors: Mirrors, array: AntennaArray) -> Traced:
    """All hits. Both legs to the antennas are clear of the body, by the middles of coarse patches and of faces."""
    surface = mirrors.surface
    clear = points_in_sight(rays, mirrors.coarse.middle_m, array.tx_m, STRIDE_M)
    found = [
        _hits(rays, mirrors.patches, antenna_m, np.flatnonzero(seen[mirrors.part]))
        for antenna_m, seen in zip(array.tx_m, clear, strict=True)
    ]
    transmitter = np.repeat(np.arange(len(found)), [len(face) for _, face, _ in found])
    hits = Hits(transmitter, *(np.concatenate(column) for column in zip(*found, strict=True)))
    seen = np.zeros((len(surface.normal), len(array.rx_m)), np.float32)
    faces = np.unique(hits.face)
    seen[faces] = points_in_sight(rays, surface.middle_m[faces], array.rx_m, STRIDE_M).T
    return Traced(hits, mirrors, seen, array)


def split(surface: Patches, longest_m: float) -> tuple[Patches, np.ndarray]:
    """Patches split into four until no edge is longer than longest_m, and the face that each is a part of."""
    corners_m, normals, face = surface.corners_m, surface.normals, np.arange(len(surface.normal))
    done: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    while not done or len(face):
        long = np.linalg.norm(corners_m - np.roll(corners_m, 1, axis=1), axis=2).max(axis=1) > longest_m
        done.append((corners_m[~long], normals[~long], face[~long]))
        face = np.tile(face[long], 4)
        corners_m, normals = quarters(corners_m[long]), quarters(normals[long])
        normals = unit(normals)
    corners_m, normals, face = (np.concatenate(column) for column in zip(*done, strict=True))
    return patches_of(corners_m, normals), face


def patches_of(corners_m: np.ndarray, normals: np.ndarray) -> Patches:
    """Patches by their corners and the unit normals there, both [m, 3, 3]."""
    a, b, c = (corners_m[:, i] for i in range(3))
    return Patches(corners_m, normals, corners_m.mean(axis=1), unit(normals.sum(axis=1)), np.cross(b - a, c - a) / 2)


def corner_normals(body: Body) -> np.ndarray:
    """Unit normals [m, 3, 3] at the corners of each face: the vertex's, or the face's own at the edges of a body."""
    flat = unit(face_vectors(body.vertices_m, body.faces))
    smooth = vertex_normals(body)[body.faces]
    crease = np.einsum("mci,mi->mc", smooth, flat) < CREASE
    return np.where(crease[:, :, None], flat[:, None], smooth)


def _lit_twice(rays: Rays, patches: Patches, surface: Patches, antennas_m: np.ndarray) -> np.ndarray:
    """Mask [m] of the patches that make tubes with some of a few antennas."""
    some = np.zeros(len(patches.normal), bool)
    everything = np.arange(len(some))
    for line in lines(antennas_m):
        length_m = np.linalg.norm(np.ptp(antennas_m[line], axis=0))
        for n in np.unique(np.linspace(0, len(line) - 1, 2 + int(length_m / TRIAL_M)).astype(int)):
            patch, face, _ = _hits(rays, patches, antennas_m[line[n]], everything)
            tubes = landed(np.full(len(patch), line[n]), patch, face, patches, surface, antennas_m)
            some[patch[tubes.root_m2 > 0]] = True
    return some


def _hits(
    rays: Rays, patches: Patches, antenna_m: np.ndarray, chosen: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Those of the chosen patches that mirror the antenna onto the body [n], the face that each meets [n] and where
    [n, 3]."""
    direction = np.empty((len(chosen), 3))
    front = mirror(patches, antenna_m, chosen, direction)
    chosen, direction = chosen[front], direction[front]
    start_m = patches.middle_m[chosen] + OWN_SURFACE_M * direction
    distance, face = rays.first_hits(start_m, direction)
    hit = np.isfinite(distance)
    return chosen[hit], face[hit].astype(np.int64), start_m[hit] + distance[hit, None] * direction[hit]
