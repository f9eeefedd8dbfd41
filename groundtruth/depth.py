"""Depth of a surface on the radar's grid: what the radar's depth maps are compared with."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from calibration.meshes import raycasting_scene
from groundtruth.surface import Surface

if TYPE_CHECKING:
    import open3d as o3d

CLEARANCE_M = 1e-3
STEEPEST = 0.1  # cosine between a surface's normal and z below which its uncertainty along z grows no more


class Reference(NamedTuple):
    """Depth z [ny, nx] and its standard deviation along z [ny, nx], metres; NaN: no surface that was seen; sigma_m is
    NaN where the surface does not know its own."""

    z_m: np.ndarray
    sigma_m: np.ndarray


class _Hits(NamedTuple):
    """What rays along +z meet first: whether anything [ny, nx]; of those that do [n] x, y and the triangle's number."""

    hit: np.ndarray
    x_m: np.ndarray
    y_m: np.ndarray
    triangle: np.ndarray


def depth_on_grid(mesh: o3d.geometry.TriangleMesh, x_m: np.ndarray, y_m: np.ndarray) -> np.ndarray:
    """Orthographic depth z [ny, nx] (metres, float64) of the mesh, in the radar frame, seen from the radar (from −z).

    NaN where a ray along +z at (x, y) meets nothing. The ray caster works in single precision: rays start just in front
    of the mesh, and the depth is computed again in double precision on the triangle that was hit.
    """
    hits = _cast(mesh, x_m, y_m)
    corners = np.asarray(mesh.vertices)[np.asarray(mesh.triangles)[hits.triangle]]
    return _spread(hits.hit, _depth_of_plane(corners, hits.x_m, hits.y_m))


def reference_on_grid(surface: Surface, x_m: np.ndarray, y_m: np.ndarray) -> Reference:
    """As `depth_on_grid`, with its uncertainty: that along the normal at the triangle's corners, carried to z. Where a
    ray meets invented surface nothing is known, neither of that nor of what lies behind it."""
    hits = _cast(surface.mesh, x_m, y_m)
    faces = surface.faces[hits.triangle]
    corners = surface.vertices_m[faces]
    seen = surface.observed[faces].all(axis=1)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    with np.errstate(invalid="ignore", divide="ignore"):
        cosine = np.abs(normal[:, 2]) / np.linalg.norm(normal, axis=1)
    along_z_m = surface.sigma_m[faces].mean(axis=1) / np.fmax(cosine, STEEPEST)
    z_m = _depth_of_plane(corners, hits.x_m, hits.y_m)
    return Reference(*(_spread(hits.hit, np.where(seen, values, np.nan)) for values in (z_m, along_z_m)))


def _cast(mesh: o3d.geometry.TriangleMesh, x_m: np.ndarray, y_m: np.ndarray) -> _Hits:
    rays = np.zeros((len(y_m), len(x_m), 6), dtype=np.float32)
    rays[..., 0], rays[..., 1] = np.meshgrid(x_m, y_m)
    rays[..., 2] = np.asarray(mesh.vertices)[:, 2].min() - CLEARANCE_M
    rays[..., 5] = 1
    found = raycasting_scene(mesh).cast_rays(rays)
    hit = np.isfinite(found["t_hit"].numpy())
    row, column = np.nonzero(hit)
    triangle = found["primitive_ids"].numpy().astype(np.int64)[hit]
    return _Hits(hit, np.asarray(x_m)[column], np.asarray(y_m)[row], triangle)


def _spread(hit: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values [n] at the places [ny, nx] that were hit, NaN elsewhere."""
    grid = np.full(hit.shape, np.nan)
    grid[hit] = values
    return grid


def _depth_of_plane(corners: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """z [n] at (x, y) [n] of the planes through corners [n, 3, 3], not beyond the corners (a triangle on edge)."""
    origin = corners[:, 0]
    normal = np.cross(corners[:, 1] - origin, corners[:, 2] - origin)
    with np.errstate(divide="ignore", invalid="ignore"):
        z = origin[:, 2] - (normal[:, 0] * (x - origin[:, 0]) + normal[:, 1] * (y - origin[:, 1])) / normal[:, 2]
    lowest, highest = corners[..., 2].min(axis=1), corners[..., 2].max(axis=1)
    return np.clip(np.where(np.isfinite(z), z, lowest), lowest, highest)
