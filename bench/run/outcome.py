"""The outcome of a run: what its stages found, and which captures and methods its table
contains."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from handbench.bench.datasets.native import CaptureFile
from handbench.bench.results import Failure
from handbench.bench.results.about import MEASURES, Measure
from handbench.bench.run.benchmark_file import BenchFile, MethodEntry
from handbench.bench.run.scoring import read_reference
from handbench.calibration.transforms import Transform
from handbench.groundtruth.mesh.depth import Reference
from handbench.support.errors import HandbenchError
from handbench.support.progress import say

Line = tuple[Any, ...]  # of a table, in the order of its columns


@dataclass
class RunCapture:
    """A capture of the run: its folder, the hash of its content (key), its description (about), and
    what is measured on it ("accuracy", "precision" or both)."""

    folder: Path
    key: str
    about: CaptureFile
    measures: tuple[Measure, ...] = MEASURES

    @property
    def name(self) -> str:
        """The capture's name, used in names of files and rows of tables."""
        return self.about.name


@dataclass
class Outcome:
    """Everything that the stages of a run found. Dictionaries are keyed by the capture's name, or
    by capture and method id.
    tasks: lines of the table of stages with their times. repeats: lines with capture, method, frame
    and depth of the strongest scatterer, m. references: reference → mesh file and transform.
    configs: complete settings of the methods. maps: files of depth maps. seconds: imaging times of
    the frames, s. deviations, scores: folders of the stages that measured precision and errors.
    views: photographs to show in the report. inputs: hashes of the captures. facts: further entries
    of result.json. machines: facts of the machines that did the work, by host name."""

    bench: BenchFile
    captures: list[RunCapture]
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
class CommonSubset:
    """The captures and methods of a result's table, chosen so that every method has every capture.
    captures: those for the accuracy; repeated: those for the precision; text: words that say how
    many captures and which methods were left out."""

    captures: tuple[RunCapture, ...]
    methods: tuple[MethodEntry, ...]
    text: str
    repeated: tuple[RunCapture, ...]

    @property
    def all_captures(self) -> tuple[RunCapture, ...]:
        """The captures for the accuracy, followed by those that measure only the precision."""
        return (
            *self.captures,
            *(capture for capture in self.repeated if capture not in self.captures),
        )


@contextmanager
def recorded_failure(
    failures: list[Failure], capture: str, stage: str, method: str = ""
) -> Iterator[None]:
    """Context manager that catches a HandbenchError, prints it and appends it to `failures`, so
    that the run goes on.
    capture, stage, method: what is recorded with the error; method is "" if the capture fails for
    all methods."""
    try:
        yield
    except HandbenchError as error:
        failures.append(Failure(capture=capture, method=method, stage=stage, message=str(error)))
        say(failures[-1].line)


def common_subset(outcome: Outcome) -> CommonSubset:
    """Select the captures and methods of the result's table, so that every method has every
    capture.

    The accuracy uses the captures for which all selected methods finished every stage. A method
    that finished fewer than half as many captures as the best one is left out, because it would
    remove the other methods' captures. While no capture is common to all methods, the one with the
    fewest captures is left out too. Raises HandbenchError if nothing remains.

    The precision uses those of the selected captures that measure it. Captures that measure only
    the precision are added if all methods with a precision finished them. Methods are left out of
    the precision by the same rule, and stay in the table.
    """
    scored = _finished(
        outcome, [c for c in outcome.captures if "accuracy" in c.measures], outcome.bench.method
    )
    kept, common = _shared(scored)
    if not kept:
        raise HandbenchError(
            f"every capture failed; the error of the first: {outcome.failures[0].message}"
        )
    sources = outcome.bench.capture
    only_precise = [capture for capture in outcome.captures if capture.measures == ("precision",)]
    precise = [entry for entry in outcome.bench.method if entry.id in kept and entry.precision]
    repeated = _finished(outcome, only_precise, precise)
    steady, also = _shared(repeated)
    text = _stands_on(
        scored, kept, common, sum("accuracy" in source.measures for source in sources)
    )
    if precise and (total := sum(source.measures == ("precision",) for source in sources)):
        text += f"; for the precision only: {_stands_on(repeated, steady, also, total)}"
    return CommonSubset(
        tuple(capture for capture in outcome.captures if capture.name in common),
        tuple(entry for entry in outcome.bench.method if entry.id in kept),
        text,
        tuple(c for c in outcome.captures if c.name in common | also and "precision" in c.measures),
    )


def _finished(
    outcome: Outcome, captures: list[RunCapture], methods: Sequence[MethodEntry]
) -> dict[str, set[str]]:
    """Find the captures for which each method finished every stage: method id → names of the
    captures."""
    lost = {(failure.capture, failure.method) for failure in outcome.failures}
    return {
        entry.id: {c.name for c in captures if not lost & {(c.name, ""), (c.name, entry.id)}}
        for entry in methods
    }


def _shared(finished: dict[str, set[str]]) -> tuple[list[str], set[str]]:
    """Choose the methods that stay in the table; return them, and the captures that all of them
    finished.
    finished: method → names of the captures that it finished. Methods with fewer than half as many
    captures as the best one are left out; then the weakest ones, while no capture is common to
    all."""
    most = max(map(len, finished.values()), default=0)
    kept = [id for id, names in finished.items() if 2 * len(names) >= most > 0]
    while kept and not set.intersection(*(finished[id] for id in kept)):
        kept.remove(min(reversed(kept), key=lambda id: len(finished[id])))
    return kept, set.intersection(*(finished[id] for id in kept)) if kept else set()


def _stands_on(finished: dict[str, set[str]], kept: list[str], common: set[str], total: int) -> str:
    text = f"{len(common)} of {total} captures: those that every method of the table finished"
    without = [
        f"{id} ({len(names)} of {total})" for id, names in finished.items() if id not in kept
    ]
    return text + (
        f"; methods left out, with the captures that they finished: {', '.join(without)}"
        if without
        else ""
    )


def surfaces(
    outcome: Outcome, captures: Sequence[str], method: str, reference: str
) -> Iterator[Reference]:
    """Yield the reference surface of each named capture on the pixel grid of the method's depth
    map."""
    for name in captures:
        _, transform = outcome.references[name][reference]
        yield read_reference(outcome.scores[name], name, method, reference, transform)
