""" "auto" on scenes that differ in kind: what it chooses, and the difference from all effects on."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from bench.scenes.build import Scene, load_scene
from bench.scenes.echoes import echo_scene, echoes
from bench.studies.ablation.measure import image
from bench.studies.columns import Record, rows
from bench.studies.study import Study, in_turns
from radar.data.capture import RadarCapture
from radar.simulation.selection import CONTAINED, EFFECTS, Choice

SCENES = Path(__file__).parent / "scenes"
METHODS = ("3fsk", "2fsk", "broadband-subvoxel")
REPEATS = 3


def study(work: Path, scenes: list[Path], tolerances: str) -> Study:
    """The embedded scenes, or others, each at all tolerances."""
    tolerances_mm = tuple(float(text) for text in tolerances.split(","))
    return Study(
        "auto",
        'What effects = "auto" chooses',
        scenes or sorted(SCENES.glob("*.toml")),
        lambda path: compare(load_scene(path), tolerances_mm),
        rows("auto"),
        label=lambda path: path.stem,
    )


def compare(scene: Scene, tolerances_mm: tuple[float, ...]) -> list[Record]:
    """Auto against everything that the scene has a cause for, one frame each; medians of REPEATS interleaved runs."""
    radar_scene = echo_scene(scene)
    everything = tuple(e.id for e in EFFECTS if e.id not in CONTAINED and not e.missing(radar_scene))
    files = {mm: scene.file.model_copy(update={"effects": "auto", "tolerance_mm": mm}) for mm in tolerances_mm}
    listed = {None: scene.file.model_copy(update={"effects": everything}), **files}
    work = {mm: partial(echoes, replace(scene, file=file)) for mm, file in listed.items()}
    seconds, made = in_turns(work, 1 + REPEATS, scene.file.name)
    median = {mm: float(np.median(values[1:])) for mm, values in seconds.items()}  # the first makes plans and compiles
    whole = made[None].capture
    return [
        {
            "scene": scene.file.name,
            "tolerance_mm": mm,
            "on": ", ".join(row.effect for row in made[mm].rows[1:] if row.on),
            "left_out": ", ".join(f"{row.effect} {row.depth_mm:.3f}" for row in made[mm].rows[1:] if _left_out(row)),
            "auto_s": median[mm],
            "all_s": median[None],
            "ratio": median[None] / median[mm],
            **{f"{name}_mm": difference_mm(name, made[mm].capture, whole) for name in METHODS},
        }
        for mm in tolerances_mm
    ]


def difference_mm(method: str, one: RadarCapture, other: RadarCapture) -> float:
    """Mean |z − z'| of two captures' maps."""
    (a,), (b,) = image(method, one, 1), image(method, other, 1)
    return 1e3 * float(np.nanmean(np.abs(a.z_m - b.z_m)))


def _left_out(row: Choice) -> bool:
    return not row.on and row.depth_mm is not None and row.effect not in CONTAINED
