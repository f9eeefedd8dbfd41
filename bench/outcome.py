"""What a run found, scored and written as a result folder."""

from __future__ import annotations

import shutil
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from bench import results
from bench.datasets.native import CaptureFile
from bench.floor import budget
from bench.measure import machine
from bench.metrics import ErrorMap, error_map
from bench.paper import TITLES
from bench.protocol import PROTOCOL, BenchFile
from bench.results import REFERENCES, About, CaptureFacts, MethodFacts, Repeat, Row, Surface, Task
from bench.stages import reference_depth
from bench.table import accuracy_rows, metric_facts, precision_rows, time_rows
from calibration.transforms import Transform
from groundtruth.depth import Reference
from radar.depthmap import DepthMap
from radar.device import describe
from radar.errors import HandbenchError
from radar.grid import PixelGrid
from radar.kept import versions

FILES = ("result.json", "table.csv", "tasks.csv", "repeats.csv", "config.toml", "errors", "depth", "photos")
Errors = dict[tuple[str, str, str], ErrorMap]
References = dict[tuple[str, str, str], Reference]


@dataclass
class Capture:
    """A capture of the run: its folder, the hash that stands for its content, its description."""

    folder: Path
    key: str
    about: CaptureFile

    @property
    def name(self) -> str:
        """The name of its files and of its rows."""
        return self.about.name


@dataclass
class Outcome:
    """What the stages of a run have found. Keys are names of captures and ids of methods."""

    bench: BenchFile
    captures: list[Capture]
    tasks: list[Task]
    references: dict[str, dict[str, tuple[Path, Transform]]] = field(default_factory=dict)
    configs: dict[tuple[str, str], dict[str, Any]] = field(default_factory=dict)
    maps: dict[tuple[str, str], DepthMap] = field(default_factory=dict)
    seconds: dict[str, list[float]] = field(default_factory=dict)
    repeats: list[Repeat] = field(default_factory=list)
    views: dict[str, Path] = field(default_factory=dict)
    inputs: dict[str, str] = field(default_factory=dict)
    facts: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        names = [capture.name for capture in self.captures]
        for capture in self.captures:
            if names.count(capture.name) > 1:
                raise HandbenchError(f"capture: two captures are named '{capture.name}'; give each its own name")
            self.inputs[capture.name] = capture.key


def write(folder: Path, outcome: Outcome, config: str) -> None:
    """Score everything, then write the result folder; earlier results give way only when the new ones stand, and
    result.json, which says that the folder is complete, comes last."""
    errors, references = score(outcome)
    rows = tabulate(outcome, errors, references)
    _drop_results(folder)
    for (name, method_id), depth in outcome.maps.items():
        depth.save(results.depth_path(folder, name, method_id))
    for (name, method_id, reference), error in errors.items():
        results.write_errors(folder, name, method_id, reference, error)
        if method_id == outcome.bench.method[0].id:  # references are drawn on the first method's grid
            found = references[name, method_id, reference]
            results.write_surface(folder, name, reference, Surface(error.x_m, error.y_m, found.z_m, found.sigma_m))
    for name, view in outcome.views.items():
        results.write_photo(folder, name, view)
    results.write_config(folder, config)
    results.write_table(folder, rows)
    results.write_tasks(folder, outcome.tasks)
    results.write_repeats(folder, outcome.repeats)
    results.write_about(folder, about(outcome, references))


def score(outcome: Outcome) -> tuple[Errors, References]:
    """Errors of every depth map against every reference, and the reference's depth on the same grid."""
    errors: Errors = {}
    references: References = {}
    for name, files in outcome.references.items():
        for reference, (file, transform) in files.items():
            cast: dict[bytes, Reference] = {}  # methods that share a grid share the reference's depth
            for entry in outcome.bench.method:
                depth = outcome.maps[name, entry.id]
                grid = depth.x_m.tobytes() + b"|" + depth.y_m.tobytes()
                if grid not in cast:
                    pixels = PixelGrid(depth.x_m, depth.y_m)
                    cast[grid] = reference_depth(file, transform, pixels, exact=reference == "truth")
                errors[name, entry.id, reference] = error_map(depth.x_m, depth.y_m, depth.z_m, cast[grid].z_m)
                references[name, entry.id, reference] = cast[grid]
    return errors, references


def tabulate(outcome: Outcome, errors: Errors, references: References) -> list[Row]:
    """The table's rows, one block per reference."""
    rows: list[Row] = []
    seed = outcome.bench.seed
    for reference in REFERENCES:
        for entry in outcome.bench.method:
            scored = [key for key in errors if key[1:] == (entry.id, reference)]
            if not scored:
                continue
            maps, surfaces = [errors[key] for key in scored], [references[key] for key in scored]
            rows += accuracy_rows(entry.id, reference, maps, seed, surfaces)
            if entry.precision:
                rows += precision_rows(entry.id, reference, _strongest(outcome, entry.id))
            rows += time_rows(entry.id, reference, outcome.seconds[entry.id], seed)
    return rows


def about(outcome: Outcome, references: References) -> About:
    """What result.json says."""
    budgets = {
        name: budget(found) for (name, method_id, reference), found in references.items()
        if (method_id, reference) == (outcome.bench.method[0].id, "photogrammetry")
    }
    return About(
        name=outcome.bench.name,
        protocol={**PROTOCOL, "repeats": outcome.bench.repeats, "seed": outcome.bench.seed},
        metrics=metric_facts(),
        inputs=outcome.inputs,
        versions=versions(),
        machine={**machine(), "imaging_device": describe()},
        captures=tuple(
            CaptureFacts(
                name=capture.name,
                pose=capture.about.pose,
                distance_m=capture.about.distance_m,
                references=tuple(outcome.references[capture.name]),
            )
            for capture in outcome.captures
        ),
        methods=tuple(
            MethodFacts(
                name=entry.id,
                title=TITLES.get(entry.id, entry.id),
                config={c.name: outcome.configs[c.name, entry.id] for c in outcome.captures},
            )
            for entry in outcome.bench.method
        ),
        facts={
            **outcome.facts,
            **({"groundtruth_sigma_rms": budgets} if budgets else {}),
            "phase_noise_rad": outcome.bench.phase_noise_rad,
        },
    )


def _strongest(outcome: Outcome, method_id: str) -> list[np.ndarray]:
    """Each capture's depths of the strongest scatterer [repeats]."""
    return [
        np.array([r.z_m for r in outcome.repeats if (r.capture, r.method) == (capture.name, method_id)])
        for capture in outcome.captures
    ]


def _drop_results(folder: Path) -> None:
    """Remove what is about to be written anew (result.json first) and what a killed run left half-written of it."""
    half_written = [p for p in folder.iterdir() if any(p.name.startswith(f".{Path(name).stem}-") for name in FILES)]
    for path in [folder / name for name in FILES] + half_written:
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)
