"""Shadows of a body, blurred by diffraction: the field of an antenna at points behind or next to
the body, relative to the field without it.

It is Kirchhoff's integral over an opaque screen before a spherical wave, as an integral along the
screen's outline (Maggi, Rubinowicz; Miyamoto & Wolf, J. Opt. Soc. Am. 52 (1962) 615). At small
angles, with δ the detour via the outline and φ its angle around the ray from antenna to point,

    D = V + (1/2π) Σ_edges ∫ e^{−jkδ} dφ,

where V is 1 in sight and 0 in the shadow. Where the ray crosses the outline, V jumps by 1 and ∫dφ
by 2π, so that D is smooth there: ½ at a straight edge, which gives ½ erfc(√(jkδ)) in the shadow,
Fresnel's knife edge.

An edge contributes if the antenna sees it, and only to points no farther than the surface that the
antenna sees right next to it: of two screens, one behind the other, only the common outline hides
points behind both. Left out are diffraction at two edges, waves that creep around round edges,
polarisation, and bends by more than some 40°.

D is smooth over points, antennas and frequency. It is computed at the vertices of the surface (at
the facets of coarse faces), for few antennas of each line and for three tones, and interpolated.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray
from handbench.radar.imaging.steering import cis_small
from handbench.radar.simulation.forward import Scatterers, Sight
from handbench.radar.simulation.meshes import face_vectors, unit
from handbench.radar.simulation.scene import Body, EchoScene
from handbench.support.compiled import FAST, INNER, njit
from handbench.support.errors import HandbenchError
from handbench.support.parallel import for_each
from handbench.support.rays import Rays

FARTHEST = 20.0  # kδ beyond which an edge is left out; its wave fades from half of it on
WIDEST = 1.0  # tangent of the angle of bending beyond which it is; the same
BESIDE_M = 2e-4  # distance from an edge to the ray that finds the surface behind it
THICK_M = 2e-3  # points up to this far behind the surface next to an edge count as that surface
CUBE_M = 0.012  # width of the cubes of points that share a list of edges
COARSE_M = 2e-3  # edges of a face beyond which the field is computed at each of its facets
FULL = 0.05  # smaller differences from full sight, or from none, are ignored
# constants of kernels, in their precision: float64 takes twice as long
ZERO, QUARTER, HALF, ONE, TWO, THREE = np.array([0, 0.25, 0.5, 1, 2, 3], np.float32)
TINY_M, TINY_M2 = np.array([1e-6, 1e-20], np.float32)
# arctan(x)/2πx in x²
T0, T1, T2, T3, T4 = np.array(
    [0.15915007, -0.05278828, 0.02946036, -0.01460251, 0.003784], np.float32
)
IN_SIGHT = np.array([1.0, 0.0, 0.0], np.complex64)[:, None]  # in a table of `Sight`


def shadowed(
    scene: EchoScene,
    hiding: Body,
    body: Body,
    facets: Scatterers,
    rays: Rays,
    array: AntennaArray,
    apart_m: float,
) -> tuple[Scatterers, np.ndarray]:
    """Return the facets of a body with the complex factors D by which the outlines of a body change
    the field of each antenna there, and a boolean mask [p] of the facets that at least one
    transmitter and one receiver reach.

    hiding: the body whose outlines diffract; body: the one that has the facets; rays: ray caster of
    all obstacles; apart_m: largest distance between the antennas of a line for which D is computed.
    """
    points_m, starts, corner, share = _samples(body, facets)
    edges = scene.cached(("edges", id(hiding)), lambda: edges_of(hiding))
    turns_per_m = scene.frequencies_hz / SPEED_OF_LIGHT_M_S
    middle = (turns_per_m.max() + turns_per_m.min()) / 2
    half = np.ptp(turns_per_m) / 2 + 1e-6 * turns_per_m.max()
    wavenumbers = 2 * np.pi * (middle + half * np.array([-1.0, 0.0, 1.0]))
    tables: list[np.ndarray] = []
    spreads: list[np.ndarray] = []
    for leg in array.legs:
        at, spread = _nodes(leg.position_m, apart_m)
        table = np.zeros((len(points_m), 3, len(at)), np.complex64)

        def work(node: int, at: np.ndarray = leg.position_m[at], table: np.ndarray = table) -> None:
            visible = rays.in_sight(points_m, at[node])
            outline = visible_outline(hiding, edges, rays, at[node])
            low, mid, high = edge_waves(at[node], points_m, starts, outline, wavenumbers)
            table[:, :, node] = np.stack(
                [visible + mid, (high - low) / 2, (high + low) / 2 - mid], axis=1
            )

        for_each(work, range(len(at)))
        tables.append(table)
        spreads.append(spread)
    reached = np.logical_and(*(_exceeds(table) for table in tables))
    partial = np.logical_or(*(_exceeds(table - IN_SIGHT) for table in tables))
    reached = reached[corner].any(axis=1)
    corner[~partial[corner].any(axis=1)] = -1
    detour_m = 0.75 * FARTHEST / wavenumbers[-1]  # whose wave has half faded
    beside = 1 / (4 * turns_per_m.max() * apart_m)  # waves from there turn by π/2 per node
    legs = (tables[0], tables[1]), (spreads[0], spreads[1])
    sight = Sight(corner, share, *legs, middle, half, detour_m, beside)
    return replace(facets, sight=sight), reached


def edges_of(body: Body) -> tuple[np.ndarray, np.ndarray]:
    """Return the edges of a body's mesh that two faces share: (indices [e, 4] of both vertices, in
    the order of the first face, and of both faces; plane [m, 4] of every face of the mesh: (n, d)
    with n·x > d in front of it, where n is not a unit vector).

    The rims of an open mesh are left out. Raises HandbenchError for a closed mesh with normals
    inwards."""
    # one number for each place: the sides of a box have corners of their own
    _, first, same = np.unique(body.vertices_m, axis=0, return_index=True, return_inverse=True)
    faces = first[same.reshape(-1)][body.faces]
    directed = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    low, high = np.sort(directed, axis=1).T.astype(np.int64)
    key = low * len(body.vertices_m) + high
    order = np.argsort(key, kind="stable")
    paired = np.flatnonzero(np.diff(key[order]) == 0)
    one, other = order[paired], order[paired + 1]
    vectors = face_vectors(body.vertices_m, body.faces)
    heights = (vectors * body.vertices_m[body.faces[:, 0]]).sum(axis=1)
    if 2 * len(paired) == len(directed) and heights.sum() < 0:  # 3 volumes
        raise HandbenchError("target: the normals of its mesh point inwards; turn its faces around")
    edges = np.column_stack([directed[one], one // 3, other // 3])
    return edges, np.column_stack([vectors, heights])


def visible_outline(
    body: Body, edges: tuple[np.ndarray, np.ndarray], rays: Rays, antenna_m: np.ndarray
) -> np.ndarray:
    """Return the outline of a body as seen from an antenna [3], which are the edges (`edges_of`)
    between a face turned towards it and one turned away, without those that the obstacles of `rays`
    hide: float32 [e, 7], metres from the antenna.

    An edge's middle and half of the vector from its start to its end, counter-clockwise around the
    body, are followed by the largest distance of points to which it diffracts: that of the surface
    that the antenna sees next to it.
    """
    sides, planes = edges
    front = planes @ [*antenna_m, -1.0] > 0
    first, second = front[sides[:, 2:]].T
    ends = np.concatenate([sides[first & ~second, :2], sides[second & ~first, 1::-1]])
    start_m, end_m = (body.vertices_m[ends[:, i]] - antenna_m for i in (0, 1))
    middle_m, half_m = (start_m + end_m) / 2, (end_m - start_m) / 2
    beside_m = middle_m + BESIDE_M * unit(np.cross(middle_m, half_m))
    distance_m = np.linalg.norm(beside_m, axis=1)
    origins_m = np.broadcast_to(antenna_m, beside_m.shape)
    hit_m, _ = rays.first_hits(origins_m, beside_m / distance_m[:, None])
    seen = hit_m > distance_m - THICK_M
    within_m = hit_m[seen].astype(float) + THICK_M
    return np.column_stack([middle_m[seen], half_m[seen], within_m]).astype(np.float32)


def cubes_of(points_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sort points [n, 3] into cubes of space: (their indices [n], cube by cube; where the points of
    each cube begin [cubes + 1])."""
    place = np.floor((points_m - points_m.min(axis=0)) / CUBE_M).astype(int)
    key = np.ravel_multi_index(place.T, tuple(place.max(axis=0) + 1))
    order = np.argsort(key, kind="stable")
    return order, np.flatnonzero(np.diff(key[order], prepend=-1, append=-2))


def edge_waves(
    antenna_m: np.ndarray,
    points_m: np.ndarray,
    starts: np.ndarray,
    outline: np.ndarray,
    wavenumbers: np.ndarray,
) -> np.ndarray:
    """Compute the field that the edges of an outline diffract to points, over the field of the
    antenna there without obstacles: (1/2π) Σ ∫ e^{−jkδ} dφ, complex64 [k, n], for each wavenumber
    [k]. Amplitudes are those at the middle wavenumber.

    points_m [n, 3]: sorted by cubes, of which each begins at starts [cubes + 1] (`cubes_of`);
    outline [e, 7]: of `visible_outline`.
    """
    waves = np.zeros((2, len(wavenumbers), len(points_m)), np.float32)
    ways_m = np.ascontiguousarray((points_m - antenna_m).T, np.float32)
    # of the cubes: NumPy takes no time for what takes seconds to compile
    sizes = np.diff(starts)
    centres_m = np.add.reduceat(ways_m, starts[:-1], axis=1) / sizes
    off_m = ways_m - np.repeat(centres_m, sizes, axis=1)
    radii_m = np.sqrt(np.maximum.reduceat((off_m**2).sum(axis=0), starts[:-1]))
    kept = np.empty((2, len(points_m)), np.float32)
    cubes = np.column_stack([centres_m.T, radii_m])
    _waves(ways_m, starts, cubes, outline, wavenumbers, wavenumbers.mean(), *kept, waves)
    return np.asarray(waves[0] + np.complex64(1j) * waves[1])


@njit(**FAST)
def _waves(  # type: ignore[no-untyped-def]
    ways_m, starts, cubes, edges_m, wavenumbers, wavenumber, amplitude, detour_m, waves
):
    """Add the field that edges diffract to points to `waves` [2, k, n] (real, imaginary part), cube
    by cube (centre and radius: cubes [cubes, 4]), with only those edges that matter for some point
    of the cube. amplitude, detour_m [n]: overwritten."""
    for cube in range(len(cubes)):
        here = slice(starts[cube], starts[cube + 1])
        x, y, z = ways_m[0, here], ways_m[1, here], ways_m[2, here]
        for e in range(len(edges_m)):
            if not _near(edges_m[e], cubes[cube], FARTHEST / wavenumber):
                continue
            _edge(x, y, z, edges_m[e], wavenumber, amplitude, detour_m)
            for k in range(len(wavenumbers)):
                turns = np.float32(wavenumbers[k] / (2 * np.pi))
                re, im = waves[0, k, here], waves[1, k, here]
                for p in range(len(re)):
                    cosine, sine = cis_small(turns * detour_m[p])
                    re[p] += amplitude[p] * cosine
                    im[p] -= amplitude[p] * sine


@njit(**INNER)
def _near(edge_m, cube, latest_m):  # type: ignore[no-untyped-def]
    """Return whether an edge matters for some point of a cube (centre, radius): whether it bends
    the ray to it by a tangent of at most WIDEST, and lengthens it by at most latest_m."""
    square_m2, before_m, length_m2 = 0.0, 0.0, 0.0
    for i in range(3):
        square_m2 += edge_m[i] * edge_m[i]
        before_m += edge_m[i] * cube[i]
        length_m2 += cube[i] * cube[i]
    length_m, radius_m = math.sqrt(length_m2), cube[3]
    before_m /= length_m
    behind_m = length_m + radius_m - before_m
    off_m = max(math.sqrt(max(square_m2 - before_m * before_m, 0.0)) - radius_m, 0.0)
    wide = (before_m <= 0) | (behind_m <= 0) | (off_m > WIDEST * behind_m)
    return not wide and off_m * off_m <= latest_m * (latest_m + 2 * behind_m)


@njit(**INNER)
def _edge(  # type: ignore[no-untyped-def]
    x_m, y_m, z_m, edge_m, wavenumber, amplitude, detour_m
):
    """Compute the wave of one edge at n points: its amplitude [n], which is the angle of the edge
    around the ray, over 2π, and its detour [n].

    x_m, y_m, z_m [n]: the points as seen from the antenna; edge_m [7]: a row of the outline. The
    amplitude is smaller where the phase differs between start and end, and 0 where the edge does
    not count.
    """
    mx, my, mz = edge_m[0], edge_m[1], edge_m[2]
    hx, hy, hz = edge_m[3], edge_m[4], edge_m[5]
    nx, ny, nz = TWO * (hy * mz - hz * my), TWO * (hz * mx - hx * mz), TWO * (hx * my - hy * mx)
    far_m = math.sqrt(mx * mx + my * my + mz * mz)
    inverse, half_m2 = ONE / far_m, hx * hx + hy * hy + hz * hz
    sixth = np.float32(wavenumber / math.sqrt(6.0))
    late, wide = np.float32(wavenumber / FARTHEST), np.float32(1 / WIDEST)
    for p in range(len(x_m)):
        x, y, z = x_m[p], y_m[p], z_m[p]
        way_m = math.sqrt(x * x + y * y + z * z)
        x, y, z = x / way_m, y / way_m, z / way_m
        before_m, half_along_m = mx * x + my * y + mz * z, hx * x + hy * y + hz * z
        ox, oy, oz = mx - before_m * x, my - before_m * y, mz - before_m * z
        off_m2 = ox * ox + oy * oy + oz * oz
        off_m, behind_m = math.sqrt(off_m2), max(way_m - before_m, TINY_M)
        close_m = math.sqrt(behind_m * behind_m + off_m2)
        detour_m[p] = off_m2 / (far_m + before_m) + off_m2 / (close_m + behind_m)
        uneven = sixth * (ox * hx + oy * hy + oz * hz) * (inverse + ONE / close_m)
        weight = _fade(wide * off_m / behind_m) * _fade(late * detour_m[p])
        weight /= ONE + uneven * uneven  # sin(x)/x of half the difference of phase
        turns = _turns(nx * x + ny * y + nz * z, off_m2 - half_m2 + half_along_m * half_along_m)
        amplitude[p] = turns * weight if way_m < edge_m[6] + off_m else ZERO


@njit(inline="always")
def _turns(y, x):  # type: ignore[no-untyped-def]
    """Return arctan2(y, x) / 2π, float32, within 1e-6."""
    low, high = min(abs(x), abs(y)), max(abs(x), abs(y))
    s = low / max(high, TINY_M2)
    q = s * s
    turns = s * (T0 + q * (T1 + q * (T2 + q * (T3 + q * T4))))
    turns = QUARTER - turns if abs(y) > abs(x) else turns
    turns = HALF - turns if x < ZERO else turns
    return -turns if y < ZERO else turns


@njit(inline="always")
def _fade(x):  # type: ignore[no-untyped-def]
    """Return 1 for x ≤ ½, 0 for x ≥ 1, and a smooth step in between."""
    t = min(max(x + x - ONE, ZERO), ONE)
    return ONE - t * t * (THREE - t - t)


def _exceeds(table: np.ndarray) -> np.ndarray:
    """Return a boolean mask [s], True for points of a table [s, 3, nodes] at which some complex
    coefficient exceeds FULL in magnitude."""
    return np.asarray((abs(table) > FULL).any(axis=(1, 2)))


def _nodes(antennas_m: np.ndarray, apart_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Choose antennas evenly along each line, both ends and others at most apart_m apart: (their
    indices, weights float32 [a, nodes] that interpolate values at them to all antennas [a, 3] by
    cubic splines). A new line begins at a step longer than twice the median step."""
    steps_m = np.linalg.norm(np.diff(antennas_m, axis=0, prepend=antennas_m[:1]), axis=1)
    begins = np.flatnonzero(steps_m > 2 * np.median(steps_m))
    steps_m[begins] = 0
    chosen: list[int] = []
    spread = np.zeros((len(antennas_m), len(antennas_m)), np.float32)
    for line in np.split(np.arange(len(antennas_m)), begins):
        along_m = steps_m[line].cumsum()
        count = min(len(line), 1 + int(np.ceil(along_m[-1] / apart_m)))
        at = np.linspace(0, len(line) - 1, count).round().astype(int)
        at = at[np.unique(along_m[at], return_index=True)[1]]  # one antenna a place
        count = len(at)
        weights = CubicSpline(along_m[at], np.eye(count))(along_m) if count > 1 else 1.0
        spread[line, len(chosen) : len(chosen) + count] = weights
        chosen += line[at].tolist()
    return np.array(chosen), np.ascontiguousarray(spread[:, : len(chosen)])


def _samples(body: Body, facets: Scatterers) -> tuple[np.ndarray, ...]:
    """Choose the points at which D is computed: the vertices of the faces that have facets, and the
    facets of faces with edges longer than COARSE_M.

    Returns the points [s, 3] sorted by cubes, where each cube begins (`cubes_of`), and for each
    facet the indices of three points around it, int32 [p, 3], and its barycentric coordinates
    between them, float32 [p, 3].
    """
    corner = body.faces[facets.face]
    corners_m = body.vertices_m[corner]
    edges_m = np.linalg.norm(corners_m - np.roll(corners_m, 1, axis=1), axis=2).max(axis=1)
    coarse = np.flatnonzero(edges_m > COARSE_M)
    corner[coarse] = len(body.vertices_m) + coarse[:, None]
    places_m = np.concatenate([body.vertices_m, facets.position_m])
    used, corner = np.unique(corner, return_inverse=True)
    order, starts = cubes_of(places_m[used])
    corner = np.argsort(order)[corner].astype(np.int32)
    return places_m[used[order]], starts, corner, np.asarray(facets.share, np.float32)
