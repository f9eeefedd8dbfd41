"""Simple scenes for which Maxwell's equations have exact solutions: parallel cylinders (fingers
before a palm) and spheres, of metal, skin or plastic. Tests compare simulated echoes with these
solutions."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from handbench.bench.scenes.shapes import cylinder_mesh, sphere_mesh
from handbench.radar.simulation.scene import Body, Material
from handbench.support.rays import TriangleMesh, load_open3d

HALF_LENGTH_M = 0.16  # of the meshes; the array's specular points are within a third of it
AROUND_M, ALONG_M = 0.5e-3, 2e-3  # edges of the meshes: 4 µm inside the cylinder
FINGER_M, PALM_M = 8e-3, 25e-3  # radii
MATERIALS = {
    "metal": Material(),
    "skin": Material(kind="plastic", permittivity=6.4, loss_tangent=1.35),
    "palm": Material(kind="skin", palm_thickness_m=0.4e-3),  # under its horny layer
    "print": Material(kind="plastic", permittivity=2.7, loss_tangent=0.01),
    "lossy print": Material(kind="plastic", permittivity=2.7, loss_tangent=0.1),
}


@dataclass(frozen=True)
class Cylinder:
    """A cylinder, such as a finger, in the radar frame. Its axis is parallel to y and goes through
    (x_m, z_m)."""

    x_m: float
    z_m: float
    radius_m: float

    def mesh(self) -> TriangleMesh:
        """Make the mesh of the cylinder, with closed ends, in the radar frame."""
        around = int(np.ceil(2 * np.pi * self.radius_m / AROUND_M))
        along = int(np.ceil(2 * HALF_LENGTH_M / ALONG_M))
        made = cylinder_mesh(self.radius_m, 2 * HALF_LENGTH_M, around, along)
        return made.translate((self.x_m, 0.0, self.z_m))


@dataclass(frozen=True)
class CoatedSphere:
    """A sphere in the radar frame. radius_m: outer radius. coat_m: thickness of an outer layer with
    another permittivity than the core (0: no layer)."""

    centre_m: tuple[float, float, float]
    radius_m: float
    coat_m: float = 0.0

    def mesh(self) -> TriangleMesh:
        """Make the mesh of the sphere's outer surface, in the radar frame."""
        return sphere_mesh(self.radius_m, AROUND_M / 2).translate(self.centre_m)


Shape = Cylinder | CoatedSphere


def _fingers(*x_m: float) -> tuple[Cylinder, ...]:
    return tuple(Cylinder(x, 0.29, FINGER_M) for x in x_m)


def _before_palm(x_m: float) -> tuple[Cylinder, ...]:
    """Return two cylinders: a finger at x_m, and a palm at x = 0 behind it. The finger's axis is 34
    mm in front of the palm's surface."""
    return Cylinder(x_m, 0.265, FINGER_M), Cylinder(0.0, 0.299 + PALM_M, PALM_M)


SCENES: dict[str, tuple[Shape, ...]] = {
    "one finger": _fingers(0.0),
    "fingers 6 mm apart": _fingers(-11e-3, 11e-3),
    "fingers 1 mm apart": _fingers(-8.5e-3, 8.5e-3),
    "four fingers": _fingers(-27e-3, -9e-3, 9e-3, 27e-3),
    "finger before palm": _before_palm(0.0),
    "finger before palm, 12 mm aside": _before_palm(12e-3),
    **{
        f"sphere of {1e3 * r_m:.0f} mm": (CoatedSphere((0.0, 0.0, 0.29), r_m),)
        for r_m in (10e-3, 5e-3, 2e-3)
    },
}
# The one scene that there is of each further material.
FURTHER = {"palm": "sphere of 10 mm", "print": "one finger", "lossy print": "one finger"}
NAMED = {  # "SCENE, MATERIAL": both
    f"{name}, {material}": (name, material)
    for name in SCENES
    for material in MATERIALS
    if FURTHER.get(material, name) == name
}


def body(shapes: Sequence[Shape], material: str) -> Body:
    """Join cylinders (with closed ends) and spheres to one body of the radar simulation. material:
    a key of MATERIALS; for "palm", the whole body has the thick horny layer of a palm."""
    made = load_open3d().geometry.TriangleMesh()
    for shape in shapes:
        made += shape.mesh()
    vertices_m, faces = np.asarray(made.vertices), np.asarray(made.triangles)
    return Body(
        vertices_m,
        faces,
        MATERIALS[material],
        np.ones(len(faces), bool) if material == "palm" else None,
    )
