"""The outcome of a run, scored and written as a result folder."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from bench import results
from bench.datasets.native import CaptureFile
from bench.evaluation.error_causes import Scored, explain
from bench.evaluation.floor import budget
from bench.evaluation.metrics import TITLES, of_captures
from bench.evaluation.rows import accuracy_rows, metric_facts, precision_rows, time_rows
from bench.evaluation.scoring_protocols import protocol
from bench.evaluation.statistics.intervals import note
from bench.evaluation.statistics.paired import compare
from bench.results import REFERENCES, About, CaptureFacts, Failure, MethodFacts, Surface
from bench.results.about import MEASURES, Measure
from bench.results.error_map import ErrorMap
from bench.results.tables import COMPARISONS, REPEATS, TABLE, TASKS, frame
from bench.run.benchmark_file import BenchFile, MethodEntry
from bench.run.repeat_stage import read_repeats
from bench.run.scoring import Files, read_errors, read_reference
from calibration.transforms import Transform
from groundtruth.mesh.depth import Reference
from radar.data.depthmap import load_depthmap
from radar.imaging.device import describe
from radar.support.cost import calibrated_machine
from radar.support.errors import HandbenchError
from radar.support.files import atomic_path
from radar.support.folder import drop
from radar.support.progress import say
from radar.support.store import versions

Line = tuple[Any, ...]  # of a table, in the order of its columns
CSV = ("table", "tasks", "repeats", "comparisons", "causes", "reliability")
FILES = ("result.json", "config.toml", "errors", "depth", "photos", *(f"{name}.csv" for name in CSV))


@dataclass
class Capture:
    """A capture of the run: its folder, the hash that stands for its content, its description, what it measures."""

    folder: Path
    key: str
    about: CaptureFile
    measures: tuple[Measure, ...] = MEASURES

    @property
    def name(self) -> str:
        """The name of its files and of its rows."""
        return self.about.name


@dataclass
class Outcome:
    """All that the stages of a run have found. Keys are names of captures and ids of methods; tasks, repeats: lines of
    `TASKS` and `REPEATS`; maps: files of depth maps; deviations, scores: folders of the stages `repeat` and `score`;
    machines: facts of those that did the work, by name."""

    bench: BenchFile
    captures: list[Capture]
    tasks: list[Line]
    failures: list[Failure] = field(default_factory=list)
    references: dict[str, dict[str, tuple[Path, Transform]]] = field(default_factory=dict)
    configs: dict[tuple[str, str], dict[str, Any]] = field(default_factory=dict)
    maps: dict[tuple[str, str], Path] = field(default_factory=dict)
    seconds: dict[tuple[str, str], list[float]] = field(default_factory=dict)
    repeats: list[Line] = field(default_factory=list)
    deviations: dict[tuple[str, str], Path] = field(default_factory=dict)
    scores: dict[str, Path] = field(default_factory=dict)
    views: dict[str, Path] = field(default_factory=dict)
    inputs: dict[str, str] = field(default_factory=dict)
    facts: dict[str, Any] = field(default_factory=dict)
    machines: dict[str, dict[str, Any]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.inputs |= {capture.name: capture.key for capture in self.captures}


@dataclass(frozen=True)
class Basis:
    """The captures and methods that a table stands on: every method on the same captures. repeated: those of the
    precision."""

    captures: tuple[Capture, ...]
    methods: tuple[MethodEntry, ...]
    text: str
    repeated: tuple[Capture, ...]

    @property
    def all_captures(self) -> tuple[Capture, ...]:
        """Those of the accuracy, then those of the precision alone."""
        return (*self.captures, *(capture for capture in self.repeated if capture not in self.captures))


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
    """The captures of the accuracy that all methods have finished, every stage of them. A method that finished fewer
    than half as many as the best one is left out, for it would take the others' captures away; so is the weakest while
    no capture is common to all. Nothing left is a HandbenchError. The precision stands on those of these captures that
    measure it, and on the captures of the precision alone that all methods with a precision have finished; of these a
    method may be left out in the same way, and then has no precision."""
    scored = _finished(outcome, [c for c in outcome.captures if "accuracy" in c.measures], outcome.bench.method)
    kept, common = _shared(scored)
    if not kept:
        raise HandbenchError(f"every capture failed; the first: {outcome.failures[0].message}")
    sources = outcome.bench.capture
    alone = [capture for capture in outcome.captures if capture.measures == ("precision",)]
    precise = [entry for entry in outcome.bench.method if entry.id in kept and entry.precision]
    repeated = _finished(outcome, alone, precise)
    steady, also = _shared(repeated)
    text = _stands_on(scored, kept, common, sum("accuracy" in source.measures for source in sources))
    if precise and (total := sum(source.measures == ("precision",) for source in sources)):
        text += f"; the precision alone: {_stands_on(repeated, steady, also, total)}"
    return Basis(
        tuple(capture for capture in outcome.captures if capture.name in common),
        tuple(entry for entry in outcome.bench.method if entry.id in kept),
        text,
        tuple(c for c in outcome.captures if c.name in common | also and "precision" in c.measures),
    )


def _finished(outcome: Outcome, captures: list[Capture], methods: Sequence[MethodEntry]) -> dict[str, set[str]]:
    """Method → names of the captures of which it finished every stage."""
    lost = {(failure.capture, failure.method) for failure in outcome.failures}
    return {entry.id: {c.name for c in captures if not lost & {(c.name, ""), (c.name, entry.id)}} for entry in methods}


def _shared(finished: dict[str, set[str]]) -> tuple[list[str], set[str]]:
    """The methods that are kept, and the captures that all of them have finished."""
    most = max(map(len, finished.values()), default=0)
    kept = [id for id, names in finished.items() if 2 * len(names) >= most > 0]
    while kept and not set.intersection(*(finished[id] for id in kept)):
        kept.remove(min(reversed(kept), key=lambda id: len(finished[id])))
    return kept, set.intersection(*(finished[id] for id in kept)) if kept else set()


def _stands_on(finished: dict[str, set[str]], kept: list[str], common: set[str], total: int) -> str:
    text = f"{len(common)} of {total} captures: those that every method of the table finished"
    without = [f"{id} ({len(names)} of {total})" for id, names in finished.items() if id not in kept]
    return text + (f"; methods left out, with the captures that they finished: {', '.join(without)}" if without else "")


def write(folder: Path, outcome: Outcome, config: str) -> None:
    """Score everything, then write the result folder; earlier results give way only when the new ones stand, and
    result.json, which says that the folder is complete, comes last."""
    on = basis(outcome)
    if outcome.failures:
        say(f"the table stands on {on.text}")
    rows, compared = tabulate(outcome, on), comparisons(outcome, on)
    drop(folder, FILES)
    for capture, entry in product(on.captures, on.methods):
        name = capture.name
        _copy(outcome.maps[name, entry.id], results.depth_path(folder, name, entry.id))
        for reference in outcome.references[name]:
            about_map = name, entry.id, reference
            _copy(results.errors_path(outcome.scores[name], *about_map), results.errors_path(folder, *about_map))
            if entry is on.methods[0]:  # references are drawn on the first method's grid
                results.write_surface(folder, name, reference, _surface(outcome, *about_map))
    for capture in on.captures:
        if capture.name in outcome.views:
            results.write_photo(folder, capture.name, outcome.views[capture.name])
    results.write_config(folder, config)
    names, methods = [capture.name for capture in on.repeated], [entry.id for entry in on.methods]
    repeats = repeated(outcome)
    repeats = repeats[repeats.capture.isin(names) & repeats.method.isin(methods)]
    results.write_tables(folder, **explain(_scored(outcome, on)))
    tasks = frame(TASKS, outcome.tasks)
    results.write_tables(folder, table=rows, tasks=tasks, comparisons=compared, repeats=repeats)
    results.write_about(folder, about(outcome, on))


def _copy(source: Path, path: Path) -> None:
    with atomic_path(path) as temporary:
        shutil.copyfile(source, temporary)


def _surface(outcome: Outcome, capture: str, method: str, reference: str) -> Surface:
    """The reference on the method's grid."""
    error, found = errors(outcome, [capture], method, reference)[0], surfaces(outcome, [capture], method, reference)[0]
    return Surface(error.x_m, error.y_m, found.z_m, found.sigma_m)


def errors(outcome: Outcome, captures: Sequence[str], method: str, reference: str) -> Sequence[ErrorMap]:
    """A method's error maps of some captures, read one at a time."""
    return Files(lambda name: read_errors(outcome.scores[name], name, method, reference), captures)


def surfaces(outcome: Outcome, captures: Sequence[str], method: str, reference: str) -> Sequence[Reference]:
    """The references with which `errors` were found."""

    def read(name: str) -> Reference:
        return read_reference(outcome.scores[name], method, reference, outcome.references[name][reference][1])

    return Files(read, captures)


def _scored(outcome: Outcome, on: Basis) -> Iterator[Scored]:
    """Every depth map of the table with its errors against each reference, capture by capture."""
    for name in (capture.name for capture in on.captures):
        for reference, entry in product(outcome.references[name], on.methods):
            error = errors(outcome, [name], entry.id, reference)[0]
            yield Scored(entry.id, reference, load_depthmap(outcome.maps[name, entry.id]), error)


def _deviations(outcome: Outcome, captures: Sequence[str], method: str) -> Sequence[ErrorMap]:
    return Files(lambda name: read_repeats(outcome.deviations[name, method])[1], captures)


def repeated(outcome: Outcome) -> pd.DataFrame:
    """Every repeat's depth of the strongest scatterer, as `REPEATS`."""
    return frame(REPEATS, outcome.repeats)


def tabulate(outcome: Outcome, on: Basis) -> pd.DataFrame:
    """The result's `TABLE`, one block per reference."""
    rows, repeats = [frame(TABLE)], repeated(outcome)
    seed, chosen = outcome.bench.seed, protocol(outcome.bench.protocol)
    names, precise = [capture.name for capture in on.captures], [capture.name for capture in on.repeated]
    for reference in REFERENCES:
        for entry in on.methods:
            scored = [name for name in names if reference in outcome.references[name]]
            if not scored:
                continue
            about_maps = outcome, scored, entry.id, reference
            maps, found = errors(*about_maps), surfaces(*about_maps)
            rows.append(accuracy_rows(entry.id, reference, maps, seed, found, chosen))
            if entry.precision and precise and "precision_mm" in chosen.metrics:
                several = [name for name in precise if (name, entry.id) in outcome.deviations]
                deviations = _deviations(outcome, several, entry.id) if several else None
                rows.append(precision_rows(entry.id, reference, _strongest(repeats, precise, entry.id), deviations))
            seconds = [s for capture in on.all_captures for s in outcome.seconds.get((capture.name, entry.id), [])]
            rows.append(time_rows(entry.id, reference, seconds, seed))
    table = pd.concat(rows)
    return table if outcome.bench.reproduces else table.assign(paper=np.nan)


def comparisons(outcome: Outcome, on: Basis) -> pd.DataFrame:
    """Every pair of methods by the protocol's compared metrics, against each reference that all captures have."""
    titles = {entry.id: TITLES.get(entry.id, entry.id) for entry in on.methods}
    lines = [frame(COMPARISONS)]
    for reference in REFERENCES:
        names = [c.name for c in on.captures if reference in outcome.references[c.name]]
        found = {entry.id: of_captures(errors(outcome, names, entry.id, reference)) for entry in on.methods}
        for metric in protocol(outcome.bench.protocol).compared if names else ():
            figures = {method: captures[metric].to_numpy() for method, captures in found.items()}
            lines.append(compare(figures, reference, metric, titles))
    return pd.concat(lines)


def about(outcome: Outcome, on: Basis) -> About:
    """Content of result.json."""
    first = on.methods[0].id
    measured = [c.name for c in on.captures if "photogrammetry" in outcome.references[c.name]]
    budgets = dict(zip(measured, map(budget, surfaces(outcome, measured, first, "photogrammetry")), strict=True))
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
                measures=capture.measures,
                pose=capture.about.pose,
                distance_m=capture.about.distance_m,
                references=tuple(outcome.references.get(capture.name, ())),
                effects=tuple(choice.model_dump(mode="json") for choice in capture.about.effects),
            )
            for capture in on.all_captures
        ),
        methods=tuple(
            MethodFacts(
                name=entry.id,
                title=TITLES.get(entry.id, entry.id),
                config={
                    c.name: outcome.configs[c.name, entry.id]
                    for c in on.all_captures
                    if (c.name, entry.id) in outcome.configs
                },
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


def _strongest(repeats: pd.DataFrame, names: list[str], method_id: str) -> list[np.ndarray]:
    """Each capture's depths of the strongest scatterer [repeats]."""
    mine = repeats[repeats.method == method_id]
    return [mine.z_m[mine.capture == name].to_numpy() for name in names]
