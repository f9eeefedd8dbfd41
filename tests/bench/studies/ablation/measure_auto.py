"""Scenes that differ in kind, from files or of random seeds: whether "auto" keeps its tolerance on
them against everything that the scene has a cause for, what it costs, and what its estimates are
worth.

python -m tests.bench.studies.ablation.measure_auto [SCENE.toml …] [--tolerances 0.1,1] [--seeds N]
[-o DIR]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from handbench.bench.evaluation.tables import declared_tables
from handbench.bench.scenes.build import Scene, load_scene
from handbench.bench.scenes.echoes import choices, echo_scene
from handbench.bench.scenes.scene_file import SceneFile
from handbench.radar.data.capture import RadarCapture
from handbench.radar.methods.registry import method
from handbench.radar.simulation.ablation import FINE, LOST_MM, METHODS, Change
from handbench.radar.simulation.catalogue import CONTAINED, EFFECTS
from handbench.radar.simulation.known_effects import Choice
from handbench.radar.simulation.scene import EchoScene
from handbench.radar.simulation.selection import choose
from handbench.radar.simulation.simulate import simulate_scene
from handbench.support.errors import HandbenchError
from tests.bench.studies.ablation.assorted_scenes import assorted_scene
from tests.bench.studies.columns import Record, Table
from tests.bench.studies.script import measured
from tests.bench.studies.study import Study

SCHEMAS = declared_tables(__file__)
SCENES = Path(__file__).parent / "scenes"
FEW = (
    "2fsk",
    "3fsk",
    "nfsk",
    "narrowband",
)  # of the benchmark's methods, those that need five tones
MANY = ("broadband", "broadband-subvoxel")
MEASURED = 3  # effects of a scene that are left out of it one by one, those that take long first
PIXEL_M, FILTER_PX = 2e-3, 3  # of the random scenes' images
BOX_M = (-0.015, 0.065)  # along z about the target's nearest point, as the paper's 80 mm
SMALLEST_MM = 0.01  # a tenth of the tolerance: of less nobody asks how well it was estimated

Maps = dict[str, np.ndarray]


def study(work: Path, scenes: list[Path], tolerances: str, seeds: int) -> Study:
    """The scenes of SCENES, or others, and random ones of the seeds 0 … seeds − 1, each at all
    tolerances."""
    tolerances_mm = tuple(float(text) for text in tolerances.split(","))
    named = scenes or ([] if seeds else sorted(SCENES.glob("*.toml")))
    cases: list[tuple[str, Callable[[], Scene]]] = [
        (path.stem, partial(load_scene, path)) for path in named
    ]
    work.mkdir(parents=True, exist_ok=True)
    cases += [(f"seed {seed}", partial(assorted_scene, seed, work)) for seed in range(seeds)]
    return Study(
        "auto",
        'What effects = "auto" chooses',
        cases,
        lambda case: compare(case[1](), tolerances_mm),
        tables,
        label=lambda case: case[0],
        seed=seeds or None,
    )


def tables(records: list[Record]) -> list[Table]:
    """Scenes, their effects' estimates against what leaving each out changes, and what comes of
    both."""
    rows, estimates = ([r for r in records if ("effect" in r) == of] for of in (False, True))
    known = {"rows": rows, "summary": summary(rows, estimates), "estimates": estimates}
    return [Table(name, SCHEMAS[name].columns, records) for name, records in known.items()]


def compare(scene: Scene, tolerances_mm: tuple[float, ...]) -> list[Record]:
    """Auto against everything that the scene has a cause for, one frame each, in CPU seconds; then
    everything without each effect."""
    radar_scene = echo_scene(scene)
    everything = tuple(
        e.id for e in EFFECTS if e.id not in CONTAINED and not e.missing(radar_scene)
    )
    listed: dict[float | None, SceneFile] = {
        None: scene.file.model_copy(update={"effects": everything})
    }
    listed |= {
        mm: scene.file.model_copy(update={"effects": "auto", "tolerance_mm": mm})
        for mm in tolerances_mm
    }
    _round(scene, listed)  # makes plans and compiles
    timed = _round(scene, listed)
    made = {mm: last for mm, (_, _, last) in timed.items()}
    seconds = {mm: np.array(timed[mm][:2]) for mm in listed}
    maps: dict[float | None, Maps] = {None: depth_maps(scene, made[None][0])}
    maps |= {
        mm: maps[None] if made[mm][0] is made[None][0] else depth_maps(scene, made[mm][0])
        for mm in tolerances_mm
    }
    records = []
    for mm in tolerances_mm:
        changes = {name: Change.between(z_m, maps[mm][name]) for name, z_m in maps[None].items()}
        estimate_s, auto_s = seconds[mm][0], seconds[mm].sum()
        pixels_percent = 100 * max(change.pixels for change in changes.values())
        worst_mm = max(change.depth_mm for change in changes.values())
        records.append(
            {
                "scene": scene.file.name,
                "tolerance_mm": mm,
                "left_out": ", ".join(
                    row.effect for row in made[mm][1] if row.effect in everything and not row.on
                ),
                "kept": worst_mm <= mm and pixels_percent <= 100 * mm / LOST_MM,
                "pixels_percent": pixels_percent,
                **{f"{name}_mm": change.depth_mm for name, change in changes.items()},
                "estimate_s": estimate_s,
                "auto_s": auto_s,
                "all_s": seconds[None].sum(),
                "ratio": seconds[None].sum() / auto_s,
            }
        )
    return records + estimates(scene, radar_scene, everything, maps[None])


def estimates(
    scene: Scene, radar_scene: EchoScene, everything: tuple[str, ...], whole: Maps
) -> list[Record]:
    """The estimates of some effects beside what leaving each out changes; for 3-FSK and for the
    method that it changes most."""
    records = []
    slow = [
        effect.id
        for effect in EFFECTS
        if effect.id in everything and effect.cost_s(radar_scene) > 0
    ]
    others = np.random.default_rng(scene.file.seed).permutation(
        [name for name in everything if name not in slow]
    )
    asked = [*slow, *others][:MEASURED]
    for row in choose(radar_scene, everything, 0.1, explain=True):
        if row.effect not in asked:
            continue
        rest = [name for name in everything if name != row.effect]
        rest += [name for name, container in CONTAINED.items() if container == row.effect]
        without = depth_maps(
            scene, simulate_scene(radar_scene, choose(radar_scene, tuple(rest), 0.1)).capture
        )
        changes = {name: Change.between(whole[name], without[name]) for name in METHODS}
        shares = {
            "estimate_percent": row.pixels_percent,
            "measured_percent": 100 * max(change.pixels for change in changes.values()),
        }
        worst = row.worst_mm, max(change.depth_mm for change in changes.values())
        for name, (estimate_mm, measured_mm) in {
            FINE: (row.depth_mm, changes[FINE].depth_mm),
            "worst": worst,
        }.items():
            smaller, larger = sorted((measured_mm, estimate_mm or 0.0))
            within = "" if larger < SMALLEST_MM else "yes" if larger <= 2 * smaller else "no"
            record: Record = {
                "scene": scene.file.name,
                "effect": row.effect,
                "map": name,
                "estimate_mm": estimate_mm,
            }
            record |= {"measured_mm": measured_mm, "within_two": within}
            records.append(record | (shares if name == "worst" else {}))
    return records


def summary(rows: list[Record], estimates: list[Record]) -> list[Record]:
    """Per tolerance: promises kept, estimates within a factor of two, and times."""
    told = {
        name: [
            record["within_two"] == "yes"
            for record in estimates
            if record["within_two"] and record["map"] == name
        ]
        for name in (FINE, "worst")
    }
    found = []
    for mm in sorted({row["tolerance_mm"] for row in rows}):
        these = [row for row in rows if row["tolerance_mm"] == mm]
        ratios = [row["ratio"] for row in these if row["left_out"]]
        hands = [row["estimate_s"] / row["all_s"] for row in these if "hand" in row["scene"]]
        found.append(
            {
                "tolerance_mm": mm,
                "scenes": len(these),
                "kept": sum(row["kept"] for row in these),
                **{
                    f"within_two_{name}": 100 * float(np.mean(some)) if some else None
                    for name, some in told.items()
                },
                "median_ratio": float(np.median(ratios)) if ratios else None,
                "largest_percent": 100 * max(row["auto_s"] / row["all_s"] for row in these),
                "hands_percent": 100 * max(hands) if hands else None,
            }
        )
    return found


def depth_maps(scene: Scene, capture: RadarCapture) -> Maps:
    """Depths [ny, nx] by each method that the tones allow; a few tones are those of a random scene,
    whose images lie where its target is."""
    few = len(capture.frequencies_hz) < 100
    maps = {}
    for name in FEW if few else (*FEW, *MANY):
        chosen = method(name)
        config = chosen.configure(_around(scene, name) if few else {}, scene.file.name)
        maps[name] = chosen.run(capture, config, 0).depth.z_m
    return maps


def _around(scene: Scene, name: str) -> dict[str, Any]:
    across = {"start_m": -0.15, "stop_m": 0.15, "step_m": PIXEL_M}
    nearest_m = float(np.asarray(scene.target_mesh.vertices)[:, 2].min())
    if name == "narrowband":
        low_m, high_m = (round(nearest_m + offset_m, 3) for offset_m in BOX_M)
        return {"x": across, "y": across, "z": {"start_m": low_m, "stop_m": high_m, "step_m": 1e-3}}
    start = {"x": across, "y": across, "first_depth_m": scene.file.target.distance_m}
    return (
        start
        if name == "2fsk"
        else start | {"coarse_filter_px": FILTER_PX, "fine_filter_px": FILTER_PX}
    )


Timed = tuple[float, float, tuple[RadarCapture, tuple[Choice, ...]]]


def _round(scene: Scene, listed: dict[float | None, SceneFile]) -> dict[float | None, Timed]:
    """CPU seconds of choosing and of simulating, the capture and the rows, of each way. The same
    effects are the same simulation, whose time is not measured twice."""
    found: dict[float | None, Timed] = {}
    known: dict[frozenset[str], tuple[float, RadarCapture]] = {}
    for mm, file in listed.items():
        radar_scene, start = echo_scene(replace(scene, file=file)), time.process_time()
        rows = choices(replace(scene, file=file), radar_scene)
        chosen, on = time.process_time(), frozenset(row.effect for row in rows if row.on)
        if on not in known:
            capture = simulate_scene(radar_scene, rows).capture
            known[on] = time.process_time() - chosen, capture
        found[mm] = chosen - start, known[on][0], (known[on][1], rows)
    return found


def unbroken(frames: dict[str, pd.DataFrame]) -> None:
    """HandbenchError where auto breaks its tolerance."""
    broken = frames["rows"][~frames["rows"].kept.astype(bool)]
    if len(broken):
        raise HandbenchError(
            f"auto: breaks its tolerance in {len(broken)} cases: {', '.join(broken.scene)}"
        )


def main() -> None:
    """Measure, write the files of a study, print the tables"""
    prog, purpose = (
        "python -m tests.bench.studies.ablation.measure_auto",
        'What effects = "auto" chooses.',
    )
    parser = argparse.ArgumentParser(prog=prog, description=purpose)
    shown = f"default: those in {SCENES.name}/ beside this script"
    parser.add_argument("scenes", nargs="*", type=Path, metavar="SCENE.toml", help=shown)
    parser.add_argument(
        "--tolerances", default="0.1,1", help="of auto, mm, separated by commas (default 0.1,1)"
    )
    parser.add_argument(
        "--seeds",
        type=int,
        default=0,
        help="random scenes of that many seeds instead (default none)",
    )
    measured(parser, study, "auto", unbroken)


if __name__ == "__main__":
    main()
