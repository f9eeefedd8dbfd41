"""Simulated echoes and the maps that methods make of them, against the exact echoes of the same
bodies.

python -m tests.references.exact.measure_exact [--polarisations along,across] [--tones few]
[--ways] [--only TEXT]
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from handbench.bench.evaluation.tables import declared_tables
from handbench.bench.run.sweep import SimulationKnobs
from handbench.bench.studies.study import Record, Study, Table, measured, parser, relative_error
from handbench.bench.tradeoff import simulated_sections
from handbench.radar.data.arrays import qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.simulation.scene import EchoScene
from handbench.radar.simulation.selection import choose
from handbench.radar.simulation.simulate import simulate_scene
from handbench.support.errors import HandbenchError
from tests.references.exact.cases import (
    MATERIALS,
    METHODS,
    Case,
    body,
    cases,
    front_m,
    kept_echoes,
    maps,
    tones_hz,
)

LONG_M = 0.03  # depths are compared as far along the cylinders, where their ends do not count
SCHEMAS = declared_tables(__file__)
LADDERS = (  # of effects, each row one more of what the scene calls for
    ("obliquity",),
    ("obliquity", "shadow_centre"),
    ("obliquity", "shadow_antennas"),
    ("obliquity", "shadow_diffraction"),
    ("obliquity", "shadow_diffraction", "multipath"),
)
# the effect that a kind of material needs
REFLECTION = {"metal": (), "plastic": ("dielectric",), "skin": ("skin",)}


def study(work: Path, polarisations: str, tones: str, ways: bool = False) -> Study:
    """All scenes; ways: simulated in all ways of the trade-off's section, in place of the ladder of
    effects."""
    unknown = set(polarisations.split(",")) - {"along", "across"}
    if unknown:
        named = ", ".join(sorted(unknown))
        raise HandbenchError(f"--polarisations: {named}; expected along, across, or both")
    measure = partial(compare, work=work, tones="few" if ways else tones, ways=ways)
    return Study("exact", cases(polarisations), measure, tables)


def tables(records: list[Record]) -> list[Table]:
    """All figures of a choice of effects in a row, and those of the maps by method."""
    by_method = [
        {"method": name}
        | record
        | {key.removeprefix(f"{name}_"): value for key, value in record.items()}
        for name in METHODS
        for record in records
        if f"{name}_mean_mm" in record
    ]
    return [
        Table("rows", SCHEMAS["rows"].columns, records),
        Table("maps", SCHEMAS["maps"].columns, by_method, by="method"),
    ]


def compare(case: Case, work: Path, tones: str = "all", ways: bool = False) -> list[Record]:
    """A record for each choice of effects. work: where exact echoes are kept; tones: all, or few,
    those of the FSK methods; ways: see `study`."""
    array, frequencies_hz = qar50(), tones_hz(tones)
    start_s = time.process_time()
    exact = kept_echoes(case, frequencies_hz, array, work / "echoes")
    exact_s = time.process_time() - start_s
    methods = METHODS if tones == "all" else ("2fsk", "3fsk", "nfsk-plus")
    known = maps(RadarCapture(exact[None], frequencies_hz, array), methods)
    scene = EchoScene(array, frequencies_hz, np.zeros(len(frequencies_hz)), body(case))
    reflection, found = REFLECTION[MATERIALS[case.material].kind], []

    def simulate(effects: tuple[str, ...]) -> RadarCapture:
        return simulate_scene(scene, choose(scene, (*effects, *reflection))).capture

    ladder: dict[str, Callable[[], RadarCapture]] = {
        ", ".join(effects): partial(simulate, effects) for effects in LADDERS
    }
    if ways:
        chosen = simulated_sections.variants(SimulationKnobs())
        ladder = {way.words: partial(way.simulate, scene.body) for way in chosen}
    for effects, simulated in ladder.items():
        start_s, cpu_start_s = time.perf_counter(), time.process_time()
        capture = simulated()
        found.append(
            {
                "scene": case.name,
                "material": case.material,
                "polarisation": case.polarisation,
                "effects": effects,
                "simulate_s": time.perf_counter() - start_s,
                "simulate_cpu_s": time.process_time() - cpu_start_s,
                "exact_cpu_s": exact_s,
                "echo_error": relative_error(capture.samples[0], exact),
                **compared(maps(capture, methods), known, case),
            }
        )
    return found


def compared(ours: dict[str, DepthMap], exact: dict[str, DepthMap], case: Case) -> Record:
    """Depths against the exact echoes' where both have one, the shares of pixels that one alone
    has, and the largest errors of both against the true surface."""
    record: Record = {}
    for name, depth in ours.items():
        near = np.abs(depth.y_m) < LONG_M
        one, other = depth.z_m[near], exact[name].z_m[near]
        here, there = np.isfinite(one), np.isfinite(other)
        front = front_m(case, depth.x_m, depth.y_m[near])
        figures = {
            "mean_mm": _of(np.mean, one - other),
            "p95_mm": _of(lambda off: np.percentile(off, 95), one - other),
            "max_mm": _of(np.max, one - other),
            "lost": (there & ~here).sum() / there.sum() if there.any() else np.nan,
            "gained": (here & ~there).sum() / there.sum() if there.any() else np.nan,
            "true_max_mm": _of(np.max, one - front),
            "exact_true_max_mm": _of(np.max, other - front),
        }
        record |= {f"{name}_{key}": float(value) for key, value in figures.items()}
    return record


def _of(figure: Callable[[np.ndarray], np.floating], off_m: np.ndarray) -> float:
    """A figure of |differences| in mm where there are some, else NaN."""
    known = 1e3 * np.abs(off_m[np.isfinite(off_m)])
    return float(figure(known)) if len(known) else np.nan


def main() -> None:
    """All scenes from the command line."""
    options = parser("exact", "simulated echoes against exact solutions")
    options.prog = "python -m tests.references.exact.measure_exact"
    dipoles = "of the dipoles to the fingers: along,across"
    options.add_argument("--polarisations", default="along", help=dipoles)
    tones = "few: those of the FSK methods, without broadband"
    options.add_argument("--tones", choices=["all", "few"], default="all", help=tones)
    every = "simulate in all ways of the trade-off's section, with few tones"
    options.add_argument("--ways", action="store_true", help=every)
    measured(options, study, "exact")


if __name__ == "__main__":
    main()
