"""Study of `effects = "auto"`: whether automatically selected effects keep their tolerance compared
with all effects that a scene has a cause for, and how much time they save.

The scenes are from files or of random seeds, and differ in kind.

    python -m handbench.bench.studies.ablation.measure_auto
        [SCENE.toml …] [--tolerances 0.1,1] [--seeds N]
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from handbench.bench.evaluation.tables import declared_tables
from handbench.bench.scenes.build import Scene, load_scene
from handbench.bench.scenes.echoes import choices, echo_scene
from handbench.bench.studies.ablation.assorted_scenes import assorted_scene
from handbench.bench.studies.study import Record, Study, Table, measured, parser
from handbench.radar.data.capture import RadarCapture
from handbench.radar.methods.registry import method
from handbench.radar.simulation.ablation import LOST_MM, Change
from handbench.radar.simulation.catalogue import CONTAINED, EFFECTS
from handbench.radar.simulation.known_effects import Choice
from handbench.radar.simulation.simulate import simulate_scene

SCHEMAS = declared_tables(__file__)
SCENES = Path(__file__).parent / "scenes"
FEW = ("2fsk", "3fsk", "nfsk", "narrowband")  # of the benchmark's methods, those of five tones
MANY = ("broadband", "broadband-subvoxel")
PIXEL_M, FILTER_PX = 2e-3, 3  # of the random scenes' images
BOX_M = (-0.015, 0.065)  # along z about the target's nearest point, as the paper's 80 mm


def study(work: Path, scenes: list[Path], tolerances: str, seeds: int) -> Study:
    """Make the study of `effects = "auto"`: how accurately and how fast it simulates each of
    several scenes.

    work: folder for files. scenes: scene files; if empty, those next to this script, unless seeds >
    0. tolerances: in mm, separated by commas. seeds: number of random scenes to add, with the seeds
    0 to seeds − 1.
    """
    tolerances_mm = tuple(float(text) for text in tolerances.split(","))
    work.mkdir(parents=True, exist_ok=True)
    cases: list[tuple[str, Callable[[], Scene]]] = [
        (path.stem, partial(load_scene, path))
        for path in scenes or ([] if seeds else sorted(SCENES.glob("*.toml")))
    ]
    cases += [(f"seed {seed}", partial(assorted_scene, seed, work)) for seed in range(seeds)]
    return Study(
        "auto",
        cases,
        lambda case: compare(case[1](), tolerances_mm),
        tables,
        label=lambda case: case[0],
        seed=seeds or None,
    )


def tables(records: list[Record]) -> list[Table]:
    """Make two tables from the records: one with a row for each scene and tolerance, and one with a
    summary of each tolerance."""
    known = {"rows": records, "summary": summary(records)}
    return [Table(name, SCHEMAS[name].columns, records) for name, records in known.items()]


def compare(scene: Scene, tolerances_mm: tuple[float, ...]) -> list[Record]:
    """Simulate one frame of a scene with automatically selected effects, and with every effect that
    it has a cause for.

    Returns a record for each tolerance: the effects left out, the change of each method's depth
    map, whether the change is within the tolerance, and CPU seconds.
    """
    radar_scene = echo_scene(scene)
    every = tuple(e.id for e in EFFECTS if e.id not in CONTAINED and not e.missing(radar_scene))
    ways: dict[float | None, dict[str, Any]] = {None: {"effects": every}}
    ways |= {mm: {"effects": "auto", "tolerance_mm": mm} for mm in tolerances_mm}
    listed = {
        mm: replace(scene, file=scene.file.model_copy(update=way)) for mm, way in ways.items()
    }
    timed_round(listed)  # makes plans and compiles
    timed = timed_round(listed)
    capture, all_s = timed[None][2], sum(timed[None][:2])
    whole, records = depth_maps(scene, capture), []
    for mm in tolerances_mm:
        estimate_s, simulate_s, found, rows = timed[mm]
        maps = whole if found is capture else depth_maps(scene, found)
        changes = {name: Change.between(z_m, maps[name]) for name, z_m in whole.items()}
        worst_mm = max(change.depth_mm for change in changes.values())
        pixels = max(change.pixels for change in changes.values())
        records.append(
            {
                "scene": scene.file.name,
                "tolerance_mm": mm,
                "left_out": ", ".join(r.effect for r in rows if r.effect in every and not r.on),
                "kept": worst_mm <= mm and pixels <= mm / LOST_MM,
                "pixels_percent": 100 * pixels,
                **{f"{name}_mm": change.depth_mm for name, change in changes.items()},
                "estimate_s": estimate_s,
                "auto_s": estimate_s + simulate_s,
                "all_s": all_s,
                "ratio": all_s / (estimate_s + simulate_s),
            }
        )
    return records


def summary(rows: list[Record]) -> list[Record]:
    """Make a record for each tolerance: in how many scenes it was kept, and how the CPU times with
    selected and with all effects compare. rows: records of one scene and tolerance each."""
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
                "median_ratio": float(np.median(ratios)) if ratios else None,
                "largest_percent": 100 * max(row["auto_s"] / row["all_s"] for row in these),
                "hands_percent": 100 * max(hands) if hands else None,
            }
        )
    return found


def depth_maps(scene: Scene, capture: RadarCapture) -> dict[str, np.ndarray]:
    """Compute the depth maps of a capture with every method that its tones allow. Returns depths
    [ny, nx] in metres by the method's name.

    Captures with few tones are those of random scenes; their images are placed around the scene's
    target.
    """
    few = len(capture.frequencies_hz) < 100
    maps = {}
    for name in FEW if few else (*FEW, *MANY):
        config = method(name).configure(_around(scene, name) if few else {}, scene.file.name)
        maps[name] = method(name).run(capture, config, 0).depth.z_m
    return maps


def _around(scene: Scene, name: str) -> dict[str, Any]:
    across = {"start_m": -0.15, "stop_m": 0.15, "step_m": PIXEL_M}
    pixels: dict[str, Any] = {"x": across, "y": across}
    if name == "narrowband":
        nearest_m = float(np.asarray(scene.target_mesh.vertices)[:, 2].min())
        low_m, high_m = (round(nearest_m + offset_m, 3) for offset_m in BOX_M)
        return pixels | {"z": {"start_m": low_m, "stop_m": high_m, "step_m": 1e-3}}
    if name != "2fsk":
        pixels |= {"coarse_filter_px": FILTER_PX, "fine_filter_px": FILTER_PX}
    return pixels | {"first_depth_m": scene.file.target.distance_m}


Timed = tuple[float, float, RadarCapture, tuple[Choice, ...]]


def timed_round(listed: dict[float | None, Scene]) -> dict[float | None, Timed]:
    """Simulate several variants of a scene, and time each.

    listed: scenes by their tolerance in mm (None: all effects). Returns, by tolerance: CPU seconds
    of selecting the effects, CPU seconds of the simulation, the capture, and a row for each effect.
    Variants with the same effects share one simulation and its time.
    """
    found: dict[float | None, Timed] = {}
    known: dict[frozenset[str], tuple[float, RadarCapture]] = {}
    for mm, scene in listed.items():
        radar_scene, start_s = echo_scene(scene), time.process_time()
        rows = choices(scene, radar_scene)
        chosen_s, on = time.process_time(), frozenset(row.effect for row in rows if row.on)
        if on not in known:
            capture = simulate_scene(radar_scene, rows).capture
            known[on] = time.process_time() - chosen_s, capture
        found[mm] = (chosen_s - start_s, *known[on], rows)
    return found


def main() -> None:
    """Measure whether automatically selected effects keep their tolerance compared with all
    effects, and how much time they save in each scene; write and print the tables."""
    options = parser("ablation.measure_auto", 'What effects = "auto" chooses.')
    shown = f"default: those in {SCENES.name}/ beside this script"
    options.add_argument("scenes", nargs="*", type=Path, metavar="SCENE.toml", help=shown)
    tolerances = "of auto, mm, separated by commas (default 0.1,1)"
    options.add_argument("--tolerances", default="0.1,1", help=tolerances)
    seeds = "random scenes of that many seeds instead (default none)"
    options.add_argument("--seeds", type=int, default=0, help=seeds)
    measured(options, study, "auto")


if __name__ == "__main__":
    main()
