"""What a run does, as plain data: each job is one stage of one capture, which any machine that sees the files carries
out. A job holds paths, keys and transforms, never data, and what comes back is a small record."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from bench.datasets.dataset import open_capture
from bench.datasets.simulated import simulate_capture
from bench.evaluation import scoring_protocols
from bench.run import scoring, stages
from bench.run.cache import Stamp, kept_stage
from bench.scenes.build import build
from bench.scenes.scene_file import SceneFile
from calibration.transforms import Transform
from radar.imaging.device import use_device
from radar.methods import registry
from radar.methods.registry import source_key
from radar.support.config import parse
from radar.support.errors import HandbenchError
from radar.support.files import content_hash
from radar.support.store import key_of

TRANSFORM = "radar_from_photo.json"
HASH = "hash"
_ALONE = threading.Lock()  # a cost is measured of the whole process, which therefore does one job at a time


@dataclass(frozen=True)
class Job:
    """One stage of one capture. method: empty for a stage of no method; key: the hash of everything that the stage
    depends on; arguments: plain values for its maker; sources: the code that it runs beside the method's own; code: the
    hash of both and of the libraries."""

    stage: str
    capture: str
    method: str = ""
    key: str = ""
    arguments: dict[str, Any] = field(default_factory=dict)
    sources: tuple[str, ...] = ()
    code: str = ""

    @property
    def label(self) -> str:
        """The name that is printed, and that the stage's folder begins with."""
        return "-".join(part for part in (self.stage, self.capture, self.method) if part)

    def folder(self, root: Path) -> Path:
        """Where the stage's files lie, under a run's work folder."""
        return root / f"{self.label}-{self.key[:16]}"


@dataclass(frozen=True)
class Done:
    """What a job came to. stamp: None where no folder was made; failure: the error that the user can mend, if any."""

    stamp: Stamp | None = None
    cached: bool = False
    key: str = ""
    failure: str | None = None


def job(
    stage: str, capture: str, method: str, depends_on: list[Any], sources: tuple[str, ...], arguments: dict[str, Any]
) -> Job:
    """A job whose key is the hash of depends_on (values, paths, keys of earlier stages), of the code in `sources`
    (packages or modules), of the method's and of the libraries."""
    code = code_hash(sources, method)
    key = content_hash(stage, capture, method, *depends_on, code)
    return Job(stage, capture, method, key, arguments, sources, code)


@cache
def code_hash(sources: tuple[str, ...], method: str) -> str:
    """Hash of code and libraries as they were when this process first asked."""
    return key_of(sources, source_key(registry.method(method)) if method else ())


def perform(root: Path, job: Job) -> Done:
    """Carry out a job, or find its folder under `root` ready; a HandbenchError becomes the record's `failure`."""
    try:
        with _ALONE:
            return _perform(root, job)
    except HandbenchError as error:
        return Done(failure=str(error))


def _perform(root: Path, job: Job) -> Done:
    if job.stage == HASH:
        return Done(key=open_capture(job.arguments["folder"]).key(job.arguments["frames"]))
    if not root.is_dir():
        raise HandbenchError(f"{root}: is not there on this machine; expected the result folder, shared by all workers")
    if code_hash(job.sources, job.method) != job.code:
        raise HandbenchError(
            f"{job.label}: this worker's handbench or libraries differ from the client's; install the same on both"
        )
    stamp, cached = kept_stage(job.folder(root), job.label, lambda folder: MAKERS[job.stage](folder, **job.arguments))
    return Done(stamp, cached, job.key)


def simulate(folder: Path, scene: dict[str, Any], base: str, frames: int) -> None:
    """A scene, whose files lie in `base`, as a capture folder."""
    file = parse(SceneFile, scene, f"scene of {base}")
    simulate_capture(build(file, Path(base)), folder / "capture", frames)


def groundtruth(folder: Path, capture: str, quality: str, seed: int) -> None:
    """The capture's photographs as a mesh."""
    stages.make_mesh(Path(capture), quality, seed, folder)


def calibrate(folder: Path, captures: list[str], quality: str, seed: int) -> None:
    """Captures of one target as TRANSFORM."""
    made = stages.calibrate_captures([Path(capture) for capture in captures], quality, seed, folder / "work")
    made.save(folder / TRANSFORM)


def reconstruct(
    folder: Path, capture: str, method: str, config: dict[str, Any], device: str, every_nth_antenna: int
) -> None:
    """Frame 0 as a depth map, imaged on the client's device."""
    with use_device(device):
        stages.make_depth(Path(capture), method, config, folder, every_nth_antenna)


def repeat(
    folder: Path, capture: str, method: str, config: dict[str, Any], device: str, every_nth_antenna: int, frames: int
) -> None:
    """The strongest scatterer of each frame, imaged on the client's device."""
    with use_device(device):
        stages.make_repeats(Path(capture), method, config, frames, folder, every_nth_antenna)


def score(
    folder: Path, capture: str, maps: dict[str, Path], references: dict[str, tuple[Path, Transform]], protocol: str
) -> None:
    """The capture's depth maps compared with its references."""
    scoring.score(Path(capture), maps, references, scoring_protocols.protocol(protocol), folder)


MAKERS: dict[str, Callable[..., None]] = {
    maker.__name__: maker for maker in (simulate, groundtruth, calibrate, reconstruct, repeat, score)
}
