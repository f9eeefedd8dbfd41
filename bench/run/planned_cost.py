"""Predict the time and memory of a run from the shapes of its inputs, before it starts.

The processor time is a sum of counts (such as voxels) times measured rates. The rates are those of
whole stages on two shared cores of an AMD EPYC: hands in front of 94 × 94 antennas, 2 to 128 tones,
imaged for the depth map, for the time and for equal treatment. The prediction tells minutes from
days.
"""

from collections.abc import Iterable
from math import prod
from pathlib import Path
from typing import NamedTuple

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.pipeline.image import configured
from handbench.bench.run.benchmark_file import BenchFile, Origin, Source
from handbench.bench.run.jobs import scene_of
from handbench.bench.run.photogrammetry import TARGET_QUALITY
from handbench.bench.scenes.scene_file import SceneFile
from handbench.groundtruth.options import BASE_BYTES, EFFORT_SHARES, predict_effort
from handbench.radar.methods.advice import requested_tones_hz
from handbench.radar.methods.registry import method
from handbench.support.config import Config
from handbench.support.cost import TERMS_PER_S
from handbench.support.errors import HandbenchError
from handbench.support.files import inside
from handbench.support.pictures import open_picture

CHANNELS, TONES = 94 * 94, 128  # the paper's radar, for what is not known before it is read
STAGE_S, SCORED_S = 0.1, 2.7e-6  # a stage that has nothing to do; a pixel that is scored
# a pixel's tone, a voxel of a volume, a sample of the method's tones
PIXEL_S, VOXEL_S, SAMPLE_S = (7e-6, 3.6e-7, 3.5e-6)
# to inspect a capture: its map is held against its surface; without one, its focus
FITTED_S, FOCUSED_S = (0.6, 2.2)
FRAME = 0.15  # of a stage, for each frame behind the first
# echoes of a small body and of a hand; a simulated megapixel
BODY_S, HAND_S, PHOTO_S = (0.5, 20.0, 0.9)
MOVED_S = 4.0  # one more frame of a moving hand
MEGAPIXELS_PER_PX2 = 0.75e-6  # of a picture of 4 : 3, by the square of its longer side
VOXEL_BYTES, SAMPLE_BYTES = 24, 24
Part = tuple[str, str, str]  # names of a stage, its capture and its method


class Work(NamedTuple):
    """Predicted cost of some work: core_s, its time on one processor core, s; bytes_, its peak
    memory."""

    core_s: float
    bytes_: float = BASE_BYTES


def one_after_another(parts: Iterable[Work]) -> Work:
    """Add the costs of several works done in sequence: the sum of their times, and the largest
    memory."""
    times_s, sizes = zip(Work(0.0), *parts, strict=True)
    return Work(sum(times_s), max(sizes))


def of_run(bench: BenchFile, base: Path) -> dict[Part, Work]:
    """Predict processor time and peak memory of the stages of a benchmark.
    base: folder to which the benchmark's paths are relative. Stages that take no time worth
    mentioning are left out."""
    predicted: dict[Part, Work] = {}
    for source in (*bench.capture, *bench.calibration):
        predicted |= _of_capture(bench, base, source)
    return predicted


def imaging(
    settings: Config, channels: float = CHANNELS, frames: int = 1, exact: bool = True
) -> Work:
    """Predict the cost of imaging and scoring the first `frames` frames of one capture.
    settings: configuration of the method. channels: number of pairs of a transmitter and a
    receiver. exact: whether the direct sums of settings with tolerance = None are counted; False if
    only a small part of them will be computed."""
    asked = requested_tones_hz(settings)
    tones = TONES if asked is None else len(asked)
    shape, samples = (
        settings.grid().shape if hasattr(settings, "grid") else (0, 0),
        tones * channels,
    )
    points, of_point_s = (
        prod(shape),
        VOXEL_S if "z" in type(settings).model_fields else PIXEL_S * tones,
    )
    core_s = SAMPLE_S * samples + of_point_s * points + SCORED_S * prod(shape[-2:])
    if exact and getattr(settings, "tolerance", 0.0) is None:
        core_s += 2 * points * samples / TERMS_PER_S  # for the figure and for the time
    size = BASE_BYTES + VOXEL_BYTES * points + SAMPLE_BYTES * samples * frames
    return Work(STAGE_S + core_s * (1 + FRAME * (frames - 1)), size)


def _of_capture(bench: BenchFile, base: Path, source: Origin) -> dict[Part, Work]:
    """Predict the cost of the stages of one capture.
    base: folder to which the benchmark's paths are relative. A capture that cannot be opened has no
    stage, because opening it later reports the error."""
    measures = source.measures if isinstance(source, Source) else ()
    try:
        folder = inside(base, source.path, "capture.path") if source.path is not None else None
        about = open_capture(folder).about if folder else None
        if folder and about:
            name, made_s, (count, megapixels) = about.name, 0.0, _recorded(folder)
        else:
            scene = scene_of(bench, base, source)[0]
            if "accuracy" not in getattr(source, "measures", ("accuracy",)):
                scene = scene.model_copy(update={"photos": None})
            name, made_s, (count, megapixels) = scene.name, simulating_s(scene), _photos(scene)
        quality = bench.groundtruth.quality if isinstance(source, Source) else TARGET_QUALITY
        mesh_s, size = predict_effort(count, megapixels, quality)
        predicted = {("simulate", name, ""): Work(STAGE_S + made_s)}
        for stage, share in EFFORT_SHARES.items():
            predicted[stage, name, ""] = Work(share * mesh_s, size)
        if measures:
            predicted["inspect", name, ""] = Work(inspecting(folder))
        for entry in (e for e in bench.method if measures and not e.foreign):
            values = (
                entry.config
                if about is None
                else configured(about, entry.id, entry.config).model_dump()
            )
            settings = method(entry.id).configure(values, entry.id)
            wanted = {"accuracy": ("reconstruct", bench.frames)} | (
                {"precision": ("repeat", bench.repeats)} if entry.precision else {}
            )
            channels = CHANNELS / entry.every_nth_antenna**2
            for stage, frames in (wanted[measure] for measure in measures if measure in wanted):
                predicted[stage, name, entry.id] = imaging(settings, channels, frames)
        return predicted
    except (HandbenchError, OSError):
        return {}


def simulating_s(scene: SceneFile, frames: int = 1) -> float:
    """Predict the processor time to simulate a scene, s. frames: their number; those in which the
    target has moved on are simulated one by one."""
    body_s = HAND_S if scene.target.kind == "hand" else BODY_S
    moved = 0 if scene.sensor.frame_period_s is None else frames - 1
    return body_s + MOVED_S * moved + PHOTO_S * _photos(scene)[1]


def inspecting(folder: Path | None) -> float:
    """Predict the processor time, s, to check a capture for mistakes. The check of a capture
    without a surface takes longer.
    folder: of a recorded capture; None for a simulated one, which always has a surface."""
    capture = open_capture(folder) if folder else None
    return FITTED_S if capture is None or capture.truth or capture.mesh() else FOCUSED_S


def _recorded(folder: Path) -> tuple[int, float]:
    """Return number and total megapixels of the photographs to reconstruct of a recorded capture.
    There are none if the capture has a mesh. All photographs are taken to be as large as the
    first."""
    capture = open_capture(folder)
    pictures = (
        sorted(capture.photos.glob("*.[jJpPtT]*"))
        if capture.photos and capture.mesh() is None
        else []
    )
    if not pictures:
        return 0, 0.0
    with open_picture(pictures[0]) as picture:
        return len(pictures), 1e-6 * prod(picture.size) * len(pictures)


def _photos(scene: SceneFile) -> tuple[int, float]:
    """Return number and total megapixels of a scene's photographs."""
    photos = scene.photos
    return (
        (photos.cameras, 1e-6 * photos.cameras * photos.width * photos.height)
        if photos
        else (0, 0.0)
    )
