"""Closed meshes of targets with simple shapes (sphere, plate and dihedral), in the target's frame,
metres."""

import operator
from functools import reduce

import numpy as np

from handbench.bench.scenes.stand import cell_faces, cuboid
from handbench.groundtruth.mesh.surface import mesh
from handbench.radar.simulation.meshes import MOST_FACETS
from handbench.support.errors import HandbenchError
from handbench.support.rays import TriangleMesh, load_open3d

BACK_M = 5e-3  # thickness of a dihedral behind its fold


def sphere_mesh(radius_m: float, edge_m: float) -> TriangleMesh:
    """Make the mesh of a sphere around the origin, with edges of about edge_m. Raises
    HandbenchError if that would take too many triangles."""
    _check_faces(4 * np.pi * radius_m**2, edge_m)
    resolution = max(8, int(np.ceil(np.pi * radius_m / edge_m)))
    return load_open3d().geometry.TriangleMesh.create_sphere(radius_m, resolution=resolution)


def plate_mesh(width_m: float, height_m: float, thickness_m: float, edge_m: float) -> TriangleMesh:
    """Make the mesh of a plate whose front is in the plane z = 0 and faces −z, with edges of about
    edge_m. Raises HandbenchError if that would take too many triangles."""
    _check_faces(2 * width_m * height_m, edge_m)
    half = np.array([width_m, height_m]) / 2
    return mesh(*cuboid(np.array([[*-half, 0.0], [*half, thickness_m]]), edge_m))


def dihedral_mesh(side_m: float, edge_m: float) -> TriangleMesh:
    """Make the mesh of a block with a right-angled notch that opens towards −z.

    The bottom of the notch is the y axis, and its two sides are squares of side_m. Raises
    HandbenchError if edges of about edge_m would take too many triangles.
    """
    _check_faces(4 * side_m**2, edge_m)
    reach, half = side_m / np.sqrt(2), side_m / 2
    outline = np.array(
        [(-reach, -reach), (0, 0), (reach, -reach), (reach, BACK_M), (0, BACK_M), (-reach, BACK_M)]
    )
    parts = []
    for start, end in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        a, b = np.insert((start, end), 1, -half, axis=1)
        parts.append(_quad(a, b, np.array([0, side_m, 0]), edge_m))
    for y, order in ((-half, -1), (half, 1)):  # each side is two trapezoids
        for corners in ([0, 1, 4, 5], [1, 2, 3, 4]):
            points = np.insert(outline[corners], 1, y, axis=1)
            parts.append(mesh(points, np.array([(0, 1, 2), (0, 2, 3)])[:, ::order]))
    return reduce(operator.add, parts)


def _check_faces(area_m2: float, edge_m: float) -> None:
    count = 2 * area_m2 / edge_m**2
    if count > MOST_FACETS:
        raise HandbenchError(
            f"target.edge_m: is {1e3 * edge_m:g} mm, which makes {count:.0e} triangles; expected "
            f"at most {MOST_FACETS:.0e}; enlarge edge_m"
        )


def _quad(a: np.ndarray, b: np.ndarray, side: np.ndarray, step_m: float) -> TriangleMesh:
    """Make a grid of triangles over the rectangle with the corners a, b, b + side and a + side,
    with steps of at most step_m."""
    nu, nv = (int(np.ceil(np.linalg.norm(length) / step_m)) + 1 for length in (b - a, side))
    u, v = np.meshgrid(np.linspace(0, 1, nu), np.linspace(0, 1, nv), indexing="ij")
    faces = cell_faces(nu, nv)[:, [0, 2, 1]]
    return mesh(a + u.reshape(-1, 1) * (b - a) + v.reshape(-1, 1) * side, faces)
