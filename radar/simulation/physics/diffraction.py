"""Diffraction at the outlines of a body: the field of an antenna at points behind or next to the
body, relative to the field without it.

It is Kirchhoff's integral over an opaque screen before a spherical wave, as an integral along the
screen's outline (Maggi, Rubinowicz; Miyamoto & Wolf, J. Opt. Soc. Am. 52 (1962) 615). At small
angles, with δ the detour via the outline and φ its angle around the ray from antenna to point,

    D = V + (1/2π) Σ_edges ∫ e^{−jkδ} dφ,

where V is 1 in sight and 0 in the shadow. Where the ray crosses the outline, V jumps by 1 and ∫dφ
by 2π, so that D is smooth there: ½ at a straight edge, which gives ½ erfc(√(jkδ)) in the shadow,
Fresnel's knife edge.

An edge contributes if the antenna sees it, and only to points no farther than the surface that the
antenna sees right next to it: of two screens, one behind the other, only the common outline hides
points behind both.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from handbench.radar.imaging.cpu.steering import cis_small
from handbench.radar.simulation.physics.creeping import DEEP, LIT, SHARP, TERMS, Roundness
from handbench.radar.simulation.physics.facets import face_vectors, unit
from handbench.radar.simulation.scene import Body, EchoScene
from handbench.support.compiled import FAST, INNER, njit
from handbench.support.rays import Rays

FARTHEST = 20.0  # kδ beyond which an edge is left out
WIDEST = 1.0  # and tangent of the angle by which it bends a ray: the formula is of small angles
BESIDE_M = 2e-4  # distance from an edge to the ray that finds the surface behind it
THICK_M = 2e-3  # points up to this far behind the surface next to an edge count as that surface
# arctan(x)/2πx in x²
T0, T1, T2, T3, T4 = map(np.float32, (0.15915007, -0.05278828, 0.02946036, -0.01460251, 0.003784))


class Edges(NamedTuple):
    """The edges of a body's mesh, each between two faces.

    ends [e, 2]: indices of vertices, in the order of the first face; faces [e, 2]: indices of the
    two faces; outwards [e, 3]: mean direction of both faces' normals; sharp [e]: whether the faces
    meet at such an angle that the edge diffracts like a knife; planes [m, 4]: plane (n, d) of every
    face of the mesh, with n·x > d in front of it.
    """

    ends: np.ndarray
    faces: np.ndarray
    outwards: np.ndarray
    sharp: np.ndarray
    planes: np.ndarray


class Outline(NamedTuple):
    """The outline of a body as an antenna sees it: the edges between a face turned towards the
    antenna and one turned away.

    start_m [n, 3]: starts of the edges; along_m [n, 3]: vectors from start to end,
    counter-clockwise as the antenna sees the body; beside_m [n, 3]: points just outside the edges;
    within_m [n]: largest distance from the antenna of points to which an edge diffracts; creeping
    [n, 17]: parameters of creeping waves, from `Roundness.of_edges`.
    """

    start_m: np.ndarray
    along_m: np.ndarray
    beside_m: np.ndarray
    within_m: np.ndarray
    creeping: np.ndarray

    def where(self, chosen: np.ndarray, within_m: np.ndarray | float = np.inf) -> Outline:
        """Return the outline with only the edges where the mask `chosen` [n] is True. within_m [n]:
        new limits of the distance from the antenna up to which the edges diffract."""
        limits_m = np.broadcast_to(within_m, len(chosen))[chosen]
        return Outline(
            self.start_m[chosen],
            self.along_m[chosen],
            self.beside_m[chosen],
            limits_m,
            self.creeping[chosen],
        )


class PointCells(NamedTuple):
    """n points sorted into cubes of space.

    order [n]: the points' original indices, cube by cube; position_m [3, n]: their positions
    relative to the centre of their cube, in this order; starts [cubes + 1]: where the points of
    each cube begin; centre_m [cubes, 3]: mean of a cube's points; radius_m [cubes]: their largest
    distance from it.
    """

    order: np.ndarray
    position_m: np.ndarray
    starts: np.ndarray
    centre_m: np.ndarray
    radius_m: np.ndarray


def edges_of(body: Body) -> Edges:
    """Return the edges of a body's mesh that two faces share. The rims of an open mesh are left
    out."""
    directed = body.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    order = np.lexsort(np.sort(directed, axis=1).T)
    low, high = np.sort(directed[order], axis=1).T
    # rims of an open mesh are left out
    paired = np.flatnonzero((low[1:] == low[:-1]) & (high[1:] == high[:-1]))
    one, other = order[paired], order[paired + 1]
    faces = np.stack([one, other], axis=1) // 3
    normals = unit(face_vectors(body.vertices_m, body.faces))
    planes = np.column_stack([normals, (normals * body.vertices_m[body.faces[:, 0]]).sum(axis=1)])
    outwards = normals[faces].sum(axis=1)
    sharp = (outwards**2).sum(axis=1) < 2 * (1 + SHARP)
    return Edges(directed[one], faces, unit(outwards), sharp, planes)


def cached_edges(scene: EchoScene, body: Body) -> Edges:
    """Return the edges of a body's mesh, computed once per scene."""
    return scene.cached(("edges", id(body)), lambda: edges_of(body))


def outline(
    body: Body, edges: Edges, antenna_m: np.ndarray, roundness: Roundness | None = None
) -> Outline:
    """Return the whole outline of a body as seen from an antenna [3], including parts that are
    hidden from it. roundness: curvature of the body, for creeping waves; with None, all edges
    diffract like knife edges."""
    front = edges.planes @ [*antenna_m, -1.0] > 0
    first, second = front[edges.faces].T
    ends = np.concatenate([edges.ends[first & ~second], edges.ends[second & ~first][:, ::-1]])
    outwards = np.concatenate([edges.outwards[first & ~second], edges.outwards[second & ~first]])
    start_m, end_m = (body.vertices_m[ends[:, i]] for i in (0, 1))
    middle_m = (start_m + end_m) / 2
    towards = unit(middle_m - antenna_m)
    across = unit(outwards - (outwards * towards).sum(axis=1)[:, None] * towards)
    along_m, creeping = end_m - start_m, np.zeros((len(ends), 5 + 2 * TERMS), np.float32)
    if roundness is not None:
        sharp = np.concatenate([edges.sharp[first & ~second], edges.sharp[second & ~first]])
        creeping = roundness.of_edges(ends, along_m, towards, sharp)
    return Outline(
        start_m, along_m, middle_m + BESIDE_M * across, np.full(len(ends), np.inf), creeping
    )


def visible_outline(whole: Outline, rays: Rays, antenna_m: np.ndarray) -> Outline:
    """Return only those edges of an outline that the antenna [3] sees past the obstacles of `rays`.
    Each of them is limited to diffract only to points no farther away than the surface that the
    antenna sees next to it."""
    beside_m = whole.beside_m - antenna_m
    distance_m = np.linalg.norm(beside_m, axis=1)
    hit, _ = rays.first_hits(
        np.broadcast_to(antenna_m, beside_m.shape), beside_m / distance_m[:, None]
    )
    return whole.where(hit > distance_m - THICK_M, hit + THICK_M)


def cells_of(points_m: np.ndarray, cell_m: float) -> PointCells:
    """Sort points [n, 3] into cubes of space with the width cell_m. All points of a cube then share
    one list of the edges that diffract to them."""
    place = np.floor((points_m - points_m.min(axis=0)) / cell_m).astype(int)
    key = np.ravel_multi_index(place.T, tuple(place.max(axis=0) + 1))
    order = np.argsort(key, kind="stable")
    starts = np.flatnonzero(np.diff(key[order], prepend=-1, append=-2))
    sorted_m = points_m[order]
    centre_m = np.add.reduceat(sorted_m, starts[:-1]) / np.diff(starts)[:, None]
    off_m = sorted_m - np.repeat(centre_m, np.diff(starts), axis=0)
    radius_m = np.sqrt(np.maximum.reduceat((off_m**2).sum(axis=1), starts[:-1]))
    return PointCells(order, np.ascontiguousarray(off_m.T), starts, centre_m, radius_m)


def edge_waves(
    antenna_m: np.ndarray,
    cells: PointCells,
    edges: Outline,
    wavenumbers: np.ndarray,
    farthest: float = FARTHEST,
    widest: float = WIDEST,
) -> np.ndarray:
    """Compute the field that the edges of an outline diffract to points, over the field of the
    antenna there without obstacles: complex64 [k, n], for each wavenumber [k], in the original
    order of the points. It is (1/2π) Σ ∫ e^{−jkδ} dφ, plus creeping waves.

    farthest, widest: limits of kδ (δ: detour via the edge) and of the tangent of the angle by which
    the edge bends the ray; waves fade out from half of a limit to the limit. Amplitudes are those
    at the middle wavenumber.
    """
    waves = np.zeros((2, len(wavenumbers), len(cells.order)), np.float32)
    if len(edges.start_m) > 0:
        start_m, middle = (
            edges.start_m - antenna_m,
            float(wavenumbers.min() + wavenumbers.max()) / 2,
        )
        places = (
            start_m,
            edges.along_m,
            np.cross(edges.along_m, start_m),
            edges.within_m,
            edges.creeping,
        )
        limits = farthest, widest, LIT, DEEP
        _waves(antenna_m, *cells[1:], places, wavenumbers / (2 * np.pi), middle, limits, waves)
    found = np.empty(waves.shape[1:], np.complex64)
    found[:, cells.order] = waves[0] + np.complex64(1j) * waves[1]
    return found


@njit(**FAST)
def _waves(  # type: ignore[no-untyped-def]
    antenna_m, position_m, starts, centre_m, radius_m, edges, turns_per_m, wavenumber, limits, waves
):
    """Compute the field that edges diffract to points, cube by cube, with only those edges that
    matter for the points of the cube. It is written to `waves` [2, k, n] (real, imaginary part).

    edges: (start_m, along_m, along × start, limits of the distance, creeping parameters), all
    relative to the antenna; limits: (of kδ, of the bend's tangent, least and largest argument of
    creeping waves).
    """
    start_m, along_m, normal_m2, within_m, creeping = edges
    farthest, widest, lit, deep = limits
    middle_m, latest_m, near = (
        start_m + along_m / 2,
        farthest / wavenumber,
        np.empty(len(start_m), np.bool_),
    )
    middles = np.ascontiguousarray(middle_m.T.astype(np.float32)), within_m.astype(np.float32)
    scratch, points = (
        np.empty((5, (starts[1:] - starts[:-1]).max()), np.float32),
        position_m.astype(np.float32),
    )
    for cell in range(len(starts) - 1):
        here, centre = slice(starts[cell], starts[cell + 1]), centre_m[cell] - antenna_m
        x, y, z = points[0, here], points[1, here], points[2, here]
        _near(near, middles, centre, radius_m[cell], widest, latest_m)
        for e in np.flatnonzero(near):
            edge = start_m[e], along_m[e], normal_m2[e], within_m[e]
            _angles(scratch, x, y, z, centre, edge, widest, wavenumber, farthest)
            if creeping[e, 3] > 0:
                _creep(scratch, x, y, z, middle_m[e] - centre, creeping[e], wavenumber, lit, deep)
            for k in range(len(turns_per_m)):
                _add(waves[0, k, here], waves[1, k, here], scratch, turns_per_m[k])
    return waves


@njit(**INNER)
def _near(near, middles, centre, radius_m, widest, latest_m):  # type: ignore[no-untyped-def]
    """Set `near` [e] to True for the edges that matter for some point of a cube (centre, radius_m):
    those that bend the ray to it by a tangent of at most `widest` and lengthen it by at most
    latest_m."""
    (mx, my, mz), within_m = middles[0], middles[1]
    way = np.float32(np.sqrt((centre * centre).sum()))
    cx, cy, cz = (
        np.float32(centre[0]) / way,
        np.float32(centre[1]) / way,
        np.float32(centre[2]) / way,
    )
    radius, wide, latest, zero = (
        np.float32(radius_m),
        np.float32(widest),
        np.float32(latest_m),
        np.float32(0),
    )
    for e in range(len(near)):
        before = mx[e] * cx + my[e] * cy + mz[e] * cz
        behind = way + radius - before
        off = np.sqrt(max(mx[e] * mx[e] + my[e] * my[e] + mz[e] * mz[e] - before * before, zero))
        past = max(off - radius, zero)
        bent = (past > wide * behind) | (past * past > latest * (latest + np.float32(2) * behind))
        near[e] = (
            (behind > zero) & (before > zero) & ~bent & (way - radius < within_m[e] + off + radius)
        )


@njit(**INNER)
def _angles(  # type: ignore[no-untyped-def]
    scratch, x, y, z, centre, edge, widest, wavenumber, farthest
):
    """Compute the contribution of one edge to each of n points (x, y, z relative to the cube's
    centre), and write it to `scratch` [5, n].

    The rows are: the angle of the edge around the ray, over 2π, times the weight of its wave; 0;
    the detour via the edge; the weight; and 1/L, the sum of the inverse lengths before and behind
    the edge. The weight is smaller where the phase differs between the ends of the edge, and 0
    where the edge does not count.
    """
    start, along, normal, within = edge
    cx, cy, cz = np.float32(centre[0]), np.float32(centre[1]), np.float32(centre[2])
    ax, ay, az = (
        np.float32(start[0] - centre[0]),
        np.float32(start[1] - centre[1]),
        np.float32(start[2] - centre[2]),
    )
    tx, ty, tz = np.float32(along[0]), np.float32(along[1]), np.float32(along[2])
    nx, ny, nz = np.float32(normal[0]), np.float32(normal[1]), np.float32(normal[2])
    limit, length, wide = np.float32(within), tx * tx + ty * ty + tz * tz, np.float32(widest)
    zero, one, two, half, tiny = (
        np.float32(0),
        np.float32(1),
        np.float32(2),
        np.float32(0.5),
        np.float32(1e-20),
    )
    late, turned = np.float32(2 * wavenumber / farthest), np.float32(wavenumber * wavenumber / 6)
    for p in range(len(x)):
        dx, dy, dz = cx + x[p], cy + y[p], cz + z[p]
        px, py, pz = ax - x[p], ay - y[p], az - z[p]
        way = np.sqrt(dx * dx + dy * dy + dz * dz)
        inverse = one / way
        dx, dy, dz = dx * inverse, dy * inverse, dz * inverse
        pd, td = px * dx + py * dy + pz * dz, tx * dx + ty * dy + tz * dz
        pp, pt, tt = (
            px * px + py * py + pz * pz - pd * pd,
            px * tx + py * ty + pz * tz - pd * td,
            length - td * td,
        )
        behind = max(-pd - half * td, np.float32(1e-6))
        before = max(way - behind, np.float32(1e-6))
        square = max(pp + pt + half * half * tt, zero)
        off = np.sqrt(square)
        far, close = np.sqrt(before * before + square), np.sqrt(behind * behind + square)
        detour = square / (far + before) + square / (close + behind)
        spread = one / far + one / close
        rise = half * (pt + half * tt) * spread
        wide_fade = max(two * min(off / behind / wide, one) - one, zero)
        late_fade = min(max(detour * late - one, zero), one)
        weight = one - wide_fade * wide_fade * (one + two * (one - wide_fade))
        weight *= (one - late_fade * late_fade * (one + two * (one - late_fade))) / (
            one + turned * rise * rise
        )
        sine, cosine = dx * nx + dy * ny + dz * nz, pp + pt
        s = min(abs(cosine), abs(sine)) / max(max(abs(cosine), abs(sine)), tiny)
        q = s * s
        turn = s * (T0 + q * (T1 + q * (T2 + q * (T3 + q * T4))))
        turn = half * half - turn if abs(sine) > abs(cosine) else turn
        turn = half - turn if cosine < zero else turn
        weight = weight if way < limit + off else zero
        scratch[0, p] = (-turn if sine < zero else turn) * weight
        scratch[1, p] = zero
        scratch[2, p] = detour
        scratch[3, p] = weight
        scratch[4, p] = spread


@njit(**INNER)
def _creep(  # type: ignore[no-untyped-def]
    scratch, x, y, z, middle, creeping, wavenumber, least, most
):
    """Add the waves that creep around one edge to the wave of this edge at n points, which have the
    coordinates x, y, z relative to the cube's centre.

    The wave is stored in `scratch` [5, n]: real and imaginary amplitude, detour, weight, 1/L.
    middle: the edge's middle relative to the same centre; creeping: parameters of the edge's
    creeping wave, a row of `Roundness.of_edges`.
    """
    mx, my, mz = np.float32(middle[0]), np.float32(middle[1]), np.float32(middle[2])
    nx, ny, nz, size, nearest = creeping[0], creeping[1], creeping[2], creeping[3], creeping[4]
    r0, r1, r2, r3, r4, r5 = (
        creeping[5],
        creeping[6],
        creeping[7],
        creeping[8],
        creeping[9],
        creeping[10],
    )
    i0, i1, i2, i3, i4, i5 = (
        creeping[11],
        creeping[12],
        creeping[13],
        creeping[14],
        creeping[15],
        creeping[16],
    )
    low, high, arc = np.float32(least), np.float32(most), np.float32(1 / (3 * wavenumber))
    one, two, six = np.float32(1), np.float32(2), np.float32(1 / 6)
    for p in range(len(x)):
        px, py, pz = mx - x[p], my - y[p], mz - z[p]
        close = np.sqrt(px * px + py * py + pz * pz)
        sine = (px * nx + py * ny + pz * nz) / max(close, np.float32(1e-6))
        bend = size * sine * (one + six * sine * sine)
        xi = min(max(bend, low), high)
        lit = min(two - two * xi / low, one)
        lit = lit * lit * (one + two * (one - lit))
        weight = scratch[3, p] * min(scratch[4, p], nearest) * lit
        scratch[0, p] += weight * (r0 + xi * (r1 + xi * (r2 + xi * (r3 + xi * (r4 + xi * r5)))))
        scratch[1, p] += weight * (i0 + xi * (i1 + xi * (i2 + xi * (i3 + xi * (i4 + xi * i5)))))
        scratch[2, p] += lit * arc * xi * xi * xi


@njit(**INNER)
def _add(re, im, scratch, turns_per_m):  # type: ignore[no-untyped-def]
    """Add the wave of one edge at one tone to the fields at the points, with real part `re` and
    imaginary part `im` [n]. turns_per_m: k/2π."""
    scale = np.float32(turns_per_m)
    for p in range(len(re)):
        cosine, sine = cis_small(scale * scratch[2, p])
        re[p] += scratch[0, p] * cosine + scratch[1, p] * sine
        im[p] += scratch[1, p] * cosine - scratch[0, p] * sine
