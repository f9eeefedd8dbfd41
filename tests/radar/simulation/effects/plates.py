"""Plates, corners, spheres and stand-ins for fingers that tests of the simulation share."""

import numpy as np

from handbench.radar.simulation.scene import Body
from handbench.support.rays import load_open3d


def plate(corner_m, along_m, across_m, count) -> Body:
    """A parallelogram of 2·count² triangles; its front is the side of along × across."""
    step = np.linspace(0, 1, count + 1)
    a, b = (grid.reshape(-1, 1) for grid in np.meshgrid(step, step, indexing="ij"))
    index = np.arange((count + 1) ** 2).reshape(count + 1, count + 1)
    p, q, r, s = (
        part.ravel() for part in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:])
    )
    faces = np.concatenate([np.stack([p, q, r], 1), np.stack([p, r, s], 1)])
    return Body(np.asarray(corner_m) + a * np.asarray(along_m) + b * np.asarray(across_m), faces)


def joined(*bodies: Body) -> Body:
    """Several bodies as one."""
    starts = np.cumsum([0, *(len(body.vertices_m) for body in bodies)])
    faces = [body.faces + start for body, start in zip(bodies, starts[:-1], strict=True)]
    return Body(np.concatenate([body.vertices_m for body in bodies]), np.concatenate(faces))


def dihedral(width_m, height_m, at_m=(0.0, 0.0, 0.0), count=16, turn_rad=0.0) -> Body:
    """Two plates at a right angle that open towards -z; their common edge, at at_m, is along y."""
    sides = []
    for side in (1, -1):
        angle = turn_rad + side * np.pi / 4
        along = width_m * np.array([np.sin(angle), 0, -np.cos(angle)])
        across = np.array([0, -side * height_m, 0])
        sides.append(plate(np.asarray(at_m) - across / 2, along, across, count))
    return joined(*sides)


def cylinder(centre_m, radius_m, length_m) -> Body:
    """An upright cylinder."""
    make = load_open3d().geometry.TriangleMesh.create_cylinder
    mesh = make(radius_m, length_m, resolution=48, split=40)
    upright_m = np.asarray(mesh.vertices)[:, [1, 2, 0]]
    return Body(np.asarray(centre_m) + upright_m, np.asarray(mesh.triangles))


def sheet(side_m, step_m, z_m=0.0, depth_m=lambda x, y: 0 * x) -> Body:
    """An open square sheet z = z_m + depth_m(x, y) about the z axis that faces -z."""
    corner_m = (-side_m / 2, -side_m / 2, z_m)
    flat = plate(corner_m, (0, side_m, 0), (side_m, 0, 0), round(side_m / step_m))
    x, y, z = flat.vertices_m.T
    return Body(np.stack([x, y, z + depth_m(x, y)], axis=1), flat.faces)


def sphere_body(radius_m, centre_m=(0.0, 0.0, 0.0), splits=4) -> Body:
    """An octahedron whose faces are split in four `splits` times and lifted to the sphere: edges of
    1.6a/2^splits."""
    open3d = load_open3d()
    mesh = open3d.geometry.TriangleMesh.create_octahedron()
    for _ in range(splits + 1):
        vertices = np.asarray(mesh.vertices)
        unit = vertices / np.linalg.norm(vertices, axis=1, keepdims=True)
        mesh.vertices = open3d.utility.Vector3dVector(unit)
        faces, mesh = np.asarray(mesh.triangles), mesh.subdivide_midpoint()
    return Body(np.asarray(centre_m) + radius_m * unit, faces)
