"""python -m bench.ablation.auto -o docs: what "auto" chooses on scenes that differ in kind, against all effects on."""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.ablation.measure import image
from bench.scenes.echoes import choices, echo_scene
from bench.scenes.scene import Scene, load_scene
from radar.capture import RadarCapture
from radar.effects.catalogue import EFFECTS
from radar.effects.plan import CONTAINED, Choice, choose
from radar.effects.simulate import shoot
from radar.files import atomic_path
from radar.progress import track
from radar.warmup import compile_kernels

SCENES = Path(__file__).parent / "scenes"
METHODS = ("3fsk", "2fsk", "broadband-subvoxel")


@dataclass(frozen=True)
class Compared:
    """A scene: what auto chose and left out, the seconds of both simulations (auto's with its estimates), and the mean
    |difference| of the depth maps by method, over the pixels that both have on target."""

    name: str
    rows: tuple[Choice, ...]
    auto_s: float
    all_s: float
    difference_mm: dict[str, float]


def compare(scene: Scene) -> Compared:
    """Auto against everything that the scene has a cause for, one frame each."""
    radar_scene = echo_scene(scene)
    everything = tuple(e.id for e in EFFECTS if e.id not in CONTAINED and not e.missing(radar_scene))
    shoot(radar_scene, choose(radar_scene, everything, 1.0))  # plans and compiled kernels, which both use again
    start = time.perf_counter()
    fresh = echo_scene(scene)  # with nothing kept
    rows = choices(scene, fresh)
    found = shoot(fresh, rows)
    auto_s = time.perf_counter() - start
    start = time.perf_counter()
    whole = shoot(echo_scene(scene), choose(radar_scene, everything, 1.0))
    all_s = time.perf_counter() - start
    difference = {name: difference_mm(name, found.capture, whole.capture) for name in METHODS}
    return Compared(scene.file.name, rows, auto_s, all_s, difference)


def difference_mm(method: str, one: RadarCapture, other: RadarCapture) -> float:
    """Mean |z − z'| of two captures' maps."""
    (a,), (b,) = image(method, one, 1), image(method, other, 1)
    return 1e3 * float(np.nanmean(np.abs(a.z_m - b.z_m)))


def markdown(found: list[Compared]) -> str:
    """The table for the documentation."""
    head = ["scene", "on", "left out (estimates, mm)", "auto s", "all s", "ratio", *(f"{m} mm" for m in METHODS)]
    lines = [head, ["---"] * 3 + ["--:"] * (len(head) - 3)]
    for c in found:
        out = ", ".join(f"{r.effect} {r.depth_mm:.3f}" for r in c.rows if not r.on and r.depth_mm is not None)
        figures = [f"{c.auto_s:.1f}", f"{c.all_s:.1f}", f"{c.all_s / c.auto_s:.1f}"]
        figures += [f"{c.difference_mm[m]:.3f}" for m in METHODS]
        lines.append([c.name, ", ".join(r.effect for r in c.rows if r.on), out, *figures])
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines) + "\n"


def main() -> None:
    """Compare on the embedded scenes, or on others; print the table and write it."""
    parser = argparse.ArgumentParser(prog="python -m bench.ablation.auto", description=__doc__)
    parser.add_argument("scenes", nargs="*", type=Path, metavar="SCENE.toml")
    parser.add_argument("-o", "--out", type=Path, default=Path("runs/ablation"), metavar="DIR")
    options = parser.parse_args()
    compile_kernels()
    files = options.scenes or sorted(SCENES.glob("*.toml"))
    found = [compare(load_scene(path)) for path in track(files, "scenes")]
    options.out.mkdir(parents=True, exist_ok=True)
    with atomic_path(options.out / "auto_table.md") as temporary:
        temporary.write_text(markdown(found), encoding="utf-8")
    print(markdown(found))


if __name__ == "__main__":
    main()
