"""Each effect's case simulated, imaged by each method and scored against the true surface.

python -m tests.bench.studies.ablation.measure_ablation [--poses B,F,U] [--frames N] [-o DIR]
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from handbench.bench.evaluation.depth_errors import error_map
from handbench.bench.evaluation.metrics import HEADLINE, METRICS, pool, precision
from handbench.bench.evaluation.tables import Column, declared_tables
from handbench.bench.run.repeat_stage import strongest_z_m
from handbench.bench.scenes.build import Scene, build
from handbench.bench.scenes.echoes import choices, echo_scene
from handbench.groundtruth.mesh.depth import depth_on_grid
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.methods.registry import method
from handbench.radar.simulation.ablation import Ablation
from handbench.radar.simulation.catalogue import CONTAINED, EFFECTS
from handbench.radar.simulation.simulate import simulate_scene
from tests.bench.studies.ablation.ablation_cases import Case, cases, scene_file
from tests.bench.studies.columns import Record, Table
from tests.bench.studies.script import measured
from tests.bench.studies.study import BLUE, GREY, VERMILION, Study

METHODS = ("2fsk", "3fsk", "broadband", "narrowband")
REPEATED = ("2fsk", "3fsk")  # methods whose precision is measured
CHANGED = "3fsk"  # the method whose depth map is compared with the reference's
SHOWN = {HEADLINE: 3, "max_mm": 1}  # metrics of every method, and their decimals


def _column(method: str, key: str, places: int, words: str = "") -> Column:
    """A metric of a method; words: other than the metric's own."""
    heading = f"{method} {words or METRICS[key].title.split()[0]} mm"
    return Column(
        f"{method}_{key}", float, METRICS[key].definition, heading=heading, form=f"{{:.{places}f}}"
    )


COLUMNS = (
    *declared_tables(__file__)["rows"].columns,
    *(_column(m, key, places) for m in METHODS for key, places in SHOWN.items()),
    *(_column(m, "precision_mm", 3, "precision") for m in REPEATED),
)


def study(work: Path, poses: str, frames: int) -> Study:
    """All cases on all poses, `frames` repeats for the precision."""
    scene = cache(lambda pose: build(scene_file(pose, cases()[0])))
    return Study(
        "ablation",
        "What each effect does to each method",
        [(case, pose) for pose in poses.split(",") for case in cases()],
        lambda chosen: show(chosen[0], chosen[1], scene(chosen[1]), frames),
        lambda records: [Table("rows", COLUMNS, pooled(records))],
        draw,
        label=lambda chosen: f"{chosen[0].name}, {chosen[1]}",
        seed=1,
    )


def show(case: Case, pose: str, scene: Scene, frames: int) -> Record:
    """Simulate, image and score one case; the mesh of `scene` is used again. seconds: of each
    effect that was on."""
    scene = replace(scene, file=scene_file(pose, case))
    radar_scene = echo_scene(scene)
    start = time.perf_counter()
    simulated = simulate_scene(radar_scene, choices(scene, radar_scene), frames)
    elapsed_s = time.perf_counter() - start
    depths = {
        name: image(name, simulated.capture, frames if name in REPEATED else 1) for name in METHODS
    }
    truth = {
        name: depth_on_grid(scene.target_mesh, d[0].x_m, d[0].y_m) for name, d in depths.items()
    }
    there = [effect for effect in EFFECTS if effect.id in (*case.effects, case.effect)]
    estimated = (
        Ablation(radar_scene, there, CONTAINED).change({case.effect}) if case.effect else None
    )
    return {
        "case": case,
        "pose": pose,
        "maps": {
            name: error_map(d[0].x_m, d[0].y_m, d[0].z_m, truth[name]) for name, d in depths.items()
        },
        "depth_m": depths[CHANGED][0].z_m,
        "repeats_z_m": {name: strongest_z_m(depths[name]) for name in REPEATED},
        "estimate_mm": estimated and estimated[CHANGED].depth_mm,
        "seconds": {row.effect: row.seconds for row in simulated.rows if row.seconds is not None},
        "simulate_s": elapsed_s,
    }


def image(name: str, capture: RadarCapture, frames: int) -> list[DepthMap]:
    """The first frames by one method."""
    chosen = method(name)
    config = chosen.configure({}, "ablation")
    return [chosen.run(capture, config, frame).depth for frame in range(frames)]


def pooled(records: list[Record]) -> list[Record]:
    """A record a case, over the poses in which it and the case that it is held against were
    measured."""
    by_name = {(record["case"].name, record["pose"]): record for record in records}
    rows = []
    for case in dict.fromkeys(record["case"].name for record in records):
        pairs = [
            (r, by_name.get((r["case"].against, r["pose"])))
            for r in records
            if r["case"].name == case
        ]
        if pairs := [pair for pair in pairs if pair[1] is not None]:
            rows.append({"case": case, **_pooled(*map(list, zip(*pairs, strict=True)))})
    return rows


def _pooled(shown: list[Record], reference: list[Record]) -> dict[str, Any]:
    effect = shown[0]["case"].effect
    change_m = [
        np.abs(s["depth_m"] - r["depth_m"]).ravel() for s, r in zip(shown, reference, strict=True)
    ]
    estimates = [s["estimate_mm"] for s in shown if s["estimate_mm"] is not None]
    effect_s = [
        {**r["seconds"], **s["seconds"]}.get(effect, 0.0)
        for s, r in zip(shown, reference, strict=True)
    ]
    values = {m: pool([s["maps"][m] for s in shown]) for m in METHODS}
    precise = {m: precision([s["repeats_z_m"][m] for s in shown])["precision_mm"] for m in REPEATED}
    return {
        "change_mm": 1e3 * float(np.nanmean(np.concatenate(change_m))),
        "estimate_mm": float(np.mean(estimates)) if estimates else None,
        "effect_s": float(np.mean(effect_s)),
        "simulate_s": float(np.mean([s["simulate_s"] for s in shown])),
        **{f"{m}_{key}": values[m][key] for m in METHODS for key in SHOWN},
        **{f"{m}_precision_mm": value for m, value in precise.items()},
    }


SMALLEST_MM = 1e-4  # what is smaller stands at the axis


def draw(frames: dict[str, pd.DataFrame]) -> Figure:
    """Left: the change of the depth map; right: seconds."""
    rows = frames["rows"]
    effects = rows[rows.case != "reference"].sort_values("change_mm", kind="stable")
    figure = Figure(figsize=(9.5, 5.2), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(3, 2), sharey=True)
    places = np.arange(len(effects))
    seen_mm, estimated_mm = (
        effects[key].astype(float).clip(SMALLEST_MM) for key in ("change_mm", "estimate_mm")
    )
    left.barh(places, seen_mm, color=BLUE, height=0.6, label="measured, mean |Δz| of the 3-FSK map")
    left.plot(estimated_mm, places, "D", color=VERMILION, label="estimated")
    left.axvline(0.1, color=GREY, linestyle="--", linewidth=0.8)
    left.annotate(
        "0.1 mm",
        (0.1, len(effects) - 0.4),
        color=GREY,
        ha="center",
        va="bottom",
        annotation_clip=False,
    )
    left.set_yticks(places, effects.case)
    left.set(xscale="log", xlabel="change of the depth map, mm", xlim=(SMALLEST_MM, 20))
    right.barh(places, effects.simulate_s, color="0.85", label="whole simulation")
    right.barh(places, effects.effect_s, color=BLUE, label="the effect")
    right.set(xlabel="seconds per pose, 130 tones", title="what it costs")
    figure.legend(loc="outside lower center", ncols=4, frameon=False)
    return figure


def main() -> None:
    """Measure, write the files of a study, print the table."""
    prog = "python -m tests.bench.studies.ablation.measure_ablation"
    purpose = "what each effect of simulated echoes does to each method, and what it costs"
    parser = argparse.ArgumentParser(prog=prog, description=purpose)
    parser.add_argument(
        "--poses", default="B,F,U", help="letters, separated by commas (default B,F,U)"
    )
    parser.add_argument(
        "--frames", type=int, default=10, help="repeats for the precision (default 10)"
    )
    measured(parser, study, "ablation")


if __name__ == "__main__":
    main()
