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
from handbench.bench.run.sweep import ImagingSetting
from handbench.bench.scenes.scene_file import SceneFile
from handbench.groundtruth.options import BASE_BYTES, predict_effort
from handbench.radar.methods.advice import requested_tones_hz
from handbench.radar.methods.registry import method
from handbench.support.config import Config, load
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
VOXEL_BYTES, SAMPLE_BYTES = 24, 24


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


def of_run(bench: BenchFile, base: Path) -> Work:
    """Predict processor time and peak memory of a whole benchmark.
    base: folder to which the benchmark's paths are relative."""
    return one_after_another(
        _of_capture(bench, base, source) for source in (*bench.capture, *bench.calibration)
    )


def of_sweep(bench: BenchFile, base: Path, settings: Iterable[ImagingSetting], rounds: int) -> Work:
    """Predict processor time and peak memory of a trade-off: of its captures, and of imaging with
    every setting, each timed `rounds` times.
    base: folder to which the benchmark's paths are relative. Exact images cost no more than fast
    ones here, because the trade-off sums only a few of their planes."""
    configs = [
        (method(s.method).configure(s.config, s.name), CHANNELS / s.every_nth_antenna**2)
        for s in settings
    ]
    parts = [imaging(config, channels, rounds, exact=False) for config, channels in configs] * len(
        bench.capture
    )
    return one_after_another([of_run(bench.model_copy(update={"method": ()}), base), *parts])


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


def _of_capture(bench: BenchFile, base: Path, source: Origin) -> Work:
    """Predict the cost of all stages of one capture.
    base: folder to which the benchmark's paths are relative. A capture that cannot be opened costs
    zero, because opening it later reports the error."""
    measures = source.measures if isinstance(source, Source) else ()
    try:
        folder = inside(base, source.path, "capture.path") if source.path is not None else None
        made_s, count, megapixels = _recorded(folder) if folder else _simulated(base, source)
        mesh_s, size = predict_effort(count, megapixels, bench.groundtruth.quality)
        parts = [Work(STAGE_S + made_s + mesh_s + (inspecting(folder) if measures else 0.0), size)]
        about = open_capture(folder).about if folder and bench.method else None
        for entry in (e for e in bench.method if measures and not e.foreign):
            values = (
                entry.config
                if about is None
                else configured(about, entry.id, entry.config).model_dump()
            )
            settings = method(entry.id).configure(values, entry.id)
            wanted = {"accuracy": bench.frames} | (
                {"precision": bench.repeats} if entry.precision else {}
            )
            channels = CHANNELS / entry.every_nth_antenna**2
            parts += [
                imaging(settings, channels, wanted[measure])
                for measure in measures
                if measure in wanted
            ]
        return one_after_another(parts)
    except (HandbenchError, OSError):
        return Work(0.0)


def inspecting(folder: Path | None) -> float:
    """Predict the processor time, s, to check a capture for mistakes. The check of a capture
    without a surface takes longer.
    folder: of a recorded capture; None for a simulated one, which always has a surface."""
    capture = open_capture(folder) if folder else None
    return FITTED_S if capture is None or capture.truth or capture.mesh() else FOCUSED_S


def _recorded(folder: Path) -> tuple[float, int, float]:
    """Return what must be done before a recorded capture can be scored: the time to simulate it (0
    s), and number and total megapixels of the photographs to reconstruct.
    There are none to reconstruct if the capture has a mesh. All photographs are taken to be as
    large as the first."""
    capture = open_capture(folder)
    pictures = (
        sorted(capture.photos.glob("*.[jJpPtT]*"))
        if capture.photos and capture.mesh() is None
        else []
    )
    if not pictures:
        return 0.0, 0, 0.0
    with open_picture(pictures[0]) as picture:
        return 0.0, len(pictures), 1e-6 * prod(picture.size) * len(pictures)


def _simulated(base: Path, source: Origin) -> tuple[float, int, float]:
    """Return the processor time to simulate a scene, s, and the number and total megapixels of the
    photographs to be rendered and reconstructed.
    base: folder to which the benchmark's paths are relative."""
    scene = load(
        SceneFile, inside(base, source.scene or "", "capture.scene"), "a scene description"
    )
    photos = (
        scene.photos
        if source.photos and "accuracy" in getattr(source, "measures", ("accuracy",))
        else None
    )
    count, megapixels = (
        (photos.cameras, 1e-6 * photos.cameras * photos.width * photos.height)
        if photos
        else (0, 0.0)
    )
    return (
        (HAND_S if scene.target.kind == "hand" else BODY_S) + PHOTO_S * megapixels,
        count,
        megapixels,
    )
