"""Tracing of ray tubes from every transmitter over patches of the body that act as mirrors, and on
to other parts of the same body."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from handbench.radar.data.arrays import AntennaArray
from handbench.radar.simulation.physics.bounces import Patches, Tubes, land, mirror
from handbench.radar.simulation.physics.creeping import LIT
from handbench.radar.simulation.physics.facets import face_vectors, quarters, unit, vertex_normals
from handbench.radar.simulation.physics.line_of_sight import nodes, points_in_sight
from handbench.radar.simulation.scene import Body
from handbench.support.rays import OWN_SURFACE_M, Rays

# cosine between a face and its corner's normal below which the corner is on an edge of the body
CREASE = 0.85
# least amplitude of tubes with b bounces relative to the strongest b; others make up 0.5 % of a
# hand's echoes
LEAST = 0.05
COARSE = 2  # patches that are tried first are longer by this factor,
TRIAL_M = 0.2  # with antennas this far apart, including the ends of all lines
BESIDE_M = 0.01  # trial antennas closer than this are merged
STRIDE_M = 0.08  # distance of the antennas whose line of sight is tested first


class Hits(NamedTuple):
    """n rays from transmitters that a patch (a triangle of the body that acts as a mirror) reflects
    back onto the body.

    transmitter, patch: indices [n]; faces [n, b]: the body's faces that a ray meets after the
    patch, in order (−1: none); end_m [n, 3]: where it meets the last of them; length_m [n]: length
    of the path from the patch to there.
    """

    transmitter: np.ndarray
    patch: np.ndarray
    faces: np.ndarray
    end_m: np.ndarray
    length_m: np.ndarray

    def where(self, chosen: np.ndarray) -> Hits:
        """Return the rays that a mask [n] or indices `chosen` select."""
        return Hits(*(column[chosen] for column in self))


class Mirrors(NamedTuple):
    """The m patches (triangles) of a body that reflect waves from the antennas onto the body
    itself.

    coarse: larger patches, of which `patches` are parts; part [m]: index of the coarse patch that
    each is a part of; bounces: how many reflections after the patch's own matter; face [m]: index
    of the body's face; surface: all faces of the body as patches.
    """

    patches: Patches
    coarse: Patches
    part: np.ndarray
    bounces: int
    face: np.ndarray
    surface: Patches


@dataclass(frozen=True)
class RayTrace:
    """Traced rays: first all that meet one face of the body after the mirror, then those that meet
    two, and so on, each group in the order of the transmitters of `array`.

    seen float32 [faces, r]: 1 where a receiver sees the face; wavenumber: in rad/m if waves also
    creep around edges, else 0.
    """

    hits: Hits
    mirrors: Mirrors
    seen: np.ndarray
    array: AntennaArray
    wavenumber: float

    def tubes(self, chosen: np.ndarray) -> Tubes:
        """Return the ray tubes around the rays with the indices `chosen` [n], which must all have
        the same number of reflections."""
        transmitter, patch, faces = (column[chosen] for column in self.hits[:3])
        hits = self.hits._replace(
            transmitter=transmitter, patch=patch, faces=faces[:, : (faces[:1] >= 0).sum()]
        )
        return tubes_around(
            hits, self.mirrors.patches, self.mirrors.surface, self.array.tx_m, self.wavenumber
        )


def tubes_around(
    hits: Hits, patches: Patches, surface: Patches, tx_m: np.ndarray, wavenumber: float = 0.0
) -> Tubes:
    """Return the ray tubes around traced rays [n]. patches: the mirrors; surface: all faces of the
    body as patches. With a wavenumber above 0, the tubes' fields are reduced by the share that
    creeping waves carry."""
    n, b = hits.faces.shape
    points_m, normal, longer_m = np.empty((n, b + 1, 3)), np.empty((n, 3)), np.empty((n, 3))
    length_m, root_m2, edge_m, caustics = (
        np.empty(n),
        np.empty(n),
        np.empty((n, 3, 3)),
        np.zeros(n, np.int8),
    )
    faces = np.ascontiguousarray(hits.faces)  # else kernels are compiled for both layouts
    tubes = Tubes(
        hits.transmitter,
        hits.patch,
        faces,
        points_m,
        normal,
        length_m,
        root_m2,
        edge_m,
        longer_m,
        caustics,
        bend_per_m=np.zeros((n, b + 1)),
    )
    land(tubes, patches, tx_m, surface, wavenumber, LIT)
    return tubes


def next_hits(rays: Rays, hits: Hits, patches: Patches, surface: Patches, tx_m: np.ndarray) -> Hits:
    """Follow rays over one more reflection. Returns only those that meet the body once more: their
    paths end there, and they have one more column of faces."""
    tubes = tubes_around(hits, patches, surface, tx_m)
    lit = np.flatnonzero(tubes.root_m2 > 0)  # points and normals of the others were never written
    hits, points_m, normal = hits.where(lit), tubes.points_m[lit], tubes.normal[lit]
    before = unit(points_m[:, -1] - points_m[:, -2])
    onward = before - 2 * (before * normal).sum(axis=1)[:, None] * normal
    start_m = points_m[:, -1] + OWN_SURFACE_M * onward
    distance, face = rays.first_hits(start_m, onward)
    met = np.flatnonzero(np.isfinite(distance))
    faces = np.column_stack([hits.faces, face])[met].astype(np.int32)
    end_m = start_m[met] + distance[met, None] * onward[met]
    return Hits(
        hits.transmitter[met], hits.patch[met], faces, end_m, (hits.length_m + distance)[met]
    )


def mirrors_of(
    rays: Rays, body: Body, antennas_m: np.ndarray, longest_m: float, bounces: int = 1
) -> Mirrors:
    """Find the patches of the body that reflect waves from antennas [a, 3] back onto the body, with
    edges of at most longest_m.

    Patches of twice that length are tried first, with a few of the antennas, and left out if their
    ray tubes do not meet the body. bounces: largest number of faces that a ray may meet after its
    patch.
    """
    surface = patches_of(body.vertices_m[body.faces], corner_normals(body))
    whole, face = split(surface, COARSE * longest_m)
    mirrors, bounces = _lit(rays, whole, surface, antennas_m, bounces)
    chosen = np.flatnonzero(mirrors)
    coarse = Patches(*(column[chosen] for column in whole))
    patches, part = split(coarse, longest_m)
    return Mirrors(patches, coarse, part, bounces, face[chosen[part]], surface)


def trace(rays: Rays, mirrors: Mirrors, array: AntennaArray, wavenumber: float) -> RayTrace:
    """Trace the rays from all transmitters over the mirrors and on to the other faces of the body.

    Kept are rays whose transmitter sees the mirror's coarse patch and whose last face at least one
    receiver sees; both are tested at the middle of patch and face only.
    """
    surface = mirrors.surface
    clear = points_in_sight(rays, mirrors.coarse.middle_m, array.tx_m, STRIDE_M)
    found: list[list[Hits]] = [[] for _ in range(mirrors.bounces)]
    for n, seen in enumerate(clear):
        hits = first_hits(rays, mirrors.patches, array.tx_m, n, np.flatnonzero(seen[mirrors.part]))
        found[0].append(hits)
        for b in range(1, mirrors.bounces):
            hits = next_hits(rays, hits, mirrors.patches, surface, array.tx_m)
            found[b].append(hits)
    faces = np.unique(np.concatenate([hits.faces[:, -1] for some in found for hits in some]))
    seen = np.zeros((len(surface.normal), len(array.rx_m)), np.float32)
    seen[faces] = points_in_sight(rays, surface.middle_m[faces], array.rx_m, STRIDE_M).T
    return RayTrace(
        _join_hits(found, np.asarray(seen.any(axis=1))), mirrors, seen, array, wavenumber
    )


def _join_hits(found: list[list[Hits]], visible: np.ndarray) -> Hits:
    """Join rays, listed by number of reflections, to one table; shorter rows of faces are filled
    with −1. Rays whose last face is not `visible` [faces] to any receiver are left out."""
    padded = []
    for b, some in enumerate(found):
        for hits in (hits.where(visible[hits.faces[:, -1]]) for hits in some):
            faces = np.full((len(hits.patch), len(found)), -1, np.int32)
            faces[:, : b + 1] = hits.faces
            padded.append(hits._replace(faces=faces))
    return Hits(*(np.concatenate(column) for column in zip(*padded, strict=True)))


def split(surface: Patches, longest_m: float) -> tuple[Patches, np.ndarray]:
    """Split triangles into four, repeatedly, until no edge is longer than longest_m: (the parts,
    index of the triangle that each part comes from)."""
    corners_m, normals, face = surface.corners_m, surface.normals, np.arange(len(surface.normal))
    if (
        np.linalg.norm(corners_m - np.roll(corners_m, 1, axis=1), axis=2).max(initial=0)
        <= longest_m
    ):
        return surface, face
    done: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    while not done or len(face):
        long = (
            np.linalg.norm(corners_m - np.roll(corners_m, 1, axis=1), axis=2).max(axis=1)
            > longest_m
        )
        done.append((corners_m[~long], normals[~long], face[~long]))
        face = np.tile(face[long], 4)
        corners_m, normals = quarters(corners_m[long]), quarters(normals[long])
        normals = unit(normals)
    corners_m, normals, face = (np.concatenate(column) for column in zip(*done, strict=True))
    return patches_of(corners_m, normals), face


def patches_of(corners_m: np.ndarray, normals: np.ndarray) -> Patches:
    """Make patches from the corners of triangles and the unit normals there, both [m, 3, 3]."""
    a, b, c = (corners_m[:, i] for i in range(3))
    return Patches(
        corners_m,
        normals,
        corners_m.mean(axis=1),
        unit(normals.sum(axis=1)),
        np.cross(b - a, c - a) / 2,
    )


def corner_normals(body: Body) -> np.ndarray:
    """Return unit normals [m, 3, 3] at the corners of each face: the smooth normal at the vertex,
    or the normal of the flat face where the body has a sharp edge."""
    flat = unit(face_vectors(body.vertices_m, body.faces))
    smooth = vertex_normals(body)[body.faces]
    crease = np.einsum("mci,mi->mc", smooth, flat) < CREASE
    return np.where(crease[:, :, None], flat[:, None], smooth)


def _lit(
    rays: Rays, patches: Patches, surface: Patches, antennas_m: np.ndarray, bounces: int
) -> tuple[np.ndarray, int]:
    """Return which patches [m] mirror a valid ray tube from one of a few antennas onto the body,
    and how many reflections after that matter: those before the first number for which all tubes
    together are weak (LEAST).

    That number holds for all patches. Paths with many reflections are narrow, so that these few
    tubes miss some of them.
    """
    mirror, level_m2 = np.zeros(len(patches.normal), bool), np.zeros(bounces + 1)
    everything = np.arange(len(mirror))
    few = nodes(antennas_m, TRIAL_M)
    for antenna in few[
        np.unique((antennas_m[few] / BESIDE_M).round(), axis=0, return_index=True)[1]
    ]:
        hits = first_hits(rays, patches, antennas_m, antenna, everything)
        for b in range(1, bounces + 1):
            root_m2 = tubes_around(hits, patches, surface, antennas_m).root_m2
            mirror[hits.patch[root_m2 > 0]] = True
            level_m2[b] += root_m2.sum()
            if b < bounces:
                hits = next_hits(rays, hits, patches, surface, antennas_m)
    strong = level_m2[1:] >= LEAST * level_m2.max()
    return mirror, bounces if strong.all() else max(int(strong.argmin()), 1)


def first_hits(
    rays: Rays, patches: Patches, antennas_m: np.ndarray, antenna: int, chosen: np.ndarray
) -> Hits:
    """Trace the rays of one antenna (by index) over the chosen patches. Returns those that a patch
    reflects onto the body, up to the first face that they meet."""
    ways = np.empty((len(chosen), 6), np.float32)
    chosen = chosen[mirror(patches, antennas_m[antenna], chosen, OWN_SURFACE_M, ways)]
    ways = ways[: len(chosen)]
    distance, face = rays.first_hits(ways[:, :3], ways[:, 3:])
    hit = np.flatnonzero(np.isfinite(distance))
    distance, ways, face = distance[hit], ways[hit], face[hit, None].astype(np.int32)
    end_m = ways[:, :3] + distance[:, None] * ways[:, 3:]
    return Hits(
        np.full(len(hit), antenna), chosen[hit], face, end_m, distance + np.float32(OWN_SURFACE_M)
    )
