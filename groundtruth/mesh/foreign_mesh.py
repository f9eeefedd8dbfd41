"""A mesh that something else has made, taken over in metres."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from groundtruth.mesh.mesh_files import read_mesh
from groundtruth.mesh.poisson import repair
from radar.support.errors import HandbenchError

if TYPE_CHECKING:
    import open3d as o3d

SMALLEST_M, LARGEST_M = 5e-3, 50.0  # what anybody puts before a radar


def metric_mesh(path: str | Path, unit_m: float) -> o3d.geometry.TriangleMesh:
    """A mesh file (PLY, OBJ, STL) whose numbers are in units of `unit_m` metres, in metres, repaired and its triangles
    turned alike; a HandbenchError for one without triangles, with broken numbers, or of a size that tells of another
    unit."""
    mesh = read_mesh(path)
    mesh.scale(unit_m, center=np.zeros(3))
    mesh = repair(mesh)
    longest_m = float(np.ptp(np.asarray(mesh.vertices), axis=0).max())
    if not SMALLEST_M < longest_m < LARGEST_M:
        raise HandbenchError(
            f"{path}: is {longest_m:.3g} m long; expected {SMALLEST_M:g} to {LARGEST_M:g} m: is --unit right?"
        )
    if mesh.is_orientable():
        mesh.orient_triangles()
    return mesh
