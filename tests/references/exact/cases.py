"""Bodies with exact echoes, before dipoles of two kinds: parallel cylinders (fingers before a palm)
and spheres, of metal, skin or plastic."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from handbench.bench.scenes.shapes import cylinder_mesh, sphere_mesh
from handbench.radar.data.arrays import AntennaArray
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.methods.registry import method
from handbench.radar.simulation.physics.reflection import (
    HORNY,
    dielectric_permittivity,
    skin_permittivity,
)
from handbench.radar.simulation.scene import Body, Material
from handbench.support.rays import TriangleMesh, load_open3d
from tests.references.exact.cylinders import ALONG, Cylinder, cylinder_echoes
from tests.references.exact.mie_series import CoatedSphere, sphere_echoes

HALF_LENGTH_M = 0.16  # of the meshes; the array's specular points are within a third of it
AROUND_M, ALONG_M = 0.5e-3, 2e-3  # edges of the meshes: 4 µm inside the cylinder
FINGER_M, PALM_M = 8e-3, 25e-3  # radii
MATERIALS = {
    "metal": Material(),
    "skin": Material(kind="plastic", permittivity=6.4, loss_tangent=1.35),
    "palm": Material(kind="skin", palm_thickness_m=0.4e-3),  # under its horny layer
}
Shape = Cylinder | CoatedSphere


def _fingers(*x_m: float) -> tuple[Cylinder, ...]:
    return tuple(Cylinder(x, 0.29, FINGER_M) for x in x_m)


def _before_palm(x_m: float) -> tuple[Cylinder, ...]:
    """A finger at x_m, and a palm at x = 0, 34 mm behind the finger's axis."""
    return Cylinder(x_m, 0.265, FINGER_M), Cylinder(0.0, 0.299 + PALM_M, PALM_M)


SCENES: dict[str, tuple[Shape, ...]] = {
    "one finger": _fingers(0.0),
    "fingers 6 mm apart": _fingers(-11e-3, 11e-3),
    "four fingers": _fingers(-27e-3, -9e-3, 9e-3, 27e-3),
    "finger before palm": _before_palm(0.0),
    "finger before palm, 12 mm aside": _before_palm(12e-3),
    "sphere of 10 mm": (CoatedSphere((0.0, 0.0, 0.29), 10e-3),),
}


@dataclass(frozen=True)
class Case:
    """Bodies of a material before dipoles along or across the cylinders, or along y or x."""

    name: str
    bodies: tuple[Shape, ...]
    material: str
    polarisation: str


def body(case: Case) -> Body:
    """Its cylinders, with closed ends, or its spheres as one body of meshes."""
    made = load_open3d().geometry.TriangleMesh()
    for shape in case.bodies:
        made += mesh_of(shape)
    faces = np.asarray(made.triangles)
    palm = np.ones(len(faces), bool) if case.material == "palm" else None
    return Body(np.asarray(made.vertices), faces, MATERIALS[case.material], palm)


def mesh_of(shape: Shape) -> TriangleMesh:
    """Its mesh; cylinders have closed ends."""
    if isinstance(shape, CoatedSphere):
        return sphere_mesh(shape.radius_m, AROUND_M / 2).translate(shape.centre_m)
    around = int(np.ceil(2 * np.pi * shape.radius_m / AROUND_M))
    along = int(np.ceil(2 * HALF_LENGTH_M / ALONG_M))
    made = cylinder_mesh(shape.radius_m, 2 * HALF_LENGTH_M, around, along)
    return made.translate((shape.x_m, 0.0, shape.z_m))


def front_m(case: Case, x_m: np.ndarray, y_m: np.ndarray) -> np.ndarray:
    """Depth [y, x] of the front of the cylinders behind each pixel; NaN where there is none."""
    z_m = np.full((len(y_m), len(x_m)), np.inf)
    for one in case.bodies:
        inside = np.abs(x_m - one.x_m) < one.radius_m
        depth_m = one.z_m - np.sqrt(one.radius_m**2 - (x_m[inside] - one.x_m) ** 2)
        z_m[:, inside] = np.minimum(z_m[:, inside], depth_m)
    return np.where(np.isfinite(z_m), z_m, np.nan)


def exact_echoes(case: Case, frequencies_hz: np.ndarray, array: AntennaArray) -> np.ndarray:
    """Samples complex128 [f, t, r] of a case."""
    filling, coat = fillings(case, frequencies_hz)
    if isinstance(case.bodies[0], Cylinder):
        return cylinder_echoes(list(case.bodies), frequencies_hz, array, case.polarisation, filling)
    [sphere] = case.bodies
    dipole = np.array([0.0, 1.0, 0.0] if case.polarisation == ALONG else [1.0, 0.0, 0.0])
    if coat is not None:
        sphere = replace(sphere, coat_m=MATERIALS[case.material].palm_thickness_m)
    return sphere_echoes(sphere, frequencies_hz, array, dipole, filling, coat)


def fillings(case: Case, frequencies_hz: np.ndarray) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Permittivity [f] of the bodies, None for metal, and that of their coat, None for none."""
    material = MATERIALS[case.material]
    if material.kind == "metal":
        return None, None
    if material.kind == "skin":
        return skin_permittivity(frequencies_hz, material.wet), HORNY(frequencies_hz)
    return np.full(len(frequencies_hz), dielectric_permittivity(material)), None


def maps(capture: RadarCapture, methods: Iterable[str]) -> dict[str, DepthMap]:
    """Depth maps of the first frame."""
    return {
        name: method(name).run(capture, method(name).configure({}, "exact"), 0) for name in methods
    }
