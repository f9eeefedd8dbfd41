"""Coarse visibility without rays: depth buffers, in which every facet is a point."""

from __future__ import annotations

import numba
import numpy as np

from radar.simulation.physics.facets import Facets

MOST_CELLS = 1 << 22
STEEPEST = 6.0  # tangent of incidence up to which a cell's own surface is told from what stands before it


def visible_from(facets: Facets, view_m: np.ndarray) -> np.ndarray:
    """Mask [p] of the facets that face the point view_m [3] and have none before them in their cell of direction.

    Cells are two facets wide, and what stands less before a facet than the facet's own surface may vary over a cell
    counts as that surface.
    """
    if len(facets) == 0:
        return np.zeros(0, bool)
    cell_m = 2 * float(np.sqrt(np.median(facets.area_m2)))
    frame, range_m = _frame(facets.position_m.mean(axis=0) - view_m)
    return _visible(facets.position_m, facets.normal, view_m, frame, range_m, cell_m, MOST_CELLS)


def _frame(axis: np.ndarray) -> tuple[np.ndarray, float]:
    """Unit vectors [3, 3] across and (the last) along an axis [3], and its length."""
    length = float(np.linalg.norm(axis))
    along = axis / length
    across = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
    across /= np.linalg.norm(across)
    return np.stack([across, np.cross(along, across), along]), length


@numba.njit(nogil=True, cache=True)
def _visible(position_m, normal, view_m, frame, range_m, cell_m, most_cells):  # type: ignore[no-untyped-def]
    n = len(position_m)
    distance, cosine, tangent = np.empty(n), np.empty(n), np.empty((n, 2))
    for p in range(n):
        x, y, z = position_m[p, 0] - view_m[0], position_m[p, 1] - view_m[1], position_m[p, 2] - view_m[2]
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
        place[p] = int((tangent[p, 0] - low[0]) / cell) * columns + int((tangent[p, 1] - low[1]) / cell)
        nearest[place[p]] = min(nearest[place[p]], distance[p])
    visible = np.zeros(n, np.bool_)
    for p in range(n):
        if cosine[p] > 0:
            steep = min(np.sqrt(1 - min(cosine[p] * cosine[p], 1.0)) / cosine[p], STEEPEST)
            visible[p] = distance[p] <= nearest[place[p]] + cell_m * (1 + steep)
    return visible
