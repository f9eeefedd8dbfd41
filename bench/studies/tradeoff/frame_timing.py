"""The time of a frame, in its parts: settings and captures taken in turns, each frame after one that makes its plan."""

from __future__ import annotations

import ctypes
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import numpy as np
import psutil

from bench.datasets.dataset import open_capture
from bench.results import Failure
from bench.run.outcome import Capture
from bench.run.reconstruct_stage import configuration
from bench.run.sweep import ImagingSetting
from radar.data.capture import RadarCapture, thinned
from radar.imaging.api import Laps, watch
from radar.imaging.plan import fresh_plans
from radar.methods.registry import Reconstruction, method
from radar.support.cost import measured
from radar.support.errors import HandbenchError
from radar.support.progress import say, track
from radar.warmup import compile_kernels

OPEN = 4  # captures whose echoes are kept in memory
Key = tuple[str, str]  # capture, setting


@dataclass
class Frame:
    """One frame of one capture: seconds and the imaging among them, when its plan was there; plan_s: what the frame
    before it took longer; memory_mb: by how much that one raised the resident memory at most."""

    seconds: float
    imaging_s: float
    plan_s: float
    terms: int
    tones: int
    memory_mb: float


@dataclass
class Timings:
    """rounds: for each round the frames by capture and setting; failures: what a setting could not do."""

    rounds: list[dict[Key, Frame]] = field(default_factory=list)
    failures: list[Failure] = field(default_factory=list)


def timed_in_turns(
    settings: Sequence[ImagingSetting],
    captures: Sequence[Capture],
    repeats: int,
    keep: Callable[[Capture, ImagingSetting, Reconstruction], None],
) -> Timings:
    """Image every capture by every setting, `repeats` rounds; keep(capture, setting, result) is given each result of
    the first round, untimed. What fails with a HandbenchError is said, recorded and not tried again."""
    compile_kernels()
    timings, lost = Timings(), set()
    for round_ in range(repeats):
        timings.rounds.append({})
        for setting in track(settings, f"imaging, round {round_ + 1} of {repeats}"):
            with fresh_plans():
                for capture in captures:
                    key = capture.name, setting.name
                    if key in lost:
                        continue
                    try:
                        timings.rounds[-1][key], result = _timed(capture, setting)
                        if round_ == 0:
                            keep(capture, setting, result)
                    except HandbenchError as error:
                        lost.add(key)
                        about = {"capture": capture.name, "method": setting.name, "stage": "reconstruct"}
                        timings.failures.append(Failure(**about, message=str(error)))
                        say(timings.failures[-1].line)
    return timings


def _timed(capture: Capture, setting: ImagingSetting) -> tuple[Frame, Reconstruction]:
    """As the runner times a frame: imaged once for the plan, then again."""
    chosen = method(setting.method)
    config = configuration(capture.folder, setting.method, setting.config)
    echoes = thinned(_echoes(capture.folder, capture.key), setting.every_nth_antenna)

    def once() -> tuple[Reconstruction, float, Laps]:
        with watch() as laps:
            start = time.perf_counter()
            result = chosen.run(echoes, config, 0)
            return result, time.perf_counter() - start, laps

    _give_back()
    before_mb = psutil.Process().memory_info().rss / 1e6
    with measured() as cost:
        _, first_s, _ = once()
    result, seconds, laps = once()
    memory_mb = max(cost.peak_memory_mb - before_mb, 0.0)
    return Frame(seconds, laps.imaging_s, max(first_s - seconds, 0.0), laps.terms, laps.tones, memory_mb), result


def _give_back() -> None:
    """Free memory that the allocator holds back, which a frame would take without the process growing; only glibc
    can."""
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)


@lru_cache(maxsize=OPEN)
def _echoes(folder: Path, key: str) -> RadarCapture:
    """Frame 0; key: of the content."""
    return open_capture(folder).echoes(1)


def per_round(timings: Timings, names: Sequence[str], setting: str, part: str) -> np.ndarray:
    """Median over the captures `names` of a part of the frame, one for each round."""
    return np.array([np.median([getattr(r[name, setting], part) for name in names]) for r in timings.rounds])
