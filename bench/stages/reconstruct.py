"""The stages that image a capture by one method: they turn echoes into depth maps, and measure the
time and the scatter of the depths over repeated frames."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import numpy as np

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.evaluation.depth_errors import ErrorMap, deviation_map, strongest_scatterer_z_m
from handbench.bench.stages.image import configured, prepare, required_frames
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.imaging.device import use_device
from handbench.radar.methods.evidence import different_frames
from handbench.radar.methods.pixels import masked_mean
from handbench.radar.methods.registry import method
from handbench.radar.methods.settings import MethodSettings
from handbench.support.compiled import clock_s
from handbench.support.files import KEPT_BYTES, read_json, read_npz, write_json, write_npz
from handbench.support.store import stage

DEPTH = "depth.npz"
FRAMES = "frames.npz"
REPEATS = "repeats.npz"
TIMING = "timing.json"
TREATED = "treated.npz"
VELOCITY = "velocity_m_s"
PLANNED_S = 20.0  # what takes longer than any plan is not imaged twice
REPEATED_S = 0.2  # for how long the imaging is repeated for its time
WINDOW_PX = 5  # of the averaging filter that all methods are given under equal treatment
SMOOTHING = {"none": 1, "window": WINDOW_PX}  # treatment → width of every averaging filter, pixels
FILTER = "filter_px"  # setting of methods that smooth their depths
DROP = "drop_doubtful"  # setting of methods that can leave pixels out as uncertain


SOURCES = (
    "bench/stages/reconstruct.py",
    "bench/datasets",
    "bench/evaluation/depth_errors.py",
    "bench/stages/image.py",
    "calibration",
    "groundtruth/mesh",
    "radar",
)


@stage("reconstruct", *SOURCES)
def reconstruct(
    folder: Path,
    capture: str,
    method: str,
    config: dict[str, Any],
    device: str,
    every_nth_antenna: int,
    frames: int,
) -> None:
    """Image a capture by one method, measure the time, and write the results into a stage's folder.
    It writes the depth map of frame 0 with its uncertainty (depth.npz), the depths of all frames if
    there are several (frames.npz, with the radial velocities if the method has them), and the times
    (timing.json). Unless imaging takes long, it also
    writes the maps of frame 0 under equal treatment, with the same smoothing for all methods
    (treated.npz).
    capture: its folder; config: complete settings of the method; device: name of the device that
    images; every_nth_antenna: use only every n-th transmitter and every n-th receiver; frames: how
    many frames are imaged."""
    with use_device(device):
        imager = Imager(capture, method, config, frames, every_nth_antenna)
        images = imager.images()
        seconds, depths = imager.repeated(images.seconds), images.depths
        if seconds[0] < PLANNED_S:
            task = imager.task
            write_treated(
                folder,
                lambda settings: replace(task, settings=settings).image(),
                task.settings,
                depths[0],
            )
    # not timed: the uncertainty is not part of the method
    imager.task.with_uncertainty(depths[0]).save(folder / DEPTH)
    if frames > 1:
        blank = depths[0].without_depths()
        of_frames = dict(zip(imager.frames, depths, strict=True))
        write_frames(folder, [of_frames.get(number, blank) for number in range(frames)])
    _write_times(folder, seconds, images.plan_s, **measuring_times(imager.task.echoes))


@stage("repeat", *SOURCES)
def repeat(
    folder: Path,
    capture: str,
    method: str,
    config: dict[str, Any],
    device: str,
    every_nth_antenna: int,
    frames: int,
) -> None:
    """Image repeated frames of a capture by one method, and write the scatter of the depths into a
    stage's folder.
    It writes the depth of the strongest scatterer in each frame and the standard deviation of each
    pixel (repeats.npz), and the times of the frames (timing.json). The arguments are those of
    `reconstruct`."""
    with use_device(device):
        imager = Imager(capture, method, config, frames, every_nth_antenna, repeats=True)
        images = imager.images()
    first, *_ = depths = images.depths
    z_m = np.stack([depth.z_m for depth in depths])
    amplitude = np.stack([10 ** (depth.amplitude_db / 20) for depth in depths])
    write_npz(
        folder / REPEATS,
        z_m=strongest_scatterer_z_m(z_m, amplitude),
        x_m=first.x_m,
        y_m=first.y_m,
        deviation_m=deviation_map(first.x_m, first.y_m, z_m).error_m,
    )
    _write_times(folder, images.seconds, images.plan_s)


@stage("time", *SOURCES)
def time_again(
    folder: Path,
    capture: str,
    method: str,
    config: dict[str, Any],
    device: str,
    every_nth_antenna: int,
    frames: int,
    round_: int,
) -> None:
    """Image a capture by one method once more, for the time alone (timing.json).
    round_: number of the round of a benchmark in which this happens; the other arguments are those
    of `reconstruct`."""
    with use_device(device):
        imager = Imager(capture, method, config, frames, every_nth_antenna)
        images = imager.images()
        seconds = imager.repeated(images.seconds)
    _write_times(folder, seconds, images.plan_s)


def _write_times(folder: Path, seconds: list[float], plan_s: float | None, **further: Any) -> None:
    """Write timing.json: the times of the images, s, and of the plan, and further entries."""
    write_json(folder / TIMING, {"seconds": seconds, "plan_seconds": plan_s, **further})


def read_repeats(folder: Path) -> tuple[np.ndarray, ErrorMap]:
    """Read the scatter of a capture's repeated frames from the stage's folder.
    Returns the depths of the strongest scatterer [n], metres, and an ErrorMap that holds the
    standard deviation of each pixel in place of errors."""
    kept = read_npz(folder / REPEATS, ("z_m", "x_m", "y_m", "deviation_m"))
    return kept["z_m"], ErrorMap(kept["x_m"], kept["y_m"], kept["deviation_m"], kept["deviation_m"])


def write_frames(folder: Path, depths: Sequence[DepthMap]) -> None:
    """Write the depths of all frames to frames.npz, and their radial velocities if all have
    them."""
    maps = {"z_m": [depth.z_m for depth in depths]}
    velocities_m_s = [depth.velocity_m_s for depth in depths if depth.velocity_m_s is not None]
    maps |= {VELOCITY: velocities_m_s} if len(velocities_m_s) == len(depths) else {}
    write_npz(folder / FRAMES, **{name: np.stack(m).astype(np.float32) for name, m in maps.items()})


def read_frames(folder: Path, first: DepthMap) -> list[DepthMap]:
    """Read the depth maps of all frames from the folder of an imaging stage, with depths and
    velocities only; [] if it has a single one. first: the depth map of the first frame."""
    if not (folder / FRAMES).exists():
        return []
    kept = read_npz(folder / FRAMES, ("z_m",), (VELOCITY,), most=KEPT_BYTES)
    frames = (dict(zip(kept, maps, strict=True)) for maps in zip(*kept.values(), strict=True))
    return [replace(first, **{VELOCITY: None} | maps) for maps in frames]


def read_times(folder: Path) -> dict[str, Any]:
    """Return the content of timing.json in the folder of an imaging stage; {} if it has none."""
    file = folder / TIMING
    return read_json(file, "a stage's times") if file.exists() else {}


def measuring_times(echoes: RadarCapture) -> dict[str, Any]:
    """Return when the echoes were measured, for timing.json: step_time_s, the median time from one
    tone to the next, and frame_times_s, the start of each frame; without those that are unknown."""
    found: dict[str, Any] = {}
    if echoes.times_s is not None and len(echoes.times_s) > 1:
        step_s = np.median(np.diff(np.sort(echoes.times_s)))
        found["step_time_s"] = round(float(step_s), 12)  # without the differences' rounding
    if echoes.frame_times_s is not None:
        found["frame_times_s"] = echoes.frame_times_s.tolist()
    return found


class Images(NamedTuple):
    """Results of imaging the frames of a capture.
    depths: one map for each frame. seconds: times from the echoes in memory to a depth map, without
    the preparation (plan) of the fast imaging, which depends only on the geometry. plan_s: time of
    that preparation, s, if known."""

    depths: list[DepthMap]
    seconds: list[float]
    plan_s: float | None


class Imager:
    """Images the first frames of a capture by one method, and measures the time.
    config: settings that differ from the method's defaults; frames: how many; every_nth_antenna:
    use only every n-th transmitter and every n-th receiver; repeats: image only those frames that
    count for the precision. Raises HandbenchError if the method cannot image the capture."""

    def __init__(
        self,
        capture: str | Path,
        method_id: str,
        config: dict[str, Any],
        frames: int = 1,
        every_nth_antenna: int = 1,
        repeats: bool = False,
    ) -> None:
        recorded = open_capture(capture)
        settings, echoes = configured(recorded.about, method_id, config), recorded.echoes(frames)
        different = different_frames(echoes.samples) if repeats else ()
        self.frames = different or required_frames(echoes, frames)
        self.task = prepare(echoes, method(method_id), settings, self.frames, every_nth_antenna)

    def images(self) -> Images:
        """Image every frame; return the results and the times.
        The first frame also pays for the preparation (plan) of the fast imaging, which a radar does
        only once. Its time therefore counts only if there is no other: the other frames are timed,
        and a single frame is imaged again unless it took long. The extra time of the first frame is
        reported as the time of the plan."""
        task, times, depths = self.task, list[float](), list[DepthMap]()
        for frame in self.frames:
            with timed(times):
                depths.append(task.image(frame))
        if len(times) == 1 and times[0] < PLANNED_S:
            with timed(times):
                task.image(self.frames[0])
        first_s, *seconds = times
        plan_s = max(first_s - median(seconds), 0.0) if seconds else None
        return Images(depths, seconds or [first_s], plan_s)

    def repeated(self, seconds: list[float]) -> list[float]:
        """Repeat the imaging for REPEATED_S, so that the median of fast methods is that of several
        times.
        seconds: times measured so far, s. Returns these and the times of the repetitions."""
        times, end_s = list(seconds), clock_s() + REPEATED_S
        while clock_s() + times[-1] < end_s:
            with timed(times):
                self.task.image(self.frames[len(times) % len(self.frames)])
        return times


@contextmanager
def timed(seconds: list[float]) -> Iterator[None]:
    """Context manager that appends the duration of its block, in seconds and without that of
    compilation, to the list `seconds`."""
    start_s = clock_s()
    yield
    seconds.append(clock_s() - start_s)


def write_treated(
    folder: Path, image: Callable[[Any], DepthMap], settings: MethodSettings, own: DepthMap
) -> None:
    """Write a method's depth maps under every equal treatment (same smoothing for all methods) to
    the file treated.npz: treatment → depths [ny, nx] above the method's own threshold, metres.
    image: function that makes the capture's depth map with a given configuration of the method.
    settings: the method's own configuration; own: the depth map that it gave."""
    made: dict[str, DepthMap] = {settings.model_dump_json(): own}
    arrays: dict[str, np.ndarray] = {}
    known = type(settings).model_fields
    for treatment, size_px in SMOOTHING.items():
        changed = {FILTER: size_px, DROP: False}
        config = settings.model_copy(update={k: v for k, v in changed.items() if k in known})
        if (key := config.model_dump_json()) not in made:
            made[key] = image(config)
        z_m = made[key].z_m if FILTER in known else masked_mean(made[key].z_m, size_px)
        arrays[treatment] = z_m.astype(np.float32)
    write_npz(folder / TREATED, **arrays)


def read_treated(folder: Path) -> dict[str, np.ndarray] | None:
    """Read the depths [ny, nx] under every equal treatment (same smoothing for all methods) from a
    stage's folder: treatment → depths, metres. None if the folder has none."""
    file = folder / TREATED
    return read_npz(file, tuple(SMOOTHING)) if file.exists() else None
