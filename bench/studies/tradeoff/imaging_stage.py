"""Imaging: every setting's error and time, side by side in one run: settings and captures taken in turns, each frame
after one that makes its plan.
"""

import ctypes
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import pandas as pd
import psutil

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.evaluation.depth_errors import ErrorMap
from handbench.bench.evaluation.intervals import figure_interval
from handbench.bench.evaluation.metrics import HEADLINE, METRICS, averaged, of_captures
from handbench.bench.evaluation.scoring_protocols import protocol
from handbench.bench.pipeline.image import configuration, prepare
from handbench.bench.pipeline.score import pixel_errors, reference_of_file
from handbench.bench.results import Claim, Failure, Section, Setting, read_errors, write_errors
from handbench.bench.run.benchmark_file import MethodEntry
from handbench.bench.run.outcome import Capture, Outcome, basis, failing
from handbench.bench.run.sweep import ImagingSetting, Sweep, imaging_settings, known_configs
from handbench.bench.studies.tradeoff.claims import claims
from handbench.bench.studies.tradeoff.opening import Context, Opened, line, section
from handbench.groundtruth.mesh.depth import Reference
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.grid import PixelGrid
from handbench.radar.imaging.api import Laps, watch
from handbench.radar.imaging.plan import fresh_plans
from handbench.radar.methods.registry import Reconstruction, method
from handbench.radar.warmup import compile_kernels
from handbench.support.cost import measured
from handbench.support.progress import track

OPEN = 4  # captures whose echoes are kept in memory


def timed_in_turns(
    settings: Sequence[ImagingSetting],
    captures: Sequence[Capture],
    repeats: int,
    keep: Callable[[Capture, ImagingSetting, Reconstruction], None],
) -> tuple[pd.DataFrame, list[Failure]]:
    """Image every capture by every setting, `repeats` rounds: a line a frame (round, capture, setting, and what
    `_timed` says of it), and what failed with a HandbenchError, which is said and not tried again. keep(capture,
    setting, result) is given each result of the first round, untimed."""
    compile_kernels()
    frames: list[dict[str, Any]] = []
    failures: list[Failure] = []
    for round_ in range(repeats):
        for setting in track(settings, f"imaging, round {round_ + 1} of {repeats}"):
            with fresh_plans():
                for capture in captures:
                    if (capture.name, setting.name) in {(failure.capture, failure.method) for failure in failures}:
                        continue
                    with failing(failures, capture.name, "reconstruct", setting.name):
                        frame, result = _timed(capture, setting)
                        frames.append({"round": round_, "capture": capture.name, "setting": setting.name, **frame})
                        if round_ == 0:
                            keep(capture, setting, result)
    return pd.DataFrame(frames), failures


def _timed(capture: Capture, setting: ImagingSetting) -> tuple[dict[str, float], Reconstruction]:
    """As the runner times a frame: imaged once for the plan, then again. seconds and the imaging among them, when its
    plan was there; plan_s: what the frame before it took longer; memory_mb: by how much that one raised the resident
    memory at most; terms and tones that were imaged."""
    config = configuration(capture.folder, setting.method, setting.config)
    echoes = _echoes(capture.folder, capture.key)
    task = prepare(echoes, method(setting.method), config, every_nth_antenna=setting.every_nth_antenna)

    def once() -> tuple[Reconstruction, float, Laps]:
        with watch() as laps:
            start = time.perf_counter()
            result = task.image()
            return result, time.perf_counter() - start, laps

    with suppress(OSError, AttributeError):  # glibc alone gives memory back that a frame would take without growing
        ctypes.CDLL(None).malloc_trim(0)
    before_mb = psutil.Process().memory_info().rss / 1e6
    with measured() as cost:
        _, first_s, _ = once()
    result, seconds, laps = once()
    plan_s, memory_mb = max(first_s - seconds, 0.0), max(cost.peak_memory_mb - before_mb, 0.0)
    counts = {"imaging_s": laps.imaging_s, "terms": laps.terms, "tones": laps.tones}
    return {"seconds": seconds, "plan_s": plan_s, "memory_mb": memory_mb, **counts}, result


@lru_cache(maxsize=OPEN)
def _echoes(folder: Path, key: str) -> RadarCapture:
    """Frame 0; key: of the content."""
    return open_capture(folder).echoes(1)


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
    scores, scored = context.work / "scores", protocol(context.bench.protocol)
    cast: dict[tuple[str, bytes, bytes], Reference] = {}  # settings that share a grid share its depth

    def keep(capture: Capture, setting: ImagingSetting, result: Reconstruction) -> None:
        """Compare with the reference as a run does, into a file."""
        depth, name = result.depth, ready.reference
        mesh, transform = ready.found.references[capture.name][name]
        grid = capture.name, depth.x_m.tobytes(), depth.y_m.tobytes()
        if grid not in cast:
            cast[grid] = reference_of_file(mesh, transform, PixelGrid(depth.x_m, depth.y_m), exact=name == "truth")
        errors = pixel_errors(depth, cast[grid], scored, open_capture(capture.folder))
        write_errors(scores, capture.name, setting.name, name, errors)

    def errors(setting: str) -> Iterator[ErrorMap]:
        """A setting's error maps, read one at a time."""
        return (read_errors(scores, name, setting, ready.reference) for name in names)

    frames, failures = timed_in_turns(settings, context.captures, context.repeats, keep)
    bench = context.bench.model_copy(update={"method": tuple(MethodEntry(id=s.name) for s in settings)})
    found = Outcome(bench, context.captures, [], [*ready.found.failures, *failures])
    on = basis(found)
    names, stay = [capture.name for capture in on.captures], {entry.id for entry in on.methods}
    standing = {s.name: s for s in settings if s.name in stay}
    reference = sweep.reference if sweep.reference in standing else next(iter(standing))
    metric, surface = METRICS[HEADLINE], "the true surface" if ready.reference == "truth" else ready.reference
    words = {"metric": metric.definition, "surface": surface}
    about = section("imaging", reference, words, metric=HEADLINE, unit=metric.unit)
    of_setting = dict(iter(frames.groupby("setting")))
    lines = [_line(about, s, names, of_setting[s.name], errors(s.name), sweep.step_s) for s in standing.values()]
    stated = claims(list(standing.values()), lines, on.captures[0], sweep.exact_planes, context.repeats)
    left_out = {"left_out": [failure.line for failure in found.failures]} if found.failures else {}
    return Imaging(about, lines, standing, stated, {"basis": on.text, **left_out})


def _line(
    about: Section,
    setting: ImagingSetting,
    names: Sequence[str],
    frames: pd.DataFrame,
    errors: Iterator[ErrorMap],
    step_s: float,
) -> Setting:
    """One setting's line, of the median over the captures `names` in each round; the medians of the parts add up to the
    median of the whole. Of a round's plans, which captures may share or need one each, the longest counts."""
    rounds = frames[frames.capture.isin(names)].groupby("round")
    part = rounds[["seconds", "imaging_s", "terms", "tones"]].median()
    captures, seconds, tones = of_captures(errors), float(part.seconds.median()), int(part.tones.max())
    figures = averaged(captures)
    imaging_s = min(float(part.imaging_s.median()), seconds)
    knobs = {"method": setting.method, **setting.varied, "every_nth_antenna": setting.every_nth_antenna, "tones": tones}
    return line(
        about,
        setting.name,
        setting.title,
        knobs,
        figures[HEADLINE],
        figure_interval(HEADLINE, captures[HEADLINE].to_numpy()),
        part.seconds.to_list(),
        seconds_low=float(part.seconds.min()),
        seconds_high=float(part.seconds.max()),
        acquisition_s=tones * step_s if tones else None,
        plan_s=float(rounds.plan_s.max().median()),
        imaging_s=imaging_s,
        extraction_s=seconds - imaging_s,
        operations=float(part.terms.median()) or None,
        peak_memory_mb=float(frames.memory_mb.max()),
        seen_percent=figures["observed_percent"],
    )
