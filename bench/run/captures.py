"""The captures of a run: opened where they are recorded, simulated where they are scenes."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar

from handbench.bench.benchmarks.benchmark_file import BenchFile, Origin, Source, require_clear
from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.native import CaptureFile
from handbench.bench.results.about import MEASURES, Failure, Measure
from handbench.bench.run.engine import Engine
from handbench.bench.scenes.build import named_files
from handbench.bench.scenes.scene_file import SceneFile
from handbench.bench.stages.simulate import CAPTURE, simulate
from handbench.radar.simulation.causes import Noise
from handbench.support.config import load
from handbench.support.errors import HandbenchError
from handbench.support.files import content_hash, inside
from handbench.support.store import Input, Stage

Made = TypeVar("Made")


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


def open_captures(engine: Engine, bench: BenchFile, base: Path) -> list[RunCapture]:
    """Open the capture folders and simulate the scenes of a benchmark.
    base: folder to which the benchmark's paths are relative. A capture that fails is recorded and
    left out. Raises HandbenchError if two captures have the same name."""
    opened = _opened(engine, bench, base, bench.capture)
    captures = [capture for capture in opened if isinstance(capture, RunCapture)]
    names = [require_clear(capture.name, "capture") for capture in captures]
    if twice := [name for name in names if names.count(name) > 1]:
        raise HandbenchError(
            f"capture: two captures are named '{twice[0]}'; give each its own name"
        )
    return captures


def open_targets(engine: Engine, bench: BenchFile, base: Path) -> list[RunCapture]:
    """Open or simulate the captures of the benchmark's calibration target. Raises HandbenchError if
    one fails."""
    return [required(target) for target in _opened(engine, bench, base, bench.calibration)]


def required(outcome: Made | Failure) -> Made:
    """Return the outcome of a step of the calibration. Raises HandbenchError if the step failed,
    because without the calibration no capture has a reference."""
    if isinstance(outcome, Failure):
        raise HandbenchError(f"calibration: {outcome.message}")
    return outcome


def _opened(
    engine: Engine, bench: BenchFile, base: Path, origins: Sequence[Origin]
) -> list[RunCapture | Failure]:
    """Open or simulate captures, in their order; a failure in place of one that fails."""
    opened = [
        engine.attempt(
            partial(_open, bench, base, origin), origin.scene or origin.path or "", "open"
        )
        for origin in origins
    ]
    scenes = [one for one in opened if isinstance(one, Stage)]
    simulated = dict(zip(scenes, engine.perform(scenes), strict=True))
    captures: list[RunCapture | Failure] = []
    for origin, one in zip(origins, opened, strict=True):
        outcome = simulated[one] if isinstance(one, Stage) else one
        if isinstance(one, Stage) and isinstance(outcome, Path):
            about = open_capture(outcome / CAPTURE).about
            outcome = RunCapture(outcome / CAPTURE, one.key, about, _measures(origin))
        assert not isinstance(outcome, Path)
        captures.append(outcome)
    return captures


def _open(bench: BenchFile, base: Path, origin: Origin) -> RunCapture | Stage:
    """Open a capture folder, or return the stage that simulates a scene.
    base: folder to which the benchmark's paths are relative."""
    frames = bench.frames_of(origin)
    if origin.path is not None:
        folder = inside(base, origin.path, "capture.path")
        data = open_capture(folder)
        return RunCapture(folder, data.key(frames), data.about, _measures(origin))
    scene, file = scene_of(bench, base, origin)
    named = [content_hash(path) for path in named_files(scene, file.parent)]
    arguments = {
        "scene": scene.model_dump(mode="json"),
        "base": Input(str(file.parent), named),
        "frames": frames,
    }
    return Stage(simulate, arguments, scene.name, shares=scene.photos is not None)


def _measures(origin: Origin) -> tuple[Measure, ...]:
    return origin.measures if isinstance(origin, Source) else MEASURES


def scene_of(bench: BenchFile, base: Path, source: Origin) -> tuple[SceneFile, Path]:
    """Read the scene of a benchmark's capture, and apply the changes that the benchmark makes to
    it: `set`, person, phase noise, no photographs where nothing needs them. Returns the scene and
    its file.
    base: folder to which the benchmark's paths are relative."""
    path = inside(base, source.scene or "", "capture.scene")
    scene = load(SceneFile, path, "a scene description")
    if isinstance(source, Source) and source.suffix:
        scene = scene.varied(source.set, source.suffix)
    if isinstance(source, Source) and source.persons:
        scene = scene.of_person(*source.persons)
    if bench.phase_noise_rad is not None:
        scene = scene.model_copy(update={"noise": Noise(phase_noise_rad=bench.phase_noise_rad)})
    if not source.photos or "accuracy" not in _measures(source):  # nothing needs them
        scene = scene.model_copy(update={"photos": None})
    return scene, path
