"""The scenes of `bench.scenes.finger_scenes` before dipoles of two kinds, their fronts, and their
exact echoes, kept in files: they need not be made again when the simulation changes."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from handbench.bench.scenes import finger_scenes
from handbench.bench.scenes.finger_scenes import (
    MATERIALS,
    NAMED,
    SCENES,
    CoatedSphere,
    Cylinder,
    Shape,
)
from handbench.radar.data.arrays import AntennaArray
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.methods.registry import method
from handbench.radar.simulation.physics.reflection import (
    HORNY,
    dielectric_permittivity,
    skin_permittivity,
)
from handbench.radar.simulation.scene import Body
from handbench.support.errors import HandbenchError
from handbench.support.files import content_hash, read_npz, write_npz
from tests.references.exact.cylinders import ACROSS, ALONG, cylinder_echoes
from tests.references.exact.mie_series import sphere_echoes

TONES = 26  # of broadband: its depths repeat every 375 mm
METHODS: dict[str, dict[str, Any]] = {
    "2fsk": {},
    "3fsk": {},
    "nfsk-plus": {},
    "broadband": {"count": TONES},
}


@dataclass(frozen=True)
class Case:
    """A scene of a material before dipoles along or across the cylinders, or along y or x. bodies:
    cylinders or spheres."""

    name: str
    bodies: tuple[Shape, ...]
    material: str
    polarisation: str

    def __str__(self) -> str:
        return f"{self.name}, {self.material}, {self.polarisation}"


def cases(polarisations: str) -> list[Case]:
    """All scenes of metal and skin, and those of further materials."""
    wanted = polarisations.split(",")
    return [
        Case(name, SCENES[name], material, polarisation)
        for name, material in NAMED.values()
        for polarisation in (ALONG, ACROSS)
        if polarisation in wanted
    ]


def body(case: Case) -> Body:
    """Its cylinders, with closed ends, or its spheres as one body of meshes."""
    return finger_scenes.body(case.bodies, case.material)


def front_m(case: Case, x_m: np.ndarray, y_m: np.ndarray) -> np.ndarray:
    """Depth [y, x] of the front of what lies behind each pixel; NaN where nothing does."""
    z_m = np.full((len(y_m), len(x_m)), np.inf)
    for one in case.bodies:
        if isinstance(one, Cylinder):
            squared, middle_m = (x_m - one.x_m)[None, :] ** 2 + 0 * y_m[:, None], one.z_m
        else:
            x, y, middle_m = one.centre_m
            squared = (x_m - x)[None, :] ** 2 + (y_m - y)[:, None] ** 2
        inside = squared < one.radius_m**2
        z_m[inside] = np.minimum(z_m[inside], middle_m - np.sqrt(one.radius_m**2 - squared[inside]))
    return np.where(np.isfinite(z_m), z_m, np.nan)


def exact_echoes(case: Case, frequencies_hz: np.ndarray, array: AntennaArray) -> np.ndarray:
    """Samples complex128 [f, t, r] of a case."""
    filling, coat = fillings(case, frequencies_hz)
    if coat is None and all(isinstance(one, Cylinder) for one in case.bodies):
        cylinders = [one for one in case.bodies if isinstance(one, Cylinder)]
        return cylinder_echoes(cylinders, frequencies_hz, array, case.polarisation, filling)
    one, *further = case.bodies
    if not isinstance(one, CoatedSphere) or further:
        raise HandbenchError(f"{case}: no exact solution; expected bare cylinders or one sphere")
    dipole = np.array([0.0, 1.0, 0.0] if case.polarisation == ALONG else [1.0, 0.0, 0.0])
    if coat is not None:
        one = replace(one, coat_m=MATERIALS[case.material].palm_thickness_m)
    return sphere_echoes(one, frequencies_hz, array, dipole, filling, coat)


def fillings(case: Case, frequencies_hz: np.ndarray) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Permittivity [f] of the bodies, None for metal, and that of their coat, None for none."""
    material = MATERIALS[case.material]
    if material.kind == "metal":
        return None, None
    if material.kind == "skin":
        return skin_permittivity(frequencies_hz, material.wet), HORNY.permittivity(frequencies_hz)
    return np.full(len(frequencies_hz), dielectric_permittivity(material)), None


def kept_echoes(
    case: Case, frequencies_hz: np.ndarray, array: AntennaArray, folder: Path
) -> np.ndarray:
    """The same as complex64 from the folder, where they lie for these tones, antennas and bodies,
    or made and kept."""
    about = (str(case.bodies), case.polarisation, *fillings(case, frequencies_hz))
    key = content_hash(*about, array.tx_m, array.rx_m, frequencies_hz)
    path = folder / f"{str(case).replace(', ', '-').replace(' ', '_')}-{key[:16]}.npz"
    if path.exists():
        return read_npz(path, ("samples",))["samples"]
    samples = exact_echoes(case, frequencies_hz, array).astype(np.complex64)
    folder.mkdir(parents=True, exist_ok=True)
    write_npz(path, samples=samples, frequencies_hz=frequencies_hz)
    return samples


def tones_hz(which: str = "all") -> np.ndarray:
    """The tones of the FSK methods, or of all methods, ascending."""
    ladder = method("nfsk-plus").configure({}, "exact").tones_hz  # type: ignore[attr-defined]
    return np.unique([*ladder, *(np.linspace(72e9, 82e9, TONES) if which == "all" else ())])


def maps(capture: RadarCapture, methods: Iterable[str]) -> dict[str, DepthMap]:
    """Depth maps of the first frame."""
    return {
        name: method(name).run(capture, method(name).configure(METHODS[name], "exact"), 0).depth
        for name in methods
    }
