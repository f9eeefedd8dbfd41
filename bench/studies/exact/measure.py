"""Simulated echoes and the maps that methods make of them, against the exact echoes of the same cylinders."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np

from bench.studies.columns import Record, rows
from bench.studies.exact.cases import MATERIALS, Case, body, cases
from bench.studies.exact.cylinders import cylinder_echoes
from bench.studies.study import Study
from radar.data.arrays import qar50
from radar.data.capture import RadarCapture
from radar.data.depthmap import DepthMap
from radar.methods.registry import method
from radar.simulation.physics.reflection import dielectric_permittivity
from radar.simulation.scene import EchoScene
from radar.simulation.selection import choose
from radar.simulation.simulate import simulate_scene
from radar.support.errors import HandbenchError

LONG_M = 0.03  # depths are compared as far along the cylinders, where their ends do not count
TONES = 26  # of broadband: its depths repeat every 375 mm
METHODS: dict[str, dict[str, Any]] = {"2fsk": {}, "3fsk": {}, "nfsk-plus": {}, "broadband": {"count": TONES}}
LADDERS = (  # of effects, each row one more of what the scene calls for
    ("obliquity",),
    ("obliquity", "shadow_centre"),
    ("obliquity", "shadow_antennas"),
    ("obliquity", "shadow_diffraction"),
    ("obliquity", "shadow_antennas", "multipath"),
    ("obliquity", "shadow_diffraction", "multipath"),
)


def study(work: Path, polarisations: str) -> Study:
    """All scenes."""
    unknown = set(polarisations.split(",")) - {"along", "across"}
    if unknown:
        raise HandbenchError(f"--polarisations: {', '.join(sorted(unknown))}; expected along, across, or both")
    return Study("exact", "Simulated echoes against exact solutions", cases(polarisations), compare, rows("exact"))


def compare(case: Case) -> list[Record]:
    """A record for each choice of effects."""
    array, frequencies_hz = qar50(), tones_hz()
    start = time.perf_counter()
    material = MATERIALS[case.material]
    filling = None if material.kind == "metal" else np.full(len(frequencies_hz), dielectric_permittivity(material))
    exact = cylinder_echoes(list(case.cylinders), frequencies_hz, array, case.polarisation, filling)
    exact_s = time.perf_counter() - start
    known = _maps(RadarCapture(exact[None].astype(np.complex64), frequencies_hz, array))
    scene = EchoScene(array, frequencies_hz, np.zeros(len(frequencies_hz)), body(case))
    found = []
    for effects in LADDERS:
        strength = () if filling is None else ("dielectric",)
        start = time.perf_counter()
        capture = simulate_scene(scene, choose(scene, (*effects, *strength), 1.0)).capture
        seconds = time.perf_counter() - start
        error = np.linalg.norm(capture.samples[0] - exact) / np.linalg.norm(exact)
        about: Record = {"scene": case.name, "material": case.material, "polarisation": case.polarisation}
        about |= {"effects": ", ".join(effects), "echo_error": float(error)}
        maps = _maps(capture)
        found.append({**about, **_compared(maps, known), "simulate_s": seconds, "exact_s": exact_s})
    return found


def tones_hz() -> np.ndarray:
    """The tones of all methods, ascending."""
    ladder = method("nfsk-plus").configure({}, "exact").tones_hz  # type: ignore[attr-defined]
    return np.unique(np.concatenate([ladder, np.linspace(72e9, 82e9, TONES)]))


def _maps(capture: RadarCapture) -> dict[str, DepthMap]:
    chosen = {name: (method(name), values) for name, values in METHODS.items()}
    return {name: m.run(capture, m.configure(values, "exact"), 0).depth for name, (m, values) in chosen.items()}


def _compared(maps: dict[str, DepthMap], exact: dict[str, DepthMap]) -> Record:
    """Depths against the exact echoes' where both have one, and the shares of pixels that one alone has."""
    record: Record = {}
    for name, depth in maps.items():
        near = np.abs(depth.y_m) < LONG_M
        one, other = depth.z_m[near], exact[name].z_m[near]
        off_mm = 1e3 * np.abs(one - other)[np.isfinite(one) & np.isfinite(other)]
        seen = np.isfinite(other).sum()
        figures = {"mean_mm": off_mm.mean(), "p95_mm": np.percentile(off_mm, 95), "max_mm": off_mm.max()}
        figures |= {"lost": (np.isfinite(other) & ~np.isfinite(one)).sum() / seen}
        figures |= {"gained": (np.isfinite(one) & ~np.isfinite(other)).sum() / seen}
        record |= {f"{name}_{key}": float(value) for key, value in figures.items()}
    return record
