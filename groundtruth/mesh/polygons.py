"""Division of polygons into triangles."""

from collections.abc import Sequence

import numpy as np

MOST_CORNERS = 1000  # of a polygon
SAME_AREA = 1e-6  # share by which the triangles' area may differ from their polygon's


def triangles(points_m: np.ndarray, polygons: Sequence[np.ndarray]) -> np.ndarray:
    """Cut polygons into triangles [m, 3] with the orientation of their polygons.

    The triangles do not depend on which corner of a polygon comes first. Convex polygons are cut
    into fans; others are cut by ear clipping in the plane that fits them best.

    Args:
        points_m: points [n, 3], metres.
        polygons: for each number of corners, an array [count, corners] of point indices.

    Raises:
        ValueError: a polygon has fewer than 3 or more than MOST_CORNERS corners, or crosses itself.
    """
    parts = [np.zeros((0, 3), np.int64)]
    for corners in polygons:
        count = corners.shape[1]
        if not 3 <= count <= MOST_CORNERS:
            raise ValueError(f"a face has {count} corners; expected 3 to {MOST_CORNERS}")
        parts.append(corners if count == 3 else _cut(points_m, corners))
    return np.concatenate(parts)


def _cut(points_m: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Cut polygons with equally many corners, [count, corners] of point indices, into triangles [m,
    3] of point indices, in the order of the polygons."""
    corners = _from_one_corner(points_m, corners)
    fans = np.stack([corners[:, (0, k, k + 1)] for k in range(1, corners.shape[1] - 1)], axis=1)
    convex = _are_convex(points_m[corners])
    if convex.all():
        return fans.reshape(-1, 3)
    return np.concatenate(
        [
            fan if simple else _clipped(points_m[polygon], polygon)
            for polygon, fan, simple in zip(corners, fans, convex, strict=True)
        ]
    )


def _from_one_corner(points_m: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Rotate the corners [count, corners] of each polygon so that the first one has the smallest x
    (if equal, the smallest y, then z)."""
    x, y, z = np.moveaxis(points_m[corners], 2, 0)
    first = np.lexsort((z, y, x), axis=1)[:, :1]
    turned = (first + np.arange(corners.shape[1])) % corners.shape[1]
    return np.take_along_axis(corners, turned, axis=1)


def _are_convex(at_m: np.ndarray) -> np.ndarray:
    """Return a mask [count] of the polygons that are convex when seen along their normal, or have
    no area. at_m [count, corners, 3]: the polygons' corners."""
    edges = np.roll(at_m, -1, axis=1) - at_m
    normals = _normals(at_m)
    turns = np.cross(edges, np.roll(edges, -1, axis=1))
    spokes = at_m[:, 1:] - at_m[:, :1]
    fans = np.cross(spokes[:, :-1], spokes[:, 1:])
    least = -SAME_AREA * (normals**2).sum(axis=1, keepdims=True)
    along = [np.einsum("nki,ni->nk", areas, normals) >= least for areas in (turns, fans)]
    folded = np.linalg.norm(fans, axis=2).sum(axis=1) > (
        2 * np.linalg.norm(normals, axis=1) + SAME_AREA**2 * (edges**2).sum(axis=(1, 2))
    )
    return along[0].all(axis=1) & along[1].all(axis=1) & ~folded


def _normals(at_m: np.ndarray) -> np.ndarray:
    """Compute the normals [count, 3] of polygons from their corners [count, corners, 3] by Newell's
    method. A normal's length is twice the polygon's area."""
    from_middle_m = at_m - at_m.mean(axis=1, keepdims=True)
    return np.cross(from_middle_m, np.roll(from_middle_m, -1, axis=1)).sum(axis=1)


def _clipped(at_m: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Cut one polygon into triangles [m, 3] of point indices by ear clipping. corners: the
    polygon's point indices; at_m [corners, 3]: their positions. Raises ValueError if the polygon
    crosses itself."""
    from mapbox_earcut import triangulate_float64

    normal = _normals(at_m[None])[0]
    area = np.linalg.norm(normal)
    first = np.eye(3)[np.abs(normal).argmin()]
    across = np.cross(normal, first) / max(area, np.finfo(float).tiny)
    across /= np.linalg.norm(across) or 1.0
    up = np.cross(normal, across) / max(area, np.finfo(float).tiny)
    seen = np.ascontiguousarray((at_m - at_m.mean(axis=0)) @ np.stack([across, up], axis=1))
    cut = triangulate_float64(seen, np.array([len(corners)], np.uint32))
    cut = cut.astype(np.int64).reshape(-1, 3)
    one, two = (seen[cut[:, k]] - seen[cut[:, 0]] for k in (1, 2))
    signed = one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0]
    if len(cut) == 0 or abs(np.abs(signed).sum() - area) > SAME_AREA * area:
        raise ValueError(f"a face of {len(corners)} corners crosses itself; triangulate the mesh")
    cut[signed < 0] = cut[signed < 0][:, ::-1]
    return corners[cut]
