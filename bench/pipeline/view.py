"""A mesh as its sensor sees it, for drawing."""

from dataclasses import replace

import numpy as np

from handbench.bench.results.maps import SurfaceMap
from handbench.groundtruth.mesh.depth import reference_on_grid
from handbench.groundtruth.mesh.surface import Surface

VIEWED_PX = 320  # along each side


def view(mesh: Surface) -> tuple[str, SurfaceMap]:
    """Return the sensor that saw a mesh, array or cameras, and the mesh's depths from there; with
    their standard deviations, if the mesh was made from photographs."""
    sensor, signs = _seen_from(mesh)
    turned = replace(mesh, vertices_m=mesh.vertices_m * signs)
    low_m, high_m = turned.vertices_m.min(axis=0), turned.vertices_m.max(axis=0)
    x_m, y_m, _ = np.linspace(low_m, high_m, VIEWED_PX).T
    depth = reference_on_grid(turned, x_m, y_m)
    sigma_m = depth.mesh_sigma_m if sensor == "cameras" else None
    return sensor, SurfaceMap(x_m, y_m, depth.z_m, sigma_m)


def _seen_from(mesh: Surface) -> tuple[str, np.ndarray]:
    """Find from which side a mesh must be drawn: returns the sensor, and signs of x, y and z with
    which the axes point left, up and away from it.
    A mesh with sigma_m was made from photographs. If its observed faces point towards +z, its frame
    is that of a board, with the cameras on the side of +z. Otherwise it is a camera's frame (x
    right, y down, z away from the camera)."""
    if not np.isfinite(mesh.sigma_m).any():
        return "array", np.ones(3)
    seen = mesh.faces[mesh.observed[mesh.faces].all(axis=1)]
    a, b, c = np.moveaxis(mesh.vertices_m[seen], 1, 0)
    facing = np.cross(b - a, c - a)[:, 2].sum() >= 0
    return "cameras", np.array([-1, 1, -1] if facing else [-1, -1, 1])
