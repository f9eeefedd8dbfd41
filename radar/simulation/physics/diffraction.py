"""Diffraction at the outlines of a body: how much of an antenna's field reaches a point behind or beside it.

Kirchhoff's integral over an opaque screen before a spherical wave, as an integral along the screen's outline (Maggi,
Rubinowicz; Miyamoto & Wolf, J. Opt. Soc. Am. 52 (1962) 615). At small angles, with δ the detour by way of the outline
and φ its angle around the ray from antenna to point,

    D = V + (1/2π) Σ_edges ∫ e^{−jkδ} dφ,

where V is 1 in sight and 0 in the shadow. The jump of V where the ray crosses the outline is that of ∫dφ by 2π: D is
smooth there, ½ beside a straight edge, which gives ½ erfc(√(jkδ)) in the shadow: Fresnel's knife edge.

An edge counts where the antenna sees it, and for what lies no farther than what the antenna sees right beside it: of
two screens, one behind the other, only the outline of both together hides what is behind both.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from radar.imaging.cpu.steering import FAST, cis_small
from radar.simulation.physics.facets import face_vectors, unit
from radar.simulation.scene import Body, EchoScene
from radar.support.rays import Rays

FARTHEST = 20.0  # kδ beyond which an edge is left out
WIDEST = 1.0  # and tangent of the angle by which it bends a ray: the formula is of small angles
BESIDE_M = 2e-4  # from an edge to the ray that tells what is behind it
THICK_M = 2e-3  # what lies less than this behind what is seen beside an edge still counts as that
T0, T1, T2, T3, T4 = map(
    np.float32, (0.15915007, -0.05278828, 0.02946036, -0.01460251, 0.003784)
)  # arctan(x)/2πx in x²
CELL_M = 6e-3  # of points that are asked together which edges they need


class Edges(NamedTuple):
    """Inner edges of a body: ends [e, 2] of vertices, in the order in which the first of both faces [e, 2] has them;
    outwards [e, 3]: the mean of both faces' normals."""

    ends: np.ndarray
    faces: np.ndarray
    outwards: np.ndarray


class Outline(NamedTuple):
    """Edges start_m [n, 3] + along_m [n, 3] between a face that an antenna sees from the front and one that it sees
    from behind, counter-clockwise around what hides, as the antenna sees it; beside_m [n, 3]: points right beside them,
    not hidden by their own faces; within_m [n]: how far from the antenna what they count for may lie."""

    start_m: np.ndarray
    along_m: np.ndarray
    beside_m: np.ndarray
    within_m: np.ndarray

    def where(self, chosen: np.ndarray, within_m: np.ndarray | float = np.inf) -> Outline:
        """Some of the edges, by mask [n], and how far away what all [n] count for may lie."""
        limits_m = np.broadcast_to(within_m, len(chosen))[chosen]
        return Outline(self.start_m[chosen], self.along_m[chosen], self.beside_m[chosen], limits_m)


class Cells(NamedTuple):
    """Points position_m [3, n] in cells: their order [n], starts [cells + 1]; centre_m [cells, 3], radius_m [cells]."""

    position_m: np.ndarray
    order: np.ndarray
    starts: np.ndarray
    centre_m: np.ndarray
    radius_m: np.ndarray


def edges_of(body: Body) -> Edges:
    """The edges of a body whose mesh is closed."""
    directed = body.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    order = np.lexsort(np.sort(directed, axis=1).T)
    low, high = np.sort(directed[order], axis=1).T
    paired = np.flatnonzero((low[1:] == low[:-1]) & (high[1:] == high[:-1]))  # rims of an open mesh are left out
    one, other = order[paired], order[paired + 1]
    faces = np.stack([one, other], axis=1) // 3
    normals = unit(face_vectors(body.vertices_m, body.faces))
    return Edges(directed[one], faces, unit(normals[faces].sum(axis=1)))


def kept_edges(scene: EchoScene, body: Body) -> Edges:
    """A body's edges, found once per scene."""
    return scene.kept(("edges", id(body)), lambda: edges_of(body))


def outline(body: Body, edges: Edges, antenna_m: np.ndarray) -> Outline:
    """The whole outline of a body towards an antenna, with what the body itself hides of it."""
    corners_m = body.vertices_m[body.faces[:, 0]]
    front = (face_vectors(body.vertices_m, body.faces) * (antenna_m - corners_m)).sum(axis=1) > 0
    first, second = front[edges.faces].T
    ends = np.concatenate([edges.ends[first & ~second], edges.ends[second & ~first][:, ::-1]])
    outwards = np.concatenate([edges.outwards[first & ~second], edges.outwards[second & ~first]])
    start_m, end_m = (body.vertices_m[ends[:, i]] for i in (0, 1))
    middle_m = (start_m + end_m) / 2
    towards = unit(middle_m - antenna_m)
    across = unit(outwards - (outwards * towards).sum(axis=1)[:, None] * towards)
    return Outline(start_m, end_m - start_m, middle_m + BESIDE_M * across, np.full(len(ends), np.inf))


def seen_outline(whole: Outline, rays: Rays, antenna_m: np.ndarray) -> Outline:
    """The part that the antenna sees, against what `rays` meet."""
    beside_m = whole.beside_m - antenna_m
    distance_m = np.linalg.norm(beside_m, axis=1)
    hit, _ = rays.first_hits(np.broadcast_to(antenna_m, beside_m.shape), beside_m / distance_m[:, None])
    return whole.where(hit > distance_m - THICK_M, hit + THICK_M)


def cells_of(points_m: np.ndarray) -> Cells:
    """Points [n, 3] by cells."""
    place = np.floor((points_m - points_m.min(axis=0)) / CELL_M).astype(int)
    key = np.ravel_multi_index(place.T, tuple(place.max(axis=0) + 1))
    order = np.argsort(key, kind="stable")
    starts = np.flatnonzero(np.diff(key[order], prepend=-1, append=-2))
    sorted_m = points_m[order]
    centre_m = np.add.reduceat(sorted_m, starts[:-1]) / np.diff(starts)[:, None]
    off_m = np.linalg.norm(sorted_m - np.repeat(centre_m, np.diff(starts), axis=0), axis=1)
    return Cells(np.ascontiguousarray(sorted_m.T), order, starts, centre_m, np.maximum.reduceat(off_m, starts[:-1]))


def edge_waves(
    antenna_m: np.ndarray,
    cells: Cells,
    edges: Outline,
    wavenumbers: np.ndarray,
    farthest: float = FARTHEST,
    widest: float = WIDEST,
) -> np.ndarray:
    """(1/2π) Σ ∫ e^{−jkδ} dφ at the points for each wavenumber [k]: complex64 [k, n], in the points' own order. Waves
    fade from half of kδ = farthest on, and from half of the tangent `widest` of the angle by which they bend."""
    waves = np.zeros((2, len(wavenumbers), len(cells.order)), np.float32)
    if len(edges.start_m) > 0:
        start_m = edges.start_m - antenna_m
        places = start_m, edges.along_m, np.cross(edges.along_m, start_m), edges.within_m
        _waves(antenna_m, *cells[:1], *cells[2:], places, wavenumbers / (2 * np.pi), farthest, widest, waves)
    found = np.empty(waves.shape[1:], np.complex64)
    found[:, cells.order] = waves[0] + np.complex64(1j) * waves[1]
    return found


@numba.njit(**FAST)
def _waves(  # type: ignore[no-untyped-def]
    antenna_m, position_m, starts, centre_m, radius_m, edges, turns_per_m, farthest, widest, waves
):
    """Fill in waves [2, k, n] cell by cell, with the edges that the points of a cell need; places of edges are from the
    antenna, normal_m2 [e, 3] = along × start."""
    start_m, along_m, normal_m2, within_m = edges
    most = np.diff(starts).max()
    scratch, points = np.empty((4, most), np.float32), np.empty((7, most), np.float32)
    for cell in range(len(starts) - 1):
        begin, n = starts[cell], starts[cell + 1] - starts[cell]
        cx, cy, cz = (
            centre_m[cell, 0] - antenna_m[0],
            centre_m[cell, 1] - antenna_m[1],
            centre_m[cell, 2] - antenna_m[2],
        )
        way = np.sqrt(cx * cx + cy * cy + cz * cz)
        ux, uy, uz = cx / way, cy / way, cz / way
        ready = False
        for e in range(len(start_m)):
            tx, ty, tz = along_m[e, 0], along_m[e, 1], along_m[e, 2]
            mx, my, mz = start_m[e, 0] + tx / 2, start_m[e, 1] + ty / 2, start_m[e, 2] + tz / 2
            before = mx * ux + my * uy + mz * uz
            behind = way + radius_m[cell] - before
            if behind <= 0 or before <= 0:
                continue
            square = mx * mx + my * my + mz * mz - before * before
            reach = widest * behind + radius_m[cell]
            if square > reach * reach or way - radius_m[cell] > within_m[e] + np.sqrt(square) + radius_m[cell]:
                continue
            if not ready:
                _about(points, position_m[:, begin : begin + n], antenna_m, cx, cy, cz)
                ready = True
            near = (start_m[e, 0] - cx, start_m[e, 1] - cy, start_m[e, 2] - cz)
            _angles(scratch, points, n, near, along_m[e], normal_m2[e], within_m[e], widest)
            for k in range(len(turns_per_m)):
                _add(waves[0, k, begin : begin + n], waves[1, k, begin : begin + n], scratch, turns_per_m[k], farthest)
    return waves


@numba.njit(**FAST)
def _about(points, position_m, antenna_m, cx, cy, cz):  # type: ignore[no-untyped-def]
    """Points of a cell: from its centre [3], their directions from the antenna [3], and distance."""
    for p in range(position_m.shape[1]):
        dx, dy, dz = position_m[0, p] - antenna_m[0], position_m[1, p] - antenna_m[1], position_m[2, p] - antenna_m[2]
        points[0, p], points[1, p], points[2, p] = dx - cx, dy - cy, dz - cz
        distance = np.sqrt(dx * dx + dy * dy + dz * dz)
        points[3, p], points[4, p], points[5, p], points[6, p] = dx / distance, dy / distance, dz / distance, distance


@numba.njit(**FAST)
def _angles(scratch, points, n, near, along, normal, within, widest):  # type: ignore[no-untyped-def]
    """For an edge and each of n points: the edge's angle around the ray over 2π, 0 where it does not count; its detour;
    and half of the detours' difference between its ends."""
    ax, ay, az = np.float32(near[0]), np.float32(near[1]), np.float32(near[2])
    tx, ty, tz = np.float32(along[0]), np.float32(along[1]), np.float32(along[2])
    nx, ny, nz = np.float32(normal[0]), np.float32(normal[1]), np.float32(normal[2])
    limit, length = np.float32(within), tx * tx + ty * ty + tz * tz
    one, half, tiny, wide = np.float32(1), np.float32(0.5), np.float32(1e-20), np.float32(widest)
    for p in range(n):
        px, py, pz = ax - points[0, p], ay - points[1, p], az - points[2, p]
        dx, dy, dz, way = points[3, p], points[4, p], points[5, p], points[6, p]
        pd, td = px * dx + py * dy + pz * dz, tx * dx + ty * dy + tz * dz
        pp = px * px + py * py + pz * pz - pd * pd
        pt, tt = px * tx + py * ty + pz * tz - pd * td, length - td * td
        behind = max(-pd - half * td, np.float32(1e-6))
        before = max(way - behind, np.float32(1e-6))
        square = max(pp + pt + np.float32(0.25) * tt, np.float32(0))
        tilt = min(np.sqrt(square) / behind / wide, one)  # fades from half of the widest on
        fade = max(np.float32(2) * tilt - one, np.float32(0))
        counts = one - fade * fade * (np.float32(3) - np.float32(2) * fade)
        counts = counts if way < limit + np.sqrt(square) else np.float32(0)
        y, x = dx * nx + dy * ny + dz * nz, pp + pt
        low, high = min(abs(x), abs(y)), max(max(abs(x), abs(y)), tiny)
        s = low / high
        q = s * s
        turn = s * (T0 + q * (T1 + q * (T2 + q * (T3 + q * T4))))
        turn = np.float32(0.25) - turn if abs(y) > abs(x) else turn
        turn = half - turn if x < np.float32(0) else turn
        turn = -turn if y < np.float32(0) else turn
        far, close = np.sqrt(before * before + square), np.sqrt(behind * behind + square)
        scratch[0, p] = turn * counts
        scratch[1, p] = square / (far + before) + square / (close + behind)
        scratch[2, p] = (half * pt + np.float32(0.25) * tt) * (one / far + one / close)


@numba.njit(**FAST)
def _add(re, im, scratch, turns_per_m, farthest):  # type: ignore[no-untyped-def]
    """Add an edge's waves; the turn of the phase from one end to the other fades it by its sinc."""
    scale, one = np.float32(turns_per_m), np.float32(1)
    fades = np.float32(2 * np.pi * 2 * turns_per_m / farthest)
    turns = np.float32((2 * np.pi * turns_per_m) ** 2 / 6)
    for p in range(len(re)):
        detour, rise = scratch[1, p], scratch[2, p]
        late = min(max(detour * fades - one, np.float32(0)), one)
        amplitude = scratch[0, p] * (one - late * late * (np.float32(3) - np.float32(2) * late))
        amplitude /= one + turns * rise * rise
        cosine, sine = cis_small(scale * detour)
        re[p] += amplitude * cosine
        im[p] -= amplitude * sine
