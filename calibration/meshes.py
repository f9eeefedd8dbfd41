"""Triangle meshes on disk: the one place that reads mesh files of strangers."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from radar.errors import HandbenchError
from radar.files import atomic_path, require_file
from radar.rays import embree, load_open3d

if TYPE_CHECKING:
    import open3d as o3d


def mesh(vertices_m: np.ndarray, faces: np.ndarray) -> o3d.geometry.TriangleMesh:
    """A mesh from vertices [n, 3] in metres and vertex indices [m, 3], counter-clockwise seen from outside."""
    o3d = load_open3d()
    return o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(np.ascontiguousarray(vertices_m, dtype=np.float64)),
        o3d.utility.Vector3iVector(np.ascontiguousarray(faces, dtype=np.int32)),
    )


def point_cloud(points_m: np.ndarray, normals: np.ndarray) -> o3d.geometry.PointCloud:
    """A cloud from points [n, 3] in metres and normals [n, 3]."""
    o3d = load_open3d()
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points_m))
    cloud.normals = o3d.utility.Vector3dVector(normals)
    return cloud


def read_mesh(path: str | Path) -> o3d.geometry.TriangleMesh:
    """Read a triangle mesh (PLY, OBJ, STL; metres). Refuses files without triangles or with broken numbers."""
    path = require_file(path, "a triangle mesh (PLY, OBJ or STL)")
    surface = load_open3d().io.read_triangle_mesh(str(path))
    vertices, faces = np.asarray(surface.vertices), np.asarray(surface.triangles)
    if len(faces) == 0:
        raise HandbenchError(f"{path}: holds no triangles; expected a triangle mesh (PLY, OBJ or STL)")
    if not np.isfinite(vertices).all():
        bad = int((~np.isfinite(vertices)).any(axis=1).sum())
        raise HandbenchError(f"{path}: {bad} vertices are NaN or infinite; clean the mesh first")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise HandbenchError(f"{path}: a face names vertex {faces.max()}, but there are {len(vertices)}")
    return surface


def write_mesh(path: str | Path, surface: o3d.geometry.TriangleMesh) -> None:
    """Write a mesh as binary PLY, atomically."""
    _write(path, load_open3d().io.write_triangle_mesh, surface)


def write_cloud(path: str | Path, points_m: np.ndarray, normals: np.ndarray) -> None:
    """Write points [n, 3] in metres with their normals [n, 3] as binary PLY, atomically."""
    _write(path, load_open3d().io.write_point_cloud, point_cloud(points_m, normals))


def _write(path: str | Path, write: Callable[..., bool], what: object) -> None:
    with atomic_path(path) as temporary:
        if not write(str(temporary), what, write_ascii=False):
            raise OSError(f"open3d could not write {path}")


def raycasting_scene(surface: o3d.geometry.TriangleMesh) -> o3d.t.geometry.RaycastingScene:
    """An Embree scene of one mesh, for `cast_rays` (rows [ox, oy, oz, dx, dy, dz], float32, metres)."""
    return embree(np.asarray(surface.vertices), np.asarray(surface.triangles))
