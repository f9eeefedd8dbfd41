"""Quick estimates of the sizes of effects, without ray casting or random numbers.

The target's surface is divided into coarse facets. Their visibility is found by depth buffers with
one point per facet, and reflections onto other facets by stepping through a grid that stores the
facets' normals.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from handbench.radar.data.arrays import AntennaArray
from handbench.radar.simulation.physics.facets import Facets
from handbench.radar.simulation.scene import Body, EchoScene
from handbench.radar.simulation.scene_echoes import front_facets, require_facets
from handbench.support.compiled import njit

LONGEST = 0.5  # edge of coarse facets in wavelengths
CENTRE_M = np.zeros(3)  # of the aperture, in the radar frame
# phase error in rad between two tones per relative amplitude, mean over the pixels (measured on
# four hands: 0.10 to 0.22)
TURN = 0.15
CLEAR = 10.0  # factor by which an estimate may be wrong,
CLOSED = 3.0  # and one in closed form (at most 1.9 in 25 cases on 23 random scenes)
FACET_S, TONE_S = 2e-6, 3e-8  # CPU seconds of a coarse facet's echo, and of each tone in it
BUFFER_CELLS = 1 << 22  # at most
# tangent of incidence up to which the surface in a cell and an obstacle can be distinguished
STEEPEST = 6.0
CELL_M = 2e-3  # of the grid of normals
ZONES = 2.0  # Fresnel's radii √(λL) from an outline within which it counts
# height in wavelengths above a facet's plane below which an outline or a facet belongs to the same
# surface
HORIZON = 0.05
PAIRED = 500  # approximate number of facets that are compared in pairs
FIRST = 2.0  # cells from a facet to where its ray may meet another one
GRID_CELLS = 1 << 24  # at most
# width of the area in which returning rays are counted, relative to the aperture: a larger one has
# more rays
WIDE = 2.0


@dataclass(frozen=True)
class QuickEstimate:
    """An effect's size, from geometry or a closed formula within milliseconds.

    worst_mm: change of the depths of the method that the effect changes most; why: how it was
    estimated, in words; factor: by how many times the estimate may be too large or too small.
    """

    worst_mm: float
    why: str
    factor: float = CLEAR

    @classmethod
    def of_level(
        cls, scene: EchoScene, ratio: float, why: str, factor: float = CLEAR
    ) -> QuickEstimate:
        """Estimate the change of depth by echoes whose amplitude is `ratio` times that of the
        target's echoes. why: how the ratio was found, in words; factor: by how many times it may be
        wrong."""
        turned_rad = min(TURN * ratio, np.pi / 2)
        return cls(1e3 * scene.depth_m_per_rad * scene.strictness * turned_rad, why, factor)


def echo_s(scene: EchoScene) -> float:
    """Estimate the CPU seconds that the target's echoes take without any effect."""
    count = 0 if scene.target is None else 4 * len(coarse_surface(scene, scene.body))
    return 0.05 + count * (FACET_S + TONE_S * len(scene.frequencies_hz))


def coarse_surface(scene: EchoScene, body: Body) -> Facets:
    """Return the facets of a body that face the array, with edges of at most half a wavelength."""
    return front_facets(scene, body, LONGEST)


def visible_surface(scene: EchoScene) -> Facets:
    """Return the target's facets that are visible from the aperture's centre, with edges of at most
    half a wavelength. Of a transparent target, all facets that face the array are returned."""
    facets = require_facets(coarse_surface(scene, scene.body))
    return facets if scene.body.transparent else facets.where(visible_from_centre(scene))


def visible_from_centre(scene: EchoScene) -> np.ndarray:
    """Return a boolean mask [p] of the target's coarse facets (`coarse_surface`), True for those
    visible from the aperture's centre. It is computed once per scene."""
    return scene.cached("seen", lambda: visible_from(coarse_surface(scene, scene.body), CENTRE_M))


def visible_from(facets: Facets, view_m: np.ndarray) -> np.ndarray:
    """Return a boolean mask [p], True for facets that face the point view_m [3] and are not hidden
    by others.

    The test uses a depth buffer as seen from view_m, whose pixels are two facets wide. A facet is
    hidden if it is farther than the nearest facet of its pixel by more than the depth that a
    surface with its slope spans across the pixel.
    """
    if len(facets) == 0:
        return np.zeros(0, bool)
    cell_m = 2 * float(np.sqrt(np.median(facets.area_m2)))
    frame, range_m = _frame(facets.position_m.mean(axis=0) - view_m)
    return _visible(facets.position_m, facets.normal, view_m, frame, range_m, cell_m, BUFFER_CELLS)


def _frame(axis: np.ndarray) -> tuple[np.ndarray, float]:
    """Return three perpendicular unit vectors as rows [3, 3], the last one along `axis` [3], and
    the length of `axis`."""
    length = float(np.linalg.norm(axis))
    along = axis / length
    across = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
    across /= np.linalg.norm(across)
    return np.stack([across, np.cross(along, across), along]), length


@njit(nogil=True, cache=True)
def _visible(  # type: ignore[no-untyped-def]
    position_m, normal, view_m, frame, range_m, cell_m, most_cells
):
    n = len(position_m)
    distance, cosine, tangent = np.empty(n), np.empty(n), np.empty((n, 2))
    for p in range(n):
        x, y, z = (
            position_m[p, 0] - view_m[0],
            position_m[p, 1] - view_m[1],
            position_m[p, 2] - view_m[2],
        )
        distance[p] = np.sqrt(x * x + y * y + z * z)
        cosine[p] = -(x * normal[p, 0] + y * normal[p, 1] + z * normal[p, 2]) / distance[p]
        along = max(x * frame[2, 0] + y * frame[2, 1] + z * frame[2, 2], 1e-3 * range_m)
        for i in range(2):
            tangent[p, i] = (x * frame[i, 0] + y * frame[i, 1] + z * frame[i, 2]) / along
    low = np.array([tangent[:, 0].min(), tangent[:, 1].min()])
    extent = np.array([tangent[:, 0].max(), tangent[:, 1].max()]) - low
    cell = max(cell_m / range_m, np.sqrt(extent[0] * extent[1] / most_cells))
    columns = int(extent[1] / cell) + 1
    nearest = np.full((int(extent[0] / cell) + 1) * columns, np.inf)
    place = np.empty(n, np.int64)
    for p in range(n):
        place[p] = int((tangent[p, 0] - low[0]) / cell) * columns + int(
            (tangent[p, 1] - low[1]) / cell
        )
        nearest[place[p]] = min(nearest[place[p]], distance[p])
    visible = np.zeros(n, np.bool_)
    for p in range(n):
        if cosine[p] > 0:
            steep = min(np.sqrt(1 - min(cosine[p] * cosine[p], 1.0)) / cosine[p], STEEPEST)
            visible[p] = distance[p] <= nearest[place[p]] + cell_m * (1 + steep)
    return visible


@njit(nogil=True, cache=True)
def near_outlines(  # type: ignore[no-untyped-def]
    position_m, normal, outline_m, view_m, wavelength_m
):
    """Return a boolean mask [p], True for facets that face the point view_m [3] and may be in the
    half-shadow of an outline, given by points outline_m [n, 3].

    Such a facet is farther from view_m than one of these points, within two Fresnel radii of its
    direction, and has that point above its own plane, which is impossible on a convex body.
    """
    ways, places = outline_m - view_m, position_m - view_m
    near = np.zeros(len(places), np.bool_)
    lengths = np.sqrt(ways[:, 0] ** 2 + ways[:, 1] ** 2 + ways[:, 2] ** 2)
    for p in range(len(places)):
        x, y, z = places[p, 0], places[p, 1], places[p, 2]
        length, level = (
            np.sqrt(x * x + y * y + z * z),
            normal[p, 0] * x + normal[p, 1] * y + normal[p, 2] * z,
        )
        for n in range(len(ways)):
            if near[p] or level >= 0:
                break
            a, b, c, zone = ways[n, 0], ways[n, 1], ways[n, 2], 1 / lengths[n] - 1 / length
            cosine = (a * x + b * y + c * z) / (length * lengths[n])
            above_m = normal[p, 0] * a + normal[p, 1] * b + normal[p, 2] * c - level
            near[p] = (
                above_m > HORIZON * wavelength_m
                and 2 * (1 - cosine) < ZONES * ZONES * wavelength_m * zone
            )
    return near


def some_face_each_other(facets: Facets, wavelength_m: float) -> bool:
    """Return True if some two facets are each above the plane of the other, which never occurs on a
    convex body. About PAIRED of the facets are compared."""
    some = facets.where(np.arange(0, len(facets), max(len(facets) // PAIRED, 1)))
    above_m = some.position_m @ some.normal.T - (some.position_m * some.normal).sum(axis=1)
    above = above_m > HORIZON * wavelength_m
    return bool((above & above.T).any())


def count_mirroring(facets: Facets, view_m: np.ndarray) -> int:
    """Count the facets that reflect a wave from the point view_m [3] onto other facets. The
    reflected rays are followed through a grid of cubes, each with the sum of the normals of the
    facets in it."""
    if len(facets) == 0:
        return 0
    low_m, high_m = facets.position_m.min(axis=0), facets.position_m.max(axis=0)
    cell_m = max(CELL_M, float((np.prod(high_m - low_m + CELL_M) / GRID_CELLS) ** (1 / 3)))
    place = ((facets.position_m - low_m) / cell_m).astype(np.int64)
    shape = place.max(axis=0) + 1
    flat = np.ravel_multi_index(place.T, shape)
    normals = np.stack(
        [np.bincount(flat, facets.normal[:, i], np.prod(shape)) for i in range(3)], axis=1
    )
    return _walk(facets.position_m, facets.normal, view_m, normals, low_m, shape, cell_m)


def single_bounce(facets: Facets, array: AntennaArray, view_m: np.ndarray) -> float:
    """Compute the power, in 1/m², of a wave from view_m [3] that a metal surface reflects back to
    the aperture: Σ A_p / R² / area.

    The sum is over the facets whose reflected ray passes through the aperture, enlarged to twice
    its width and height; A_p is a facet's area across the incident ray, R its distance from view_m,
    and `area` that of the enlarged aperture. Geometrical optics conserves the energy of a ray tube:
    what a facet receives, A_p / R², spreads over the area. The amplitude S of physical optics is λ
    times the field, so the mean of |S|² over the channels is λ² times this power.
    """
    (low_m, high_m), ways = _returns(array), facets.position_m - view_m
    distance = np.linalg.norm(ways, axis=1)
    cosine = -(ways * facets.normal).sum(axis=1) / distance
    back = ways / distance[:, None] + 2 * cosine[:, None] * facets.normal
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = (low_m[2] - facets.position_m[:, 2]) / back[:, 2]
        at_m = facets.position_m[:, :2] + reach[:, None] * back[:, :2]
    inside = (
        (cosine > 0) & (back[:, 2] < 0) & ((at_m >= low_m[:2]) & (at_m <= high_m[:2])).all(axis=1)
    )
    return float(
        (facets.area_m2 * cosine / distance**2)[inside].sum() / np.prod((high_m - low_m)[:2])
    )


def _returns(array: AntennaArray) -> np.ndarray:
    """Return the lower and upper corner [2, 3] of the area in which reflected rays are counted as
    returning: twice as wide and high as the aperture, with the same middle."""
    antennas_m = np.concatenate([array.tx_m, array.rx_m])
    middle_m, half_m = (
        (antennas_m.max(axis=0) + antennas_m.min(axis=0)) / 2,
        WIDE * np.ptp(antennas_m, axis=0) / 2,
    )
    return np.stack([middle_m - half_m, middle_m + half_m])


@njit(nogil=True, cache=True)
def _walk(  # type: ignore[no-untyped-def]
    position_m, normal, view_m, normals, low_m, shape, cell_m
):
    count = 0
    for p in range(len(position_m)):
        x, y, z = (
            position_m[p, 0] - view_m[0],
            position_m[p, 1] - view_m[1],
            position_m[p, 2] - view_m[2],
        )
        distance = np.sqrt(x * x + y * y + z * z)
        x, y, z = x / distance, y / distance, z / distance
        cosine = -(x * normal[p, 0] + y * normal[p, 1] + z * normal[p, 2])
        if cosine <= 0:
            continue
        x, y, z = (
            x + 2 * cosine * normal[p, 0],
            y + 2 * cosine * normal[p, 1],
            z + 2 * cosine * normal[p, 2],
        )
        step = FIRST * cell_m
        while True:
            at_x, at_y, at_z = (
                position_m[p, 0] + step * x,
                position_m[p, 1] + step * y,
                position_m[p, 2] + step * z,
            )
            i, j, k = (
                (at_x - low_m[0]) / cell_m,
                (at_y - low_m[1]) / cell_m,
                (at_z - low_m[2]) / cell_m,
            )
            if min(i, j, k) < 0 or i >= shape[0] or j >= shape[1] or k >= shape[2]:
                break
            there = normals[(int(i) * shape[1] + int(j)) * shape[2] + int(k)]
            if x * there[0] + y * there[1] + z * there[2] < 0:
                count += 1
                break
            step += cell_m / 2
    return count
