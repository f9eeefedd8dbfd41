"""Depth of a mesh on the radar's grid: what the radar's depth maps are compared with."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibration.meshes import raycasting_scene

if TYPE_CHECKING:
    import open3d as o3d

CLEARANCE_M = 1e-3


def depth_on_grid(mesh: o3d.geometry.TriangleMesh, x_m: np.ndarray, y_m: np.ndarray) -> np.ndarray:
    """Orthographic depth z [ny, nx] (metres, float64) of the mesh, in the radar frame, seen from the radar (from −z).

    NaN where a ray along +z at (x, y) meets nothing. The ray caster works in single precision: rays start just in front
    of the mesh, and the depth is computed again in double precision on the triangle that was hit.
    """
    o3d_rays = np.zeros((len(y_m), len(x_m), 6), dtype=np.float32)
    vertices = np.asarray(mesh.vertices)
    o3d_rays[..., 0], o3d_rays[..., 1] = np.meshgrid(x_m, y_m)
    o3d_rays[..., 2] = vertices[:, 2].min() - CLEARANCE_M
    o3d_rays[..., 5] = 1
    hits = raycasting_scene(mesh).cast_rays(o3d_rays)
    triangle = hits["primitive_ids"].numpy().astype(np.int64)
    hit = np.isfinite(hits["t_hit"].numpy())
    z_m = np.full(hit.shape, np.nan)
    row, column = np.nonzero(hit)
    corners = vertices[np.asarray(mesh.triangles)[triangle[hit]]]
    z_m[hit] = _depth_of_plane(corners, np.asarray(x_m)[column], np.asarray(y_m)[row])
    return z_m


def _depth_of_plane(corners: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """z [n] at (x, y) [n] of the planes through corners [n, 3, 3], not beyond the corners (a triangle on edge)."""
    origin = corners[:, 0]
    normal = np.cross(corners[:, 1] - origin, corners[:, 2] - origin)
    with np.errstate(divide="ignore", invalid="ignore"):
        z = origin[:, 2] - (normal[:, 0] * (x - origin[:, 0]) + normal[:, 1] * (y - origin[:, 1])) / normal[:, 2]
    lowest, highest = corners[..., 2].min(axis=1), corners[..., 2].max(axis=1)
    return np.clip(np.where(np.isfinite(z), z, lowest), lowest, highest)
