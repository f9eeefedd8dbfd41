"""Exact echoes of the study's cases, kept in files: they need not be made again when the simulation changes."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from bench.studies.exact.cases import MATERIALS, Case
from bench.studies.exact.cylinders import ALONG, Cylinder, cylinder_echoes
from bench.studies.exact.mie_series import Sphere, sphere_echoes
from radar.data.arrays import AntennaArray
from radar.simulation.physics.reflection import HORNY, dielectric_permittivity, skin_permittivity
from radar.support.errors import HandbenchError
from radar.support.files import content_hash, read_npz, write_npz


def exact_echoes(case: Case, frequencies_hz: np.ndarray, array: AntennaArray) -> np.ndarray:
    """Samples complex128 [f, t, r] of a case."""
    filling, coat = fillings(case, frequencies_hz)
    if coat is None and all(isinstance(one, Cylinder) for one in case.bodies):
        cylinders = [one for one in case.bodies if isinstance(one, Cylinder)]
        return cylinder_echoes(cylinders, frequencies_hz, array, case.polarisation, filling)
    one, *further = case.bodies
    if not isinstance(one, Sphere) or further:
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


def kept_echoes(case: Case, frequencies_hz: np.ndarray, array: AntennaArray, folder: Path) -> np.ndarray:
    """The same as complex64 from the folder, where they lie for these tones, antennas and bodies, or made and kept."""
    about = (str(case.bodies), case.polarisation, *fillings(case, frequencies_hz))
    key = content_hash(*about, array.tx_m, array.rx_m, frequencies_hz)
    path = folder / f"{str(case).replace(', ', '-').replace(' ', '_')}-{key[:16]}.npz"
    if path.exists():
        return read_npz(path, ("samples",))["samples"]
    samples = exact_echoes(case, frequencies_hz, array).astype(np.complex64)
    folder.mkdir(parents=True, exist_ok=True)
    write_npz(path, samples=samples, frequencies_hz=frequencies_hz)
    return samples
