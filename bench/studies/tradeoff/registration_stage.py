"""The number of combined captures of the calibration target, and the transform's error where hands are."""

import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Annotated, TypeVar

import numpy as np
import pandas as pd
from pydantic import Field

from handbench.bench.evaluation.intervals import Interval, mean_interval
from handbench.bench.results import Section, Setting
from handbench.bench.scenes.build import build
from handbench.bench.scenes.echoes import echoes
from handbench.bench.studies.tradeoff.opening import Context, line, section
from handbench.bench.studies.tradeoff.target_placements import Placement, placement, seen_cloud
from handbench.calibration.registration import register as registration
from handbench.calibration.registration.register import combine
from handbench.calibration.registration.rigid_fit import Pairs
from handbench.calibration.transforms import Transform
from handbench.radar.warmup import compile_kernels
from handbench.support.config import Config
from handbench.support.errors import HandbenchError
from handbench.support.progress import say, track

Made = TypeVar("Made")
MOST = 100  # captures of a rig, and rigs: numbers that are drawn from do not meet
VOLUME_M = np.array(list(product(np.linspace(-0.06, 0.06, 5), np.linspace(-0.1, 0.1, 5), np.linspace(0.25, 0.35, 5))))


class RegistrationKnobs(Config):
    """captures: how many are combined; trials: rigs, each with a target that is made anew within its tolerances."""

    captures: tuple[Annotated[int, Field(ge=1, le=MOST)], ...] = Field(default=(1, 2, 4), min_length=1)
    trials: int = Field(default=3, ge=1, le=MOST)


@dataclass(frozen=True)
class Measured:
    """The measurement of a rig's capture of the target (`calibration.registration.register.measure`), and in how many
    seconds."""

    placed: Placement
    pairs: Pairs
    common_m2: np.ndarray
    seconds: float


def measure(knobs: RegistrationKnobs, context: Context) -> tuple[Section, list[Setting]]:
    """Capture the target `max(captures)` times before each of `trials` rigs, and combine as many as each setting says;
    every capture takes part in one combination of each number at most."""
    compile_kernels()
    counts, most = list(dict.fromkeys(knobs.captures)), max(knobs.captures)
    numbers = [MOST * (MOST * context.seed + trial) for trial in range(knobs.trials)]
    found, acquisition_s = [], 0.0
    with tempfile.TemporaryDirectory(dir=context.work, prefix=".registration-") as folder:
        for number in track(numbers, "registration"):
            measured = list(filter(None, map(_measured, placements(number, most, Path(folder)))))
            for count in counts:
                groups = [measured[i : i + count] for i in range(0, len(measured) - count + 1, count)]
                found += [(count, number, *_combined(group)) for group in groups]
            for one in measured[:1]:
                sensor = one.placed.scene.file.sensor
                acquisition_s = len(sensor.frequencies_hz) * sensor.step_time_s
    volume = " × ".join(f"{1e3 * size:.0f}" for size in np.ptp(VOLUME_M, axis=0))
    about = section("registration", _name(min(counts)), {"volume": volume, "trials": knobs.trials})
    tried = pd.DataFrame(found, columns=["count", "rig", "square_m2", "seconds"])
    return about, [_setting(about, n, tried[tried["count"] == n], n * acquisition_s) for n in counts]


def placements(number: int, count: int, folder: Path) -> list[Placement]:
    """One rig and one target, which stands elsewhere in each of `count` captures."""
    first = placement(number, folder / str(number))
    found = [first]
    for other in range(number + 1, number + count):
        moved = placement(other, folder / str(other)).scene.file
        file = first.scene.file.model_copy(update={"seed": other, "target": moved.target})
        found.append(replace(first, number=other, scene=build(file, folder / str(number))))
    return found


def _measured(chosen: Placement) -> Measured | None:
    points_m, normals = seen_cloud(chosen)
    heard = echoes(chosen.scene).capture
    found, seconds = _timed(chosen, lambda: registration.measure(points_m, normals, heard, chosen.described))
    return None if found is None else Measured(chosen, *found, seconds)


def _combined(group: Sequence[Measured]) -> tuple[float, float]:
    """Several captures of one rig as one transform: mean square of its error over the hand's volume, m² (NaN: refused),
    and the seconds of all of it."""
    first, common_m2 = group[0].placed, np.mean([one.common_m2 for one in group], axis=0)
    known = {"common_m2": common_m2, "ball_offset_sigma_m": first.described.ball_offset_sigma_m}
    found, seconds = _timed(first, lambda: combine([one.pairs for one in group], **known))
    seconds += sum(one.seconds for one in group)
    if found is None:
        return np.nan, seconds
    return float((errors_m(found, first.scene.radar_from_photo) ** 2).mean()), seconds


def errors_m(found: Transform, true: Transform) -> np.ndarray:
    """Distances [n] between the places to which both transforms carry the points of VOLUME_M, where hands are."""
    return np.linalg.norm(found.points(true.inverse().points(VOLUME_M)) - VOLUME_M, axis=1)


def _timed(chosen: Placement, work: Callable[[], Made]) -> tuple[Made | None, float]:
    """The result of `work`, None where it is refused, as is said; and its seconds."""
    start, found = time.perf_counter(), None
    try:
        found = work()
    except HandbenchError as error:
        say(f"tradeoff: registration, placement {chosen.number}: {error}")
    return found, time.perf_counter() - start


def _setting(about: Section, count: int, tried: pd.DataFrame, acquisition_s: float) -> Setting:
    """tried: the combinations of all rigs."""
    square_m2 = tried.groupby("rig").square_m2.mean().dropna().to_numpy()
    refused = int(tried.square_m2.isna().sum())
    note = f" ({refused} of {len(tried)} refused)" if refused else ""
    return line(
        about,
        _name(count),
        _name(count).replace("-", " ") + note,
        {"captures": count},
        1e3 * float(np.sqrt(square_m2.mean())) if len(square_m2) else None,
        rms_interval_mm(square_m2),
        tried.seconds.to_list(),
        acquisition_s=acquisition_s,
    )


def rms_interval_mm(square_m2: np.ndarray) -> Interval | None:
    """95 % interval of a root mean square from the mean squares [n] of independent rigs, m²; None for too few."""
    found = mean_interval(1e6 * square_m2)
    return None if found is None else Interval(max(found.low, 0.0) ** 0.5, found.high**0.5)


def _name(count: int) -> str:
    return "1-capture" if count == 1 else f"{count}-captures"
