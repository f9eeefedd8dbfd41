"""Simulated echoes and the maps that methods make of them, against the exact echoes of the same bodies."""

import time
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bench.studies.columns import Record, Table, columns
from bench.studies.exact.cases import MATERIALS, Case, body, cases, front_m
from bench.studies.exact.figure import draw
from bench.studies.exact.solutions import kept_echoes
from bench.studies.study import Study
from radar.data.arrays import qar50
from radar.data.capture import RadarCapture
from radar.data.depthmap import DepthMap
from radar.methods.registry import method
from radar.simulation.scene import EchoScene
from radar.simulation.selection import choose
from radar.simulation.simulate import simulate_scene
from radar.support.errors import HandbenchError
from radar.support.files import write_npz

LONG_M = 0.03  # depths are compared as far along the cylinders, where their ends do not count
TONES = 26  # of broadband: its depths repeat every 375 mm
METHODS: dict[str, dict[str, Any]] = {"2fsk": {}, "3fsk": {}, "nfsk-plus": {}, "broadband": {"count": TONES}}
LADDERS = (  # of effects, each row one more of what the scene calls for
    ("obliquity",),
    ("obliquity", "shadow_centre"),
    ("obliquity", "shadow_antennas"),
    ("obliquity", "shadow_diffraction"),
    ("obliquity", "shadow_diffraction", "multipath"),
)
REFLECTION = {"metal": (), "plastic": ("dielectric",), "skin": ("skin",)}  # the effect that a kind of material needs


def study(work: Path, polarisations: str, tones: str) -> Study:
    """All scenes."""
    unknown = set(polarisations.split(",")) - {"along", "across"}
    if unknown:
        raise HandbenchError(f"--polarisations: {', '.join(sorted(unknown))}; expected along, across, or both")
    measure = partial(compare, work=work, tones=tones)
    figure = partial(draw, work / "maps", [effects[-1] for effects in LADDERS])
    title = "Simulated echoes against exact solutions"
    return Study("exact", title, cases(polarisations), measure, tables, lambda _: figure())


def tables(records: list[Record]) -> list[Table]:
    """All figures of a choice of effects in a row, and those of the maps by method."""
    by_method = [
        {"method": name, **record, **{key.removeprefix(f"{name}_"): value for key, value in record.items()}}
        for name in METHODS
        for record in records
        if f"{name}_mean_mm" in record
    ]
    return [Table("rows", columns("exact.rows"), records), Table("maps", columns("exact.maps"), by_method, by="method")]


def compare(case: Case, work: Path, tones: str = "all") -> list[Record]:
    """A record for each choice of effects. work: where exact echoes are kept, and the maps for the figure; tones: all,
    or few, those of the FSK methods."""
    array, frequencies_hz = qar50(), tones_hz(tones)
    start = time.process_time()
    exact = kept_echoes(case, frequencies_hz, array, work / "echoes")
    exact_s = time.process_time() - start
    methods = METHODS if tones == "all" else ("2fsk", "3fsk", "nfsk-plus")
    known = maps(RadarCapture(exact[None], frequencies_hz, array), methods)
    scene = EchoScene(array, frequencies_hz, np.zeros(len(frequencies_hz)), body(case))
    found = []
    for effects in LADDERS:
        wanted = (*effects, *REFLECTION[MATERIALS[case.material].kind])
        start, cpu_start = time.perf_counter(), time.process_time()
        capture = simulate_scene(scene, choose(scene, wanted, 1.0)).capture
        seconds = {"simulate_s": time.perf_counter() - start, "simulate_cpu_s": time.process_time() - cpu_start}
        about: Record = {"scene": case.name, "material": case.material, "polarisation": case.polarisation}
        about |= {"effects": ", ".join(effects), "echo_error": echo_error(capture.samples[0], exact)}
        ours = maps(capture, methods)
        found.append({**about, **compared(ours, known, case), **seconds, "exact_cpu_s": exact_s})
        _keep(work / "maps", f"{case}, {len(found)}", ours, known)
    return found


def tones_hz(which: str = "all") -> np.ndarray:
    """The tones of the FSK methods, or of all methods, ascending."""
    ladder = method("nfsk-plus").configure({}, "exact").tones_hz  # type: ignore[attr-defined]
    return np.unique([*ladder, *(np.linspace(72e9, 82e9, TONES) if which == "all" else ())])


def echo_error(samples: np.ndarray, exact: np.ndarray) -> float:
    """L2 of the difference over that of the exact samples."""
    return float(np.linalg.norm(samples - exact) / np.linalg.norm(exact))


def maps(capture: RadarCapture, methods: Iterable[str]) -> dict[str, DepthMap]:
    """Depth maps of the first frame."""
    return {
        name: method(name).run(capture, method(name).configure(METHODS[name], "exact"), 0).depth for name in methods
    }


def compared(ours: dict[str, DepthMap], exact: dict[str, DepthMap], case: Case) -> Record:
    """Depths against the exact echoes' where both have one, the shares of pixels that one alone has, and the largest
    errors of both against the true surface."""
    record: Record = {}
    for name, depth in ours.items():
        near = np.abs(depth.y_m) < LONG_M
        one, other = depth.z_m[near], exact[name].z_m[near]
        here, there, front = np.isfinite(one), np.isfinite(other), front_m(case, depth.x_m, depth.y_m[near])
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


def _keep(folder: Path, label: str, ours: dict[str, DepthMap], exact: dict[str, DepthMap]) -> None:
    """Write the 3-FSK maps that the figure shows."""
    folder.mkdir(parents=True, exist_ok=True)
    one, other = ours["3fsk"], exact["3fsk"]
    write_npz(folder / f"{label}.npz", x_m=one.x_m, y_m=one.y_m, ours_m=one.z_m, exact_m=other.z_m)
