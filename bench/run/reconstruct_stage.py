"""The stage that images a capture by one method: echoes → depth map, and the time that it took."""

import time
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import binom

from bench.datasets.dataset import open_capture
from bench.run.treatments import write_treated
from radar.data.capture import thinned
from radar.data.depthmap import DepthMap
from radar.imaging.device import use_device
from radar.methods.registry import Reconstruction, method
from radar.methods.trust import with_trust
from radar.support.config import Config
from radar.support.cost import others
from radar.support.errors import HandbenchError
from radar.support.files import write_json, write_npz
from radar.warmup import compile_kernels

DEPTH, FRAMES, TIMING = "depth.npz", "frames.npz", "timing.json"
PLANNED_S = 20.0  # what takes longer than any plan is not imaged twice
SETTLED, SETTLE_S = 0.05, 0.5  # of a median time: how near its interval shall be, and for how long that is tried


def reconstruct(
    folder: Path, capture: str, method: str, config: dict[str, Any], device: str, every_nth_antenna: int, frames: int
) -> None:
    """Image frame 0 → DEPTH, and for equal treatment again → ALIKE; the depths of all frames → FRAMES; what each took →
    TIMING. All on the client's device."""
    with use_device(device), others() as busy:
        imager = Imager(Path(capture), method, config, frames, every_nth_antenna)
        found = imager.images()
        seconds = imager.until_settled(found.seconds)
        depths = [result.depth for result in found.results]
        if seconds[0] < PLANNED_S:
            write_treated(folder, imager.with_settings, imager.settings, depths[0])
    with_trust(depths[0], imager.echoes, imager.settings).save(folder / DEPTH)  # whose time is none of the method's
    if frames > 1:
        write_npz(folder / FRAMES, z_m=np.stack([depth.z_m for depth in depths]).astype(np.float32))
    write_json(folder / TIMING, {"seconds": seconds, "plan_seconds": found.plan_s, "others_cores": busy[0]})


class Images(NamedTuple):
    """The frames' results; the seconds from echoes in memory to each depth map, the engine's plan being made; the
    plan's own, where they are known."""

    results: list[Reconstruction]
    seconds: list[float]
    plan_s: float | None


class Imager:
    """The first frames of a capture before one method. A capture with fewer frames is a HandbenchError."""

    def __init__(
        self, capture: Path, method_id: str, config: dict[str, Any], frames: int = 1, every_nth_antenna: int = 1
    ) -> None:
        self.method, self.settings, self.frames = method(method_id), configuration(capture, method_id, config), frames
        self.echoes = thinned(open_capture(capture).echoes(frames), every_nth_antenna)
        if len(self.echoes.samples) < frames:
            raise HandbenchError(f"{capture}: has {len(self.echoes.samples)} frames; expected {frames}")
        compile_kernels()

    def images(self) -> Images:
        """Image every frame. The first image of a geometry plans the engine's skeletons, which a radar does once: the
        other frames' times count, or where there is none and a plan may matter, that of the first frame imaged again;
        what the first image took more is the plan's."""
        results, (first_s, *seconds) = zip(*map(self._timed, range(self.frames)), strict=True)
        if not seconds and first_s < PLANNED_S:
            seconds = [self._timed(0)[1]]
        return Images(list(results), seconds or [first_s], max(first_s - median(seconds), 0.0) if seconds else None)

    def until_settled(self, seconds: list[float]) -> list[float]:
        """These times of the frames, and more of them, imaged again in turns until their median has settled or
        SETTLE_S have gone by."""
        found, end = list(seconds), time.perf_counter() + SETTLE_S
        while not settled(found) and time.perf_counter() + found[-1] < end:
            found.append(self._timed(len(found) % self.frames)[1])
        return found

    def with_settings(self, settings: Config) -> DepthMap:
        """The depth map of frame 0 by another configuration."""
        return self.method.run(self.echoes, settings, 0).depth

    def _timed(self, frame: int) -> tuple[Reconstruction, float]:
        start = time.perf_counter()
        return self.method.run(self.echoes, self.settings, frame), time.perf_counter() - start


def settled(seconds: list[float]) -> bool:
    """True where the median's 95 % interval, between two order statistics, lies within SETTLED of it."""
    n, ordered = len(seconds), sorted(seconds)
    outer = int(binom.ppf(0.025, n, 0.5))  # so many may lie below the interval
    if outer < 1:
        return False
    return ordered[-outer] - ordered[outer - 1] <= 2 * SETTLED * median(seconds)


def configuration(capture: Path, method_id: str, config: dict[str, Any]) -> Config:
    """The method's configuration for this capture: defaults, then what its sensor asks for, of the method that it is a
    variant of or of itself, then what the user does."""
    of_sensor = open_capture(capture).about.methods
    for known in of_sensor:
        method(known)  # a typing error in capture.toml is not passed over
    chosen = method(method_id)
    asked = {**of_sensor.get(chosen.base, {}), **of_sensor.get(method_id, {})}
    return chosen.configure({**asked, **config}, f"method '{method_id}'")
