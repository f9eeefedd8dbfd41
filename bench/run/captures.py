"""The captures of a run: opened where they are recorded, simulated where they are scenes; and those
of its table, chosen so that every method has every capture."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from handbench.bench.benchmarks.benchmark_file import (
    BenchFile,
    MethodEntry,
    Origin,
    require_clear,
    scene_of,
)
from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.native import CaptureFile, NativeCapture
from handbench.bench.datasets.simulated import CAPTURE, simulate
from handbench.bench.evaluation.intervals import counted
from handbench.bench.results.about import MEASURES, Failure, Measure
from handbench.bench.run.engine import Engine
from handbench.bench.scenes.scene_file import named_files
from handbench.support.errors import HandbenchError
from handbench.support.files import content_hash, real
from handbench.support.store import Input, Stage


@dataclass(frozen=True)
class RunCapture:
    """A capture of the run: its folder, the hash of its content (key), its description (about), and
    what is measured on it ("accuracy", "precision" or both), on its first `frames` frames."""

    folder: Path
    key: str
    about: CaptureFile
    measures: tuple[Measure, ...] = MEASURES
    frames: int = 1

    @property
    def name(self) -> str:
        """The capture's name, used in names of files and rows of tables."""
        return self.about.name

    @property
    def accurate(self) -> bool:
        """Whether the capture's depths are compared with a reference."""
        return "accuracy" in self.measures

    @property
    def input(self) -> Input:
        """The capture's folder as the input of a stage."""
        return Input(str(self.folder), self.key)


@dataclass(frozen=True)
class Opened:
    """A capture of a benchmark before its run.
    made: the capture, or the stage that simulates it. measures: what is measured on it. meshed:
    whether a surface is reconstructed from its photographs."""

    made: RunCapture | Stage
    measures: tuple[Measure, ...]
    meshed: bool

    @property
    def name(self) -> str:
        """The capture's name."""
        return self.made.capture if isinstance(self.made, Stage) else self.made.name

    def capture(self, work: Path) -> RunCapture:
        """Return the capture; that of a scene has to be simulated in the store `work`."""
        if isinstance(self.made, RunCapture):
            return self.made
        folder = self.made.folder(work) / CAPTURE
        about, frames = open_capture(folder).about, self.made.arguments["frames"]
        return RunCapture(folder, self.made.key, about, self.measures, frames)

    @property
    def simulation(self) -> list[Stage]:
        """The stage that simulates the capture, if it is a scene."""
        return [self.made] if isinstance(self.made, Stage) else []


def open_captures(engine: Engine, bench: BenchFile, base: Path) -> list[Opened]:
    """Open the captures of a benchmark: folders, and scenes.
    base: folder to which the benchmark's paths are relative. A capture that fails is recorded and
    left out. Raises HandbenchError if two captures have the same name."""
    opened: list[Opened] = []
    for source in bench.capture:
        with engine.attempt(source.scene or source.path or "", "open"):
            opened.append(_open(bench, base, source, source.measures))
    names = [require_clear(one.name, "capture") for one in opened]
    if twice := [name for name in names if names.count(name) > 1]:
        raise HandbenchError(
            f"capture: two captures are named '{twice[0]}'; give each its own name"
        )
    return opened


def open_targets(bench: BenchFile, base: Path) -> list[Opened]:
    """Open the captures of the benchmark's calibration target. Raises HandbenchError if one fails,
    because without the calibration no capture has a reference."""
    return [_open(bench, base, origin, MEASURES) for origin in bench.calibration]


def _open(bench: BenchFile, base: Path, origin: Origin, measures: tuple[Measure, ...]) -> Opened:
    """Open a capture folder, or find the stage that simulates a scene.
    base: folder to which the benchmark's paths are relative."""
    frames, accurate = bench.frames_of(origin), "accuracy" in measures
    if origin.path is not None:
        folder = real(base, origin.path, "capture.path")
        data = open_capture(folder)
        capture = RunCapture(folder, data.key(frames), data.about, measures, frames)
        return Opened(capture, measures, accurate and needs_mesh(data, bool(bench.calibration)))
    scene, file = scene_of(bench, base, origin)
    named = [content_hash(path) for path in named_files(scene, file.parent)]
    arguments = {
        "scene": scene.model_dump(mode="json"),
        "base": Input(str(file.parent), named),
        "frames": frames,
    }
    simulation = Stage(simulate, arguments, scene.name, shares=True)
    meshed = accurate and scene.photos is not None and bool(bench.calibration)
    return Opened(simulation, measures, meshed)


def needs_mesh(data: NativeCapture, calibrated: bool) -> bool:
    """Tell whether a surface has to be reconstructed from a capture's photographs: it has some, it
    has no mesh, and its own file or the benchmark's calibration gives a transform into the radar
    frame."""
    return (
        data.photos is not None
        and data.mesh() is None
        and (calibrated or data.transform() is not None)
    )


@dataclass(frozen=True)
class CommonSubset:
    """The captures and methods of a result's table.
    captures: those for the accuracy; repeated: those for the precision; text: words that say how
    many captures and which methods were left out."""

    captures: tuple[RunCapture, ...]
    methods: tuple[MethodEntry, ...]
    text: str
    repeated: tuple[RunCapture, ...]

    @property
    def all_captures(self) -> tuple[RunCapture, ...]:
        """The captures for the accuracy, followed by those that measure only the precision."""
        further = [capture for capture in self.repeated if capture not in self.captures]
        return (*self.captures, *further)


def common_subset(
    bench: BenchFile, captures: Sequence[RunCapture], failures: Sequence[Failure]
) -> CommonSubset:
    """Select the captures and methods of the result's table, so that every method has every
    capture.

    captures: those that were opened. The accuracy uses the captures for which all selected methods
    finished every stage. A method that finished fewer than half as many captures as the best one is
    left out, because it would remove the other methods' captures. While no capture is common to all
    methods, the one with the fewest captures is left out too. Raises HandbenchError if nothing
    remains.

    The precision uses those of the selected captures that measure it. Captures that measure only
    the precision are added if all methods with a precision finished them. Methods are left out of
    the precision by the same rule, and stay in the table.
    """
    lost = {(failure.capture, failure.method) for failure in failures}

    def finished(some: Sequence[RunCapture], methods: Sequence[str]) -> dict[str, set[str]]:
        """Find the captures for which each method finished every stage."""
        return {
            method: {c.name for c in some if not lost & {(c.name, ""), (c.name, method)}}
            for method in methods
        }

    labels = [entry.label for entry in bench.method]
    scored = finished([capture for capture in captures if capture.accurate], labels)
    kept, common = _shared(scored)
    if not kept:
        raise HandbenchError(f"every capture failed; the error of the first: {failures[0].message}")
    total = sum("accuracy" in source.measures for source in bench.capture)
    text = _basis(scored, kept, common, total)
    precise = [entry.label for entry in bench.method if entry.label in kept and entry.precision]
    repeated = finished([capture for capture in captures if not capture.accurate], precise)
    steady, further = _shared(repeated)
    if precise and (total := sum(s.measures == ("precision",) for s in bench.capture)):
        text += f"; for the precision only: {_basis(repeated, steady, further, total)}"
    return CommonSubset(
        tuple(capture for capture in captures if capture.name in common),
        tuple(entry for entry in bench.method if entry.label in kept),
        text,
        tuple(
            capture
            for capture in captures
            if capture.name in common | further and "precision" in capture.measures
        ),
    )


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


def _basis(finished: dict[str, set[str]], kept: list[str], common: set[str], total: int) -> str:
    text = f"{len(common)} of {counted(total)}: those that every method of the table finished"
    without = [
        f"{method} ({len(names)} of {total})"
        for method, names in finished.items()
        if method not in kept
    ]
    return text + (
        f"; methods left out, with the captures that they finished: {', '.join(without)}"
        if without
        else ""
    )
