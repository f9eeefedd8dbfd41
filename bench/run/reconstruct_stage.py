"""The stage that images a capture by one method: echoes → depth map, and the time that it took."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from bench.datasets.dataset import open_capture
from radar.data.capture import RadarCapture, thinned
from radar.imaging.device import use_device
from radar.methods.registry import Method, Reconstruction, method
from radar.support.config import Config
from radar.support.cost import others
from radar.support.errors import HandbenchError
from radar.support.files import write_json
from radar.warmup import compile_kernels

DEPTH, TIMING = "depth.npz", "timing.json"
PLANNED_S = 20.0  # what takes longer than any plan is not imaged twice


def reconstruct(
    folder: Path, capture: str, method: str, config: dict[str, Any], device: str, every_nth_antenna: int
) -> None:
    """Frame 0 → DEPTH, imaged on the client's device, and its time → TIMING."""
    with use_device(device), others() as busy:
        [(result, seconds, plan_s)] = image_frames(Path(capture), method, config, 1, every_nth_antenna)
    result.depth.save(folder / DEPTH)
    write_json(folder / TIMING, {"seconds": [seconds], "plan_seconds": plan_s, "others_cores": busy[0]})


def image_frames(
    capture: Path, method_id: str, config: dict[str, Any], frames: int = 1, every_nth_antenna: int = 1
) -> Iterator[tuple[Reconstruction, float, float | None]]:
    """The first frames of a capture by one method, each with its seconds from echoes in memory to the depth map, and
    with those of the plan, where it was measured.

    The first image of a geometry plans the engine's skeletons, which a radar does once: where that may matter, the
    first frame is imaged again, its second time counts, and what the first took more is the plan's.
    """
    chosen, settings = method(method_id), configuration(capture, method_id, config)
    echoes = thinned(open_capture(capture).echoes(frames), every_nth_antenna)
    if len(echoes.samples) < frames:
        raise HandbenchError(f"{capture}: has {len(echoes.samples)} frames; expected {frames} for the precision")
    compile_kernels()
    for frame in range(frames):
        result, seconds, plan_s = *_timed(chosen, echoes, settings, frame), None
        if frame == 0 and seconds < PLANNED_S:
            first_s = seconds
            result, seconds = _timed(chosen, echoes, settings, frame)
            plan_s = max(first_s - seconds, 0.0)
        yield result, seconds, plan_s


def _timed(chosen: Method, echoes: RadarCapture, settings: Config, frame: int) -> tuple[Reconstruction, float]:
    start = time.perf_counter()
    return chosen.run(echoes, settings, frame), time.perf_counter() - start


def configuration(capture: Path, method_id: str, config: dict[str, Any]) -> Config:
    """The method's configuration for this capture: defaults, then what its sensor asks for, of the method that it is a
    variant of or of itself, then what the user does."""
    of_sensor = open_capture(capture).about.methods
    for known in of_sensor:
        method(known)  # a typing error in capture.toml is not passed over
    chosen = method(method_id)
    asked = {**of_sensor.get(chosen.base, {}), **of_sensor.get(method_id, {})}
    return chosen.configure({**asked, **config}, f"method '{method_id}'")
