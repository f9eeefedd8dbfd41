"""Bodies with exact echoes: parallel cylinders (fingers before a palm) and spheres, of metal or
skin, before dipoles along the cylinders."""

from dataclasses import replace

import numpy as np

from handbench.bench.scenes.shapes import sphere_mesh
from handbench.groundtruth.mesh.surface import mesh
from handbench.radar.data.arrays import AntennaArray
from handbench.radar.simulation.reflection import HORNY, dielectric_permittivity, skin_permittivity
from handbench.radar.simulation.scene import Body, Material
from handbench.support.rays import TriangleMesh, load_open3d
from tests.references.exact.cylinders import Cylinder, cylinder_echoes
from tests.references.exact.mie_series import CoatedSphere, sphere_echoes

HALF_LENGTH_M = 0.16  # of the meshes; the array's specular points are within a third of it
AROUND_M, ALONG_M = 0.5e-3, 2e-3  # edges of the meshes: 4 µm inside the cylinder
MATERIALS = {
    "metal": Material(),
    "skin": Material(kind="plastic", permittivity=6.4, loss_tangent=1.35),
    "palm": Material(kind="skin", palm_thickness_m=0.4e-3),  # under its horny layer
}
Shape = Cylinder | CoatedSphere


def _fingers(*x_m: float) -> tuple[Cylinder, ...]:
    return tuple(Cylinder(x, 0.29, 8e-3) for x in x_m)


SCENES: dict[str, tuple[Shape, ...]] = {
    "one finger": _fingers(0.0),
    "fingers 6 mm apart": _fingers(-11e-3, 11e-3),
    "four fingers": _fingers(-27e-3, -9e-3, 9e-3, 27e-3),
    # the palm 34 mm behind the finger's axis
    "finger before palm": (Cylinder(0.0, 0.265, 8e-3), Cylinder(0.0, 0.324, 25e-3)),
    "sphere of 10 mm": (CoatedSphere((0.0, 0.0, 0.29), 10e-3),),
}


def body(shapes: tuple[Shape, ...], material: str) -> Body:
    """Cylinders, with closed ends, or spheres as one body of meshes."""
    made = load_open3d().geometry.TriangleMesh()
    for shape in shapes:
        made += _mesh(shape)
    faces = np.asarray(made.triangles)
    palm = np.ones(len(faces), bool) if material == "palm" else None
    return Body(np.asarray(made.vertices), faces, MATERIALS[material], palm)


def _mesh(shape: Shape) -> TriangleMesh:
    if isinstance(shape, CoatedSphere):
        return sphere_mesh(shape.radius_m, AROUND_M / 2).translate(shape.centre_m)
    around = int(np.ceil(2 * np.pi * shape.radius_m / AROUND_M))
    along = int(np.ceil(2 * HALF_LENGTH_M / ALONG_M))
    made = load_open3d().geometry.TriangleMesh.create_cylinder(
        shape.radius_m, 2 * HALF_LENGTH_M, around, along
    )
    # its axis is z
    vertices_m = np.asarray(made.vertices)[:, [1, 2, 0]] + (shape.x_m, 0.0, shape.z_m)
    return mesh(vertices_m, np.asarray(made.triangles))


def exact_echoes(
    shapes: tuple[Shape, ...], material: str, frequencies_hz: np.ndarray, array: AntennaArray
) -> np.ndarray:
    """Samples complex128 [f, t, r] of cylinders, or of one sphere."""
    made, coat = MATERIALS[material], None
    if made.kind == "metal":
        filling = None
    elif made.kind == "skin":
        filling, coat = skin_permittivity(frequencies_hz, made.wet), HORNY(frequencies_hz)
    else:
        filling = np.full(len(frequencies_hz), dielectric_permittivity(made))
    if isinstance(shapes[0], Cylinder):
        return cylinder_echoes(list(shapes), frequencies_hz, array, filling)
    sphere = replace(shapes[0], coat_m=0.0 if coat is None else made.palm_thickness_m)
    return sphere_echoes(sphere, frequencies_hz, array, np.eye(3)[1], filling, coat)
