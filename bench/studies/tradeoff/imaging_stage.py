"""Imaging: every setting's error and time, side by side in one run: settings and captures taken in turns, each frame
after one that makes its plan.
"""

from __future__ import annotations

import ctypes
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from bench.datasets.dataset import open_capture
from bench.evaluation.metrics import HEADLINE, METRICS, pool
from bench.evaluation.scoring_protocols import protocol
from bench.evaluation.statistics.intervals import pooled_intervals
from bench.results import Claim, Failure, Section, Setting, write_errors
from bench.results.error_map import ErrorMap
from bench.run.benchmark_file import MethodEntry
from bench.run.outcome import Capture, Outcome, basis
from bench.run.reconstruct_stage import configuration
from bench.run.scoring import Files, compare, read_errors, reference_depth
from bench.run.sweep import ImagingSetting, Sweep, imaging_settings, known_configs
from bench.studies.tradeoff.claims import claims
from bench.studies.tradeoff.opening import Opened
from bench.studies.tradeoff.section_lines import Context, line, section
from groundtruth.mesh.depth import Reference
from radar.data.capture import RadarCapture, thinned
from radar.data.grid import PixelGrid
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


@dataclass(frozen=True)
class Imaging:
    """The section with its settings and claims; settings that stand, by name; facts: what was left out, and why."""

    section: Section
    lines: list[Setting]
    settings: dict[str, ImagingSetting]
    claims: tuple[Claim, ...] = ()
    facts: dict[str, Any] = field(default_factory=dict)


def measure(sweep: Sweep, context: Context, ready: Opened) -> Imaging:
    """Time and score all settings. What one of them cannot do is left out as in a run's table: captures are common to
    all settings that stay. Raises HandbenchError where nothing stays."""
    settings = imaging_settings(sweep, known_configs(context.bench.method))
    scorer = Scorer(context, ready)
    timings = timed_in_turns(settings, context.captures, context.repeats, scorer.keep)
    found = Outcome(
        context.bench.model_copy(update={"method": tuple(MethodEntry(id=s.name) for s in settings)}),
        context.captures,
        [],
        [*ready.found.failures, *timings.failures],
    )
    on = basis(found)
    names, stay = [capture.name for capture in on.captures], {entry.id for entry in on.methods}
    standing = {s.name: s for s in settings if s.name in stay}
    reference = sweep.reference if sweep.reference in standing else next(iter(standing))
    metric, surface = METRICS[HEADLINE], "the true surface" if ready.reference == "truth" else ready.reference
    words = {"metric": metric.definition, "surface": surface}
    about = section("imaging", reference, words, metric=HEADLINE, unit=metric.unit)
    lines = [_line(about, s, names, timings, scorer.errors(names, s.name), sweep.step_s) for s in standing.values()]
    stated = claims(list(standing.values()), lines, on.captures[0], sweep.exact_planes, context.repeats)
    left_out = {"left_out": [failure.line for failure in found.failures]} if found.failures else {}
    return Imaging(about, lines, standing, stated, {"basis": on.text, **left_out})


class Scorer:
    """Compares depth maps with the reference as a run does; the error maps lie in files."""

    def __init__(self, context: Context, ready: Opened) -> None:
        self.ready, self.protocol = ready, protocol(context.bench.protocol)
        self.folder = context.work / "scores"
        self._cast: dict[tuple[str, bytes, bytes], Reference] = {}  # settings that share a grid share its depth

    def keep(self, capture: Capture, setting: ImagingSetting, result: Reconstruction) -> None:
        """Score one result."""
        depth, name = result.depth, self.ready.reference
        mesh, transform = self.ready.found.references[capture.name][name]
        grid = capture.name, depth.x_m.tobytes(), depth.y_m.tobytes()
        if grid not in self._cast:
            pixels = PixelGrid(depth.x_m, depth.y_m)
            self._cast[grid] = reference_depth(mesh, transform, pixels, exact=name == "truth")
        errors = compare(depth, self._cast[grid], self.protocol, open_capture(capture.folder))
        write_errors(self.folder, capture.name, setting.name, name, errors)

    def errors(self, names: Sequence[str], setting: str) -> Sequence[ErrorMap]:
        """A setting's error maps of some captures, read one at a time."""
        return Files(lambda name: read_errors(self.folder, name, setting, self.ready.reference), names)


def _line(
    about: Section,
    setting: ImagingSetting,
    names: Sequence[str],
    timings: Timings,
    errors: Sequence[ErrorMap],
    step_s: float,
) -> Setting:
    """One setting's line; the medians of the parts add up to the median of the whole."""

    def part(name: str) -> np.ndarray:
        return per_round(timings, names, setting.name, name)

    figures, seconds, tones = pool(errors), part("seconds"), int(part("tones").max())
    imaging_s = min(float(np.median(part("imaging_s"))), float(np.median(seconds)))
    frames = [frame for r in timings.rounds for (_, name), frame in r.items() if name == setting.name]
    knobs = {"method": setting.method, **setting.varied, "every_nth_antenna": setting.every_nth_antenna, "tones": tones}
    return line(
        about,
        setting.name,
        setting.title,
        knobs,
        figures[HEADLINE],
        pooled_intervals(errors, estimate=figures).get(HEADLINE),
        seconds,
        seconds_low=float(seconds.min()),
        seconds_high=float(seconds.max()),
        acquisition_s=tones * step_s if tones else None,
        plan_s=float(np.median([_plan_s(r, names, setting.name) for r in timings.rounds])),
        imaging_s=imaging_s,
        extraction_s=float(np.median(seconds)) - imaging_s,
        operations=float(np.median(part("terms"))) or None,
        peak_memory_mb=max(frame.memory_mb for frame in frames),
        seen_percent=figures["completeness_percent"],
    )


def _plan_s(frames: dict[tuple[str, str], Any], names: Sequence[str], setting: str) -> float:
    """The time of a round's plans: captures may share one, or need one each; the longest."""
    return max(frames[name, setting].plan_s for name in names)
