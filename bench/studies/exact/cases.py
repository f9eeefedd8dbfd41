"""The scenes: fingers and a palm as cylinders, of metal or of what skin is at 80 GHz, as meshes and as axes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench.studies.exact.cylinders import ACROSS, ALONG, Cylinder
from radar.simulation.scene import Body, Material
from radar.support.rays import load_open3d

HALF_LENGTH_M = 0.16  # of the meshes; no specular point of the array lies beyond a third of it
AROUND_M, ALONG_M = 0.5e-3, 2e-3  # edges of the meshes: 4 µm inside the cylinder
FINGER_M, PALM_M = 8e-3, 25e-3  # radii
MATERIALS = {"metal": Material(), "skin": Material(kind="plastic", permittivity=6.4, loss_tangent=1.35)}


@dataclass(frozen=True)
class Case:
    """A scene of a material before dipoles along or across the cylinders."""

    name: str
    cylinders: tuple[Cylinder, ...]
    material: str
    polarisation: str

    def __str__(self) -> str:
        return f"{self.name}, {self.material}, {self.polarisation}"


def _fingers(*x_m: float) -> tuple[Cylinder, ...]:
    return tuple(Cylinder(x, 0.29, FINGER_M) for x in x_m)


def _before_palm(x_m: float) -> tuple[Cylinder, ...]:
    """A finger whose axis is 34 mm before the palm's front."""
    return Cylinder(x_m, 0.265, FINGER_M), Cylinder(0.0, 0.299 + PALM_M, PALM_M)


SCENES = {
    "one finger": _fingers(0.0),
    "fingers 6 mm apart": _fingers(-11e-3, 11e-3),
    "fingers 1 mm apart": _fingers(-8.5e-3, 8.5e-3),
    "four fingers": _fingers(-27e-3, -9e-3, 9e-3, 27e-3),
    "finger before palm": _before_palm(0.0),
    "finger before palm, 12 mm aside": _before_palm(12e-3),
}


def cases(polarisations: str) -> list[Case]:
    """All scenes of both materials."""
    wanted = polarisations.split(",")
    return [
        Case(name, cylinders, material, polarisation)
        for name, cylinders in SCENES.items()
        for material in MATERIALS
        for polarisation in (ALONG, ACROSS)
        if polarisation in wanted
    ]


def body(case: Case) -> Body:
    """The cylinders as one body of meshes with closed ends."""
    vertices_m, faces, count = [], [], 0
    for cylinder in case.cylinders:
        own_m, own_faces = tube(cylinder)
        vertices_m.append(own_m)
        faces.append(own_faces + count)
        count += len(own_m)
    return Body(np.concatenate(vertices_m), np.concatenate(faces), MATERIALS[case.material])


def tube(cylinder: Cylinder) -> tuple[np.ndarray, np.ndarray]:
    """Vertices [n, 3] on a cylinder and faces [m, 3], counter-clockwise seen from outside; fans close its ends."""
    around = int(np.ceil(2 * np.pi * cylinder.radius_m / AROUND_M))
    along = int(np.ceil(2 * HALF_LENGTH_M / ALONG_M))
    made = load_open3d().geometry.TriangleMesh.create_cylinder(cylinder.radius_m, 2 * HALF_LENGTH_M, around, along)
    turned_m = np.asarray(made.vertices)[:, [1, 2, 0]]  # its axis is z
    return turned_m + [cylinder.x_m, 0.0, cylinder.z_m], np.asarray(made.triangles)
