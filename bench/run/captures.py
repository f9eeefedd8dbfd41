"""The captures of a run: opened where they are recorded, simulated where they are scenes."""

from dataclasses import dataclass
from pathlib import Path

from handbench.bench.benchmarks.benchmark_file import BenchFile, Origin, require_clear, scene_of
from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.native import CaptureFile, NativeCapture
from handbench.bench.results.about import MEASURES, Measure
from handbench.bench.run.engine import Engine
from handbench.bench.scenes.scene_file import named_files
from handbench.bench.stages.simulate import CAPTURE, simulate
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
