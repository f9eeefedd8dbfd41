"""The captures of a run: opened where they are recorded, simulated where they are scenes."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from handbench.bench.benchmarks.benchmark_file import (
    BenchFile,
    Origin,
    Source,
    require_clear,
    scene_of,
)
from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.native import CaptureFile
from handbench.bench.results.about import MEASURES, Measure
from handbench.bench.run.engine import Engine
from handbench.bench.scenes.scene_file import named_files
from handbench.bench.stages.simulate import CAPTURE, simulate
from handbench.support.errors import HandbenchError
from handbench.support.files import content_hash, inside
from handbench.support.store import Input, Stage


@dataclass(frozen=True)
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

    @property
    def accurate(self) -> bool:
        """Whether the capture's depths are compared with a reference."""
        return "accuracy" in self.measures

    @property
    def input(self) -> Input:
        """The capture's folder as the input of a stage."""
        return Input(str(self.folder), self.key)


# a capture, or the stage that simulates it; and what is measured on it
Opened = tuple[RunCapture | Stage, tuple[Measure, ...]]


def open_captures(engine: Engine, bench: BenchFile, base: Path) -> list[RunCapture]:
    """Open the capture folders and simulate the scenes of a benchmark.
    base: folder to which the benchmark's paths are relative. A capture that fails is recorded and
    left out. Raises HandbenchError if two captures have the same name."""
    opened: list[Opened] = []
    for source in bench.capture:
        with engine.attempt(source.scene or source.path or "", "open"):
            opened.append(_open(bench, base, source))
    names = [require_clear(name, "capture") for name in map(_name, opened)]
    if twice := [name for name in names if names.count(name) > 1]:
        raise HandbenchError(
            f"capture: two captures are named '{twice[0]}'; give each its own name"
        )
    return _simulated(engine, opened)


def open_targets(engine: Engine, bench: BenchFile, base: Path) -> list[RunCapture]:
    """Open or simulate the captures of the benchmark's calibration target. Raises HandbenchError if
    one fails, because without the calibration no capture has a reference."""
    opened = [_open(bench, base, origin) for origin in bench.calibration]
    return _simulated(engine, opened, essential=True)


def _simulated(
    engine: Engine, opened: Sequence[Opened], essential: bool = False
) -> list[RunCapture]:
    """Simulate the captures that are scenes, and return all that can be used, in their order."""
    scenes = [one for one, _ in opened if isinstance(one, Stage)]
    folders = engine.perform(scenes, scenes if essential else ())
    captures = []
    for one, measures in opened:
        if isinstance(one, RunCapture):
            captures.append(one)
        elif one in folders:
            folder = folders[one] / CAPTURE
            about = open_capture(folder).about
            captures.append(RunCapture(folder, one.key, about, measures))
    return captures


def _name(opened: Opened) -> str:
    one, _ = opened
    return one.name if isinstance(one, RunCapture) else one.capture


def _open(bench: BenchFile, base: Path, origin: Origin) -> Opened:
    """Open a capture folder, or return the stage that simulates a scene.
    base: folder to which the benchmark's paths are relative."""
    frames, measures = bench.frames_of(origin), _measures(origin)
    if origin.path is not None:
        folder = inside(base, origin.path, "capture.path")
        data = open_capture(folder)
        return RunCapture(folder, data.key(frames), data.about, measures), measures
    scene, file = scene_of(bench, base, origin)
    named = [content_hash(path) for path in named_files(scene, file.parent)]
    arguments = {
        "scene": scene.model_dump(mode="json"),
        "base": Input(str(file.parent), named),
        "frames": frames,
    }
    return Stage(simulate, arguments, scene.name, shares=scene.photos is not None), measures


def _measures(origin: Origin) -> tuple[Measure, ...]:
    return origin.measures if isinstance(origin, Source) else MEASURES
