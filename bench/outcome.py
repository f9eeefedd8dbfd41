"""What a run found, scored and written as a result folder."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from bench import results
from bench.comparison import Comparison, compare
from bench.datasets.dataset import open_capture
from bench.datasets.native import CaptureFile
from bench.floor import budget
from bench.measure import calibrated_machine
from bench.metrics import ErrorMap, error_map
from bench.paper import TITLES
from bench.protocol import BenchFile, MethodEntry
from bench.protocols import protocol
from bench.results import REFERENCES, About, CaptureFacts, Failure, MethodFacts, Repeat, Row, Surface, Task
from bench.stages import reference_depth
from bench.statistics import note
from bench.table import accuracy_rows, metric_facts, precision_rows, time_rows
from calibration.transforms import Transform
from groundtruth.depth import Reference
from radar.depthmap import DepthMap, load_depthmap
from radar.device import describe
from radar.errors import HandbenchError
from radar.files import atomic_path
from radar.grid import PixelGrid
from radar.kept import versions
from radar.progress import say

FILES = (
    "result.json", "table.csv", "tasks.csv", "repeats.csv", "comparisons.csv", "config.toml", "errors", "depth",
    "photos",
)
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
    """What the stages of a run have found. Keys are names of captures and ids of methods; maps: files of depth maps;
    machines: facts of those that did the work, by name."""

    bench: BenchFile
    captures: list[Capture]
    tasks: list[Task]
    failures: list[Failure] = field(default_factory=list)
    references: dict[str, dict[str, tuple[Path, Transform]]] = field(default_factory=dict)
    configs: dict[tuple[str, str], dict[str, Any]] = field(default_factory=dict)
    maps: dict[tuple[str, str], Path] = field(default_factory=dict)
    seconds: dict[tuple[str, str], list[float]] = field(default_factory=dict)
    repeats: list[Repeat] = field(default_factory=list)
    deviations: dict[tuple[str, str], ErrorMap] = field(default_factory=dict)
    views: dict[str, Path] = field(default_factory=dict)
    inputs: dict[str, str] = field(default_factory=dict)
    facts: dict[str, Any] = field(default_factory=dict)
    machines: dict[str, dict[str, Any]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.inputs |= {capture.name: capture.key for capture in self.captures}


@dataclass(frozen=True)
class Basis:
    """The captures and methods that a table stands on: every method on the same captures."""

    captures: tuple[Capture, ...]
    methods: tuple[MethodEntry, ...]
    text: str


@contextmanager
def failing(failures: list[Failure], capture: str, stage: str, method: str = "") -> Iterator[None]:
    """An error that the user can mend is said and kept as a failure of the capture (for one method, if one is named),
    and does not end the run."""
    try:
        yield
    except HandbenchError as error:
        failures.append(Failure(capture=capture, method=method, stage=stage, message=str(error)))
        say(failures[-1].line)


def basis(outcome: Outcome) -> Basis:
    """The captures that all methods have finished, every stage of them. A method that finished fewer than half as many
    as the best one is left out, for it would take the others' captures away; so is the weakest while no capture is
    common to all. Nothing left is a HandbenchError."""
    lost = {(failure.capture, failure.method) for failure in outcome.failures}
    finished = {
        entry.id: {c.name for c in outcome.captures if not lost & {(c.name, ""), (c.name, entry.id)}}
        for entry in outcome.bench.method
    }
    most = max(map(len, finished.values()))
    kept = [id for id, names in finished.items() if 2 * len(names) >= most > 0]
    while kept and not set.intersection(*(finished[id] for id in kept)):
        kept.remove(min(reversed(kept), key=lambda id: len(finished[id])))
    if not kept:
        raise HandbenchError(f"every capture failed; the first: {outcome.failures[0].message}")
    common = set.intersection(*(finished[id] for id in kept))
    total = len(outcome.bench.capture)
    text = f"{len(common)} of {total} captures: those that every method of the table finished"
    without = [f"{id} ({len(names)} of {total})" for id, names in finished.items() if id not in kept]
    return Basis(
        tuple(capture for capture in outcome.captures if capture.name in common),
        tuple(entry for entry in outcome.bench.method if entry.id in kept),
        text + (f"; methods left out, with the captures that they finished: {', '.join(without)}" if without else ""),
    )


def write(folder: Path, outcome: Outcome, config: str) -> None:
    """Score everything, then write the result folder; earlier results give way only when the new ones stand, and
    result.json, which says that the folder is complete, comes last."""
    errors, references = score(outcome)
    on = basis(outcome)
    if outcome.failures:
        say(f"the table stands on {on.text}")
    rows = tabulate(outcome, on, errors, references)
    _drop_results(folder)
    for capture, entry in product(on.captures, on.methods):
        name = capture.name
        with atomic_path(results.depth_path(folder, name, entry.id)) as temporary:
            shutil.copyfile(outcome.maps[name, entry.id], temporary)
        for reference in outcome.references[name]:
            error = errors[name, entry.id, reference]
            results.write_errors(folder, name, entry.id, reference, error)
            if entry is on.methods[0]:  # references are drawn on the first method's grid
                found = references[name, entry.id, reference]
                results.write_surface(folder, name, reference, Surface(error.x_m, error.y_m, found.z_m, found.sigma_m))
    for capture in on.captures:
        if capture.name in outcome.views:
            results.write_photo(folder, capture.name, outcome.views[capture.name])
    results.write_config(folder, config)
    results.write_table(folder, rows)
    results.write_tasks(folder, outcome.tasks)
    results.write_comparisons(folder, comparisons(outcome, on, errors))
    stands = set(product((c.name for c in on.captures), (entry.id for entry in on.methods)))
    results.write_repeats(folder, [r for r in outcome.repeats if (r.capture, r.method) in stands])
    results.write_about(folder, about(outcome, on, references))


def score(outcome: Outcome) -> tuple[Errors, References]:
    """Errors of every depth map against every reference, and the reference's depth on the same grid; a capture that
    cannot be scored fails."""
    errors: Errors = {}
    references: References = {}
    chosen = protocol(outcome.bench.protocol)
    folders = {capture.name: capture.folder for capture in outcome.captures}
    for name, files in outcome.references.items():
        with failing(outcome.failures, name, "score"):
            for reference, (file, transform) in files.items():
                cast: dict[bytes, Reference] = {}  # methods that share a grid share the reference's depth
                for entry in outcome.bench.method:
                    if (name, entry.id) not in outcome.maps:
                        continue
                    depth = load_depthmap(outcome.maps[name, entry.id])
                    grid = depth.x_m.tobytes() + b"|" + depth.y_m.tobytes()
                    if grid not in cast:
                        pixels = PixelGrid(depth.x_m, depth.y_m)
                        cast[grid] = reference_depth(file, transform, pixels, exact=reference == "truth")
                    found = cast[grid]
                    z_m = chosen.scored(_masked(depth, folders[name]) if chosen.masks else depth.z_m)
                    errors[name, entry.id, reference] = error_map(
                        depth.x_m, depth.y_m, z_m, found.z_m, found.sigma_m, found.met
                    )
                    references[name, entry.id, reference] = cast[grid]
    return errors, references


def _masked(depth: DepthMap, capture: Path) -> np.ndarray:
    """Depths [ny, nx] of the pixels that the capture's data set scores, NaN elsewhere."""
    return np.where(open_capture(capture).mask(depth), depth.z_m, np.nan)


def tabulate(outcome: Outcome, on: Basis, errors: Errors, references: References) -> list[Row]:
    """The table's rows, one block per reference."""
    rows: list[Row] = []
    seed, chosen = outcome.bench.seed, protocol(outcome.bench.protocol)
    names = [capture.name for capture in on.captures]
    for reference in REFERENCES:
        for entry in on.methods:
            scored = [(name, entry.id, reference) for name in names if (name, entry.id, reference) in errors]
            if not scored:
                continue
            maps, surfaces = [errors[key] for key in scored], [references[key] for key in scored]
            rows += accuracy_rows(entry.id, reference, maps, seed, surfaces, chosen)
            if entry.precision and "precision_mm" in chosen.metrics:
                repeated = [(name, entry.id) for name in names if (name, entry.id) in outcome.deviations]
                deviations = [outcome.deviations[key] for key in repeated] or None
                rows += precision_rows(entry.id, reference, _strongest(outcome, names, entry.id), deviations)
            seconds = [s for name in names for s in outcome.seconds[name, entry.id]]
            rows += time_rows(entry.id, reference, seconds, seed)
    return rows


def comparisons(outcome: Outcome, on: Basis, errors: Errors) -> list[Comparison]:
    """Every pair of methods by the protocol's compared metrics, against each reference that all captures have."""
    titles = {entry.id: TITLES.get(entry.id, entry.id) for entry in on.methods}
    lines: list[Comparison] = []
    for reference in REFERENCES:
        names = [c.name for c in on.captures if reference in outcome.references[c.name]]
        maps = {entry.id: [errors[name, entry.id, reference] for name in names] for entry in on.methods}
        for metric in protocol(outcome.bench.protocol).compared if names else ():
            lines += compare(maps, reference, metric, titles)
    return lines


def about(outcome: Outcome, on: Basis, references: References) -> About:
    """What result.json says."""
    first = on.methods[0].id
    budgets = {
        capture.name: budget(references[capture.name, first, "photogrammetry"])
        for capture in on.captures if "photogrammetry" in outcome.references[capture.name]
    }
    return About(
        name=outcome.bench.name,
        protocol={
            **protocol(outcome.bench.protocol).about(),
            "basis": on.text,
            "repeats": outcome.bench.repeats,
            "seed": outcome.bench.seed,
        },
        metrics=metric_facts(),
        inputs=outcome.inputs,
        versions=versions(),
        machine=_machines(outcome),
        captures=tuple(
            CaptureFacts(
                name=capture.name,
                pose=capture.about.pose,
                distance_m=capture.about.distance_m,
                references=tuple(outcome.references[capture.name]),
            )
            for capture in on.captures
        ),
        methods=tuple(
            MethodFacts(
                name=entry.id,
                title=TITLES.get(entry.id, entry.id),
                config={c.name: outcome.configs[c.name, entry.id] for c in on.captures},
            )
            for entry in on.methods
        ),
        facts={
            **outcome.facts,
            "intervals": note(len(on.captures)),
            **({"groundtruth_sigma_rms": budgets} if budgets else {}),
            "phase_noise_rad": outcome.bench.phase_noise_rad,
        },
        failures=tuple(outcome.failures),
    )


def _machines(outcome: Outcome) -> dict[str, Any]:
    """This machine and, where others did some of the work, they too."""
    here = calibrated_machine()
    others = {name: facts for name, facts in outcome.machines.items() if name != here["host"]}
    return {**here, "imaging_device": describe(), **({"others": others} if others else {})}


def _strongest(outcome: Outcome, names: list[str], method_id: str) -> list[np.ndarray]:
    """Each capture's depths of the strongest scatterer [repeats]."""
    depths_m: dict[str, list[float]] = {name: [] for name in names}
    for repeat in outcome.repeats:
        if repeat.method == method_id and repeat.capture in depths_m:
            depths_m[repeat.capture].append(repeat.z_m)
    return [np.array(values) for values in depths_m.values()]


def _drop_results(folder: Path) -> None:
    """Remove what is about to be written anew (result.json first) and what a killed run left half-written of it."""
    half_written = [p for p in folder.iterdir() if any(p.name.startswith(f".{Path(name).stem}-") for name in FILES)]
    for path in [folder / name for name in FILES] + half_written:
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)
