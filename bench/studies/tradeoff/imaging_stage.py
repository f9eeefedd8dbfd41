"""Imaging: every setting's error and time, side by side in one run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from bench.datasets.dataset import open_capture
from bench.evaluation.metrics import HEADLINE, METRICS, pool
from bench.evaluation.scoring_protocols import protocol
from bench.evaluation.statistics.intervals import pooled_intervals
from bench.results import Claim, Section, Setting, write_errors
from bench.results.error_map import ErrorMap
from bench.run.benchmark_file import MethodEntry
from bench.run.outcome import Capture, Outcome, basis
from bench.run.scoring import Files, compare, read_errors, reference_depth
from bench.run.sweep import ImagingSetting, Sweep, imaging_settings, known_configs
from bench.studies.tradeoff.claims import claims
from bench.studies.tradeoff.context import Context
from bench.studies.tradeoff.frame_timing import Timings, per_round, timed_in_turns
from bench.studies.tradeoff.lines import line, section
from bench.studies.tradeoff.opening import Opened
from groundtruth.mesh.depth import Reference
from radar.data.grid import PixelGrid
from radar.methods.registry import Reconstruction


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
