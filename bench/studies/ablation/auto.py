"""python -m bench.studies.ablation.auto -o docs: what "auto" chooses on scenes that differ in kind, against all effects
on."""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bench.scenes.build import Scene, load_scene
from bench.scenes.echoes import echo_scene, echoes
from bench.studies.ablation.measure import image
from bench.studies.report import markdown_table
from radar.data.capture import RadarCapture
from radar.simulation.effects.catalogue import EFFECTS
from radar.simulation.selection import CONTAINED, Choice
from radar.simulation.simulate import SimulatedCapture
from radar.support.files import write_text
from radar.support.progress import track
from radar.warmup import compile_kernels

SCENES = Path(__file__).parent / "scenes"
METHODS = ("3fsk", "2fsk", "broadband-subvoxel")
REPEATS = 3


@dataclass(frozen=True)
class Compared:
    """A scene at a tolerance: what auto chose and left out, the seconds of both simulations (auto's with its
    estimates), and the mean |difference| of the depth maps by method, over the pixels that both have on target."""

    name: str
    tolerance_mm: float
    rows: tuple[Choice, ...]
    auto_s: float
    all_s: float
    difference_mm: dict[str, float]


def compare(scene: Scene, tolerances_mm: tuple[float, ...]) -> list[Compared]:
    """Auto against everything that the scene has a cause for, one frame each; medians of REPEATS interleaved runs."""
    radar_scene = echo_scene(scene)
    everything = tuple(e.id for e in EFFECTS if e.id not in CONTAINED and not e.missing(radar_scene))
    files = {mm: scene.file.model_copy(update={"effects": "auto", "tolerance_mm": mm}) for mm in tolerances_mm}
    listed = {None: scene.file.model_copy(update={"effects": everything}), **files}
    seconds: dict[float | None, list[float]] = {mm: [] for mm in listed}
    made: dict[float | None, SimulatedCapture] = {}
    for _ in range(1 + REPEATS):  # the first makes plans and compiles kernels, which all use again
        for mm, file in listed.items():
            start = time.perf_counter()
            made[mm] = echoes(replace(scene, file=file))
            seconds[mm].append(time.perf_counter() - start)
    median = {mm: float(np.median(values[1:])) for mm, values in seconds.items()}
    whole = made[None].capture
    return [
        Compared(
            scene.file.name,
            mm,
            made[mm].rows[1:],
            median[mm],
            median[None],
            {name: difference_mm(name, made[mm].capture, whole) for name in METHODS},
        )
        for mm in tolerances_mm
    ]


def difference_mm(method: str, one: RadarCapture, other: RadarCapture) -> float:
    """Mean |z − z'| of two captures' maps."""
    (a,), (b,) = image(method, one, 1), image(method, other, 1)
    return 1e3 * float(np.nanmean(np.abs(a.z_m - b.z_m)))


def markdown(found: list[Compared]) -> str:
    """The table for the documentation."""
    head = ["scene", "tolerance mm", "on", "left out (estimates, mm)", "auto s", "all s", "ratio"]
    head += [f"{m} mm" for m in METHODS]
    lines = [head]
    for c in found:
        out = ", ".join(f"{r.effect} {r.depth_mm:.3f}" for r in c.rows if _left_out(r))
        figures = [f"{c.auto_s:.1f}", f"{c.all_s:.1f}", f"{c.all_s / c.auto_s:.1f}"]
        figures += [f"{c.difference_mm[m]:.3f}" for m in METHODS]
        lines.append([c.name, f"{c.tolerance_mm:g}", ", ".join(r.effect for r in c.rows if r.on), out, *figures])
    return markdown_table(lines, words=(0, 2, 3))


def _left_out(row: Choice) -> bool:
    return not row.on and row.depth_mm is not None and row.effect not in CONTAINED


def main() -> None:
    """Compare on the embedded scenes, or on others; print the table and write it."""
    parser = argparse.ArgumentParser(prog="python -m bench.studies.ablation.auto", description=__doc__)
    parser.add_argument("scenes", nargs="*", type=Path, metavar="SCENE.toml")
    parser.add_argument("-o", "--out", type=Path, default=Path("runs/ablation"), metavar="DIR")
    parser.add_argument("--tolerances", default="0.1,1", help="of auto, mm, separated by commas (default 0.1,1)")
    options = parser.parse_args()
    compile_kernels()
    files = options.scenes or sorted(SCENES.glob("*.toml"))
    tolerances_mm = tuple(float(text) for text in options.tolerances.split(","))
    found = [row for path in track(files, "scenes") for row in compare(load_scene(path), tolerances_mm)]
    options.out.mkdir(parents=True, exist_ok=True)
    write_text(options.out / "auto_table.md", markdown(found))
    print(markdown(found))


if __name__ == "__main__":
    main()
