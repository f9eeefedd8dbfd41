"""Line of sight between antennas and the facets of a body.

Rays are cast to the vertices of the mesh, first from few antennas: where two antennas of a line
agree, those between them are assumed to agree. Faces whose corners disagree, and coarse faces, are
then tested facet by facet. Only obstacles are missed that are narrower than a fine face, or so thin
that their shadow on the array is narrower than the distance of the first antennas.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from handbench.radar.simulation.physics.facets import Facets, face_vectors
from handbench.radar.simulation.scene import Body, EchoScene
from handbench.support.compiled import njit
from handbench.support.rays import Rays

# distance of the first antennas: the shadow of an object 2 mm wide, a tenth of the range before the
# skin
STRIDE_M = 0.02
COARSE = 16  # a face with more facets is tested per facet


def rays_of(scene: EchoScene, body: Body) -> Rays:
    """Return the ray caster of a body's mesh, built once per scene."""
    return scene.cached(("rays", id(body)), lambda: Rays(body.vertices_m, body.faces))


def facets_in_sight(rays: Rays, body: Body, facets: Facets, antennas_m: np.ndarray) -> np.ndarray:
    """Return a boolean mask [a, p], True for the facets that each antenna sees: their face is
    turned towards the antenna, and nothing is in between. rays: ray caster of the obstacles."""
    faces, place, parts = np.unique(facets.face, return_inverse=True, return_counts=True)
    used, corners = np.unique(body.faces[faces], return_inverse=True)
    clear = points_in_sight(rays, body.vertices_m[used], antennas_m)
    vectors = face_vectors(body.vertices_m, body.faces[faces])
    offset = (vectors * body.vertices_m[body.faces[faces, 0]]).sum(axis=1)
    coarse = np.flatnonzero((parts > COARSE)[place])
    seen = np.empty((len(antennas_m), len(facets)), bool)
    for row, antenna, corner in zip(seen, antennas_m, clear, strict=True):
        front = vectors @ antenna > offset
        count = _corners_in_sight(corner, corners.reshape(-1, 3))
        row[:] = (front & (count == 3))[place]
        mixed = np.flatnonzero((front & (parts <= COARSE) & (count % 3 > 0))[place])
        row[mixed] = rays.in_sight(facets.position_m[mixed], antenna)
        row[coarse] = front[place[coarse]]
    seen[:, coarse] &= points_in_sight(rays, facets.position_m[coarse], antennas_m)
    return seen


def points_in_sight(
    rays: Rays, points_m: np.ndarray, antennas_m: np.ndarray, stride_m: float = STRIDE_M
) -> np.ndarray:
    """Return a boolean mask [a, n], True for the points that have a clear line of sight to each
    antenna.

    Antennas about stride_m apart are tested first; where two neighbours of these agree, those
    between them are assumed to agree.
    """
    clear = np.empty((len(antennas_m), len(points_m)), bool)
    for line in lines(antennas_m):
        step_m = np.linalg.norm(np.diff(antennas_m[line], axis=0), axis=1).max(initial=0)
        stride = max(1, int(stride_m / step_m)) if step_m > 0 else 1
        first = [*range(0, len(line) - 1, stride), len(line) - 1]
        for n in first:
            clear[line[n]] = rays.in_sight(points_m, antennas_m[line[n]])
        for start, stop in pairwise(first):
            before, behind = clear[line[start]], clear[line[stop]]
            differ = np.flatnonzero(before != behind)
            for antenna in line[start + 1 : stop]:
                clear[antenna] = before
                clear[antenna, differ] = rays.in_sight(points_m[differ], antennas_m[antenna])
    return clear


def lines(antennas_m: np.ndarray) -> list[np.ndarray]:
    """Divide antennas [a, 3] into straight lines: a list of arrays of successive indices. A new
    line begins where the distance to the antenna before is more than twice the median distance."""
    if len(antennas_m) < 2:
        return [np.arange(len(antennas_m))]
    steps_m = np.linalg.norm(np.diff(antennas_m, axis=0), axis=1)
    return np.split(
        np.arange(len(antennas_m)), 1 + np.flatnonzero(steps_m > 2 * np.median(steps_m))
    )


def evenly_spaced(line_m: np.ndarray, apart_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Choose evenly spaced antennas of one line [a, 3], at most apart_m apart, including both ends:
    (their indices, distance of each of the line's antennas from its start [a] in metres)."""
    along_m = np.concatenate([[0.0], np.linalg.norm(np.diff(line_m, axis=0), axis=1).cumsum()])
    count = min(len(line_m), 1 + int(np.ceil(along_m[-1] / apart_m)))
    return np.linspace(0, len(line_m) - 1, count).round().astype(int), along_m


def nodes(antennas_m: np.ndarray, apart_m: float) -> np.ndarray:
    """Choose antennas evenly along each line of the antennas [a, 3], about apart_m apart, including
    the lines' ends: their indices."""
    return np.concatenate(
        [line[evenly_spaced(antennas_m[line], apart_m)[0]] for line in lines(antennas_m)]
    )


@njit(nogil=True, cache=True)
def _corners_in_sight(clear, corners):  # type: ignore[no-untyped-def]
    """Count the visible corners of each face: uint8 [m]. clear [n]: True for visible points;
    corners [m, 3]: indices of the faces' corners among these points."""
    count = np.zeros(len(corners), np.uint8)
    for m in range(len(corners)):
        for i in range(3):
            count[m] += clear[corners[m, i]]
    return count
