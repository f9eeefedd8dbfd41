"""Simulated echoes and the maps that methods make of them, against the exact echoes of the same
bodies.

python -m tests.references.exact.measure_exact [--polarisations along,across] [--tones few]
[--ways] [--only TEXT]
"""

import argparse
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage

from handbench.bench.evaluation.tables import declared
from handbench.bench.run.sweep import SimulationKnobs
from handbench.bench.studies.study import Record, Study, Table, measured, relative_error
from handbench.bench.tradeoff import simulated_sections
from handbench.radar.data.arrays import qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.simulation.scene import EchoScene
from handbench.radar.simulation.selection import choose
from handbench.radar.simulation.simulate import simulate_scene
from handbench.support.errors import HandbenchError
from handbench.support.files import read_npz, write_npz
from tests.references.exact.cases import (
    LONG_M,
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

SCHEMAS = declared(__file__)
LADDERS = (  # of effects, each row one more of what the scene calls for
    ("obliquity",),
    ("obliquity", "shadow_centre"),
    ("obliquity", "shadow_antennas"),
    ("obliquity", "shadow_diffraction"),
    ("obliquity", "shadow_diffraction", "multipath"),
)
REFLECTION = {
    "metal": (),
    "plastic": ("dielectric",),
    "skin": ("skin",),
}  # the effect that a kind of material needs


def study(work: Path, polarisations: str, tones: str, ways: bool = False) -> Study:
    """All scenes; ways: simulated in all ways of the trade-off's section, in place of the ladder of
    effects."""
    unknown = set(polarisations.split(",")) - {"along", "across"}
    if unknown:
        raise HandbenchError(
            f"--polarisations: {', '.join(sorted(unknown))}; expected along, across, or both"
        )
    measure = partial(compare, work=work, tones="few" if ways else tones, ways=ways)
    figure = partial(draw, work / "maps", [] if ways else [effects[-1] for effects in LADDERS])
    title = "Simulated echoes against exact solutions"
    return Study("exact", title, cases(polarisations), measure, tables, lambda _: figure())


def tables(records: list[Record]) -> list[Table]:
    """All figures of a choice of effects in a row, and those of the maps by method."""
    by_method = [
        {
            "method": name,
            **record,
            **{key.removeprefix(f"{name}_"): value for key, value in record.items()},
        }
        for name in METHODS
        for record in records
        if f"{name}_mean_mm" in record
    ]
    return [
        Table("rows", SCHEMAS["rows"].columns, records),
        Table("maps", SCHEMAS["maps"].columns, by_method, by="method"),
    ]


def compare(case: Case, work: Path, tones: str = "all", ways: bool = False) -> list[Record]:
    """A record for each choice of effects. work: where exact echoes are kept, and the maps for the
    figure; tones: all, or few, those of the FSK methods; ways: see `study`."""
    array, frequencies_hz = qar50(), tones_hz(tones)
    start = time.process_time()
    exact = kept_echoes(case, frequencies_hz, array, work / "echoes")
    exact_s = time.process_time() - start
    methods = METHODS if tones == "all" else ("2fsk", "3fsk", "nfsk-plus")
    known = maps(RadarCapture(exact[None], frequencies_hz, array), methods)
    scene = EchoScene(array, frequencies_hz, np.zeros(len(frequencies_hz)), body(case))
    reflection, found = REFLECTION[MATERIALS[case.material].kind], []

    def simulate(effects: tuple[str, ...]) -> RadarCapture:
        return simulate_scene(scene, choose(scene, (*effects, *reflection), 1.0)).capture

    ladder: dict[str, Callable[[], RadarCapture]] = {
        ", ".join(e): partial(simulate, e) for e in LADDERS
    }
    if ways:
        ladder = {
            way.words: partial(way.simulate, scene.body)
            for way in simulated_sections.ways(SimulationKnobs())
        }
    for effects, simulated in ladder.items():
        start, cpu_start = time.perf_counter(), time.process_time()
        capture = simulated()
        seconds = {
            "simulate_s": time.perf_counter() - start,
            "simulate_cpu_s": time.process_time() - cpu_start,
        }
        about: Record = {
            "scene": case.name,
            "material": case.material,
            "polarisation": case.polarisation,
        }
        about |= {"effects": effects, "echo_error": relative_error(capture.samples[0], exact)}
        ours = maps(capture, methods)
        found.append({**about, **compared(ours, known, case), **seconds, "exact_cpu_s": exact_s})
        (work / "maps").mkdir(parents=True, exist_ok=True)
        one, other = ours["3fsk"], known["3fsk"]  # that the figure shows
        kept = {"x_m": one.x_m, "y_m": one.y_m, "ours_m": one.z_m, "exact_m": other.z_m}
        write_npz(work / "maps" / f"{case}, {len(found)}.npz", **kept)
    return found


def compared(ours: dict[str, DepthMap], exact: dict[str, DepthMap], case: Case) -> Record:
    """Depths against the exact echoes' where both have one, the shares of pixels that one alone
    has, and the largest errors of both against the true surface."""
    record: Record = {}
    for name, depth in ours.items():
        near = np.abs(depth.y_m) < LONG_M
        one, other = depth.z_m[near], exact[name].z_m[near]
        here, there, front = (
            np.isfinite(one),
            np.isfinite(other),
            front_m(case, depth.x_m, depth.y_m[near]),
        )
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


PICTURED = (
    "finger before palm, 12 mm aside, skin, along",
    "",
)  # beginnings of cases: the first that there is is shown
SHOWN_MM = 50.0  # half the width and height that is shown
MOST_MM = 5.0  # of the differences


def draw(folder: Path, rungs: Sequence[str]) -> Figure | None:
    """Above: the exact map and ours; below: ours − exact. A column for each choice of effects,
    named by its last."""
    found = next((paths for name in PICTURED if (paths := sorted(folder.glob(f"{name}*.npz")))), [])
    if not found or not rungs:
        return None
    case = found[0].stem.rpartition(", ")[0]
    kept = [
        read_npz(folder / f"{case}, {n}.npz", ("x_m", "y_m", "ours_m", "exact_m"))
        for n, _ in enumerate(rungs, 1)
    ]
    figure = Figure(figsize=(2.2 * (len(kept) + 1), 4.6), layout="constrained")
    axes = figure.subplots(2, len(kept) + 1, sharex=True, sharey=True)
    low_mm, high_mm = 1e3 * np.nanpercentile(kept[0]["exact_m"], [0.5, 99.5])
    depths = (low_mm - 1, high_mm + 1)
    shown = _shown(axes[0, 0], kept[0], kept[0]["exact_m"], depths, "viridis_r", "exact")
    axes[1, 0].set_axis_off()
    for (above, below), pair, rung in zip(axes.T[1:], kept, rungs, strict=True):
        _shown(above, pair, pair["ours_m"], depths, "viridis_r", f"ours, {rung}")
        off = _shown(
            below,
            pair,
            pair["ours_m"] - pair["exact_m"],
            (-MOST_MM, MOST_MM),
            "RdBu_r",
            "ours − exact",
        )
    figure.colorbar(shown, ax=axes[0], label="depth, mm")
    figure.colorbar(off, ax=axes[1], label="difference, mm")
    figure.suptitle(f"3-FSK: {case}")
    figure.supxlabel("x, mm", fontsize="medium")
    figure.supylabel("y, mm", fontsize="medium")
    return figure


def _shown(
    axes: Axes,
    maps: dict[str, np.ndarray],
    values_m: np.ndarray,
    limits_mm: tuple[float, float],
    colours: str,
    title: str,
) -> AxesImage:
    x_mm, y_mm = 1e3 * maps["x_m"], 1e3 * maps["y_m"]
    ends_mm = (float(x_mm[0]), float(x_mm[-1]), float(y_mm[0]), float(y_mm[-1]))
    low_mm, high_mm = limits_mm
    image = axes.imshow(
        1e3 * values_m, colours, extent=ends_mm, origin="lower", vmin=low_mm, vmax=high_mm
    )
    axes.set(title=title, xlim=(SHOWN_MM, -SHOWN_MM), ylim=(-SHOWN_MM, SHOWN_MM), facecolor="0.92")
    return image


def main() -> None:
    """All scenes from the command line."""
    parser = argparse.ArgumentParser(prog="python -m tests.references.exact.measure_exact")
    parser.add_argument(
        "--polarisations", default="along", help="of the dipoles to the fingers: along,across"
    )
    tones = "few: those of the FSK methods, without broadband"
    parser.add_argument("--tones", choices=["all", "few"], default="all", help=tones)
    every = (
        "simulate in all ways of the trade-off's section, with few tones, in place of the "
        "ladder of effects"
    )
    parser.add_argument("--ways", action="store_true", help=every)
    measured(parser, study, "exact")


if __name__ == "__main__":
    main()
