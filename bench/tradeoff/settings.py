"""The settings of a trade-off: measuring them in rounds, the front, and the choice of a setting.

The front consists of the settings that no other beats: no other is at least as fast, as accurate
and as complete, and better in one of these. A map that shows twice as much of a hand is not beaten
by a more accurate one of half of it.

The answer to a question is the cheapest setting that is accurate enough, or the most accurate one
that is fast enough. A setting is judged by the upper end of its error's interval, and by a tenth
more than its slowest round, so that a later run keeps the promise. Too few captures have no
interval; then the error itself is used.
"""

import json
import time
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from psutil import Process

from handbench.bench.evaluation.intervals import Interval
from handbench.bench.evaluation.metrics import METRICS
from handbench.bench.results import HEADLINE, Claim, Section, Setting, Tradeoff
from handbench.bench.run.benchmark_file import BenchFile
from handbench.bench.run.outcome import Outcome, RunCapture
from handbench.bench.run.sweep import ImagingSetting, SectionName, TradeoffSweep
from handbench.support.cost import Cost, measured
from handbench.support.errors import HandbenchError
from handbench.support.progress import track

HEADROOM = 1.1  # of a later run over the slowest round: the rounds are few
T = TypeVar("T")
Value = TypeVar("Value")


@dataclass(frozen=True)
class TradeoffInputs:
    """What every section of a trade-off starts from.
    bench: the benchmark, with its sweep; base: folder from which its paths start; work: folder of
    the run's steps. found: captures, references and failures of a run without methods. reference:
    name of the surface that errors refer to. targets: captures of the calibration target, if
    photographs are scored against."""

    bench: BenchFile
    base: Path
    work: Path
    found: Outcome
    reference: str = "truth"
    targets: list[RunCapture] = field(default_factory=list)

    @property
    def sweep(self) -> TradeoffSweep:
        """The benchmark's sweep."""
        assert self.bench.tradeoff is not None  # `run` has completed it
        return self.bench.tradeoff

    @property
    def captures(self) -> list[RunCapture]:
        """The captures that have the reference."""
        return [
            c
            for c in self.found.captures
            if self.reference in self.found.references.get(c.name, {})
        ]


@dataclass(frozen=True)
class MeasuredSection:
    """A measured section of a trade-off: one stage, with a line for each of its settings.
    For imaging also: facts on what was left out, the paper's claims on time, and the settings as
    benchmarks that can be run."""

    section: Section
    lines: list[Setting]
    facts: dict[str, Any] = field(default_factory=dict)
    claims: tuple[Claim, ...] = ()
    runnable: tuple[ImagingSetting, ...] = ()


def section(name: SectionName, reference: str, words: dict[str, Any]) -> Section:
    """Read a section's title, metric and definition from sections.toml.
    reference: the setting to which ratios of times refer. words: name → text, filled into the
    definition."""
    about = tomllib.loads(Path(__file__).with_name("sections.toml").read_text("utf-8"))[name]
    about["definition"] = about["definition"].format(**words)
    return Section(name=name, reference=reference, **about)


def in_rounds(
    settings: Mapping[str, T],
    rounds: int,
    measure: Callable[[T], Iterable[dict[str, Any]]],
    title: str,
) -> dict[str, list[dict[str, Any]]]:
    """Measure every setting once per round, so that a machine that slows down affects all of them
    equally.

    Args:
        settings: name → setting.
        rounds: how often each is measured.
        measure: takes a setting, returns its lines (dictionaries): one, several (of captures, for
        instance), or none if it is refused.
        title: of the progress.

    Returns:
        name → the setting's lines, each with its `round`, from 0.
    """
    lines: dict[str, list[dict[str, Any]]] = {name: [] for name in settings}
    for number in range(rounds):
        for name in track(list(settings), f"{title}, round {number + 1} of {rounds}"):
            lines[name] += [{"round": number, **line} for line in measure(settings[name])]
    return lines


def timed(work: Callable[[], Value]) -> tuple[Value, float]:
    """Call `work`; return its result and the seconds that it took."""
    start = time.perf_counter()
    return work(), time.perf_counter() - start


@contextmanager
def added_memory() -> Iterator[Cost]:
    """Yield the cost of a block, known at its end; its memory is what the block added to the
    resident memory at most, MB."""
    before_mb = Process().memory_info().rss / 1e6
    with measured() as cost:
        yield cost
    cost.peak_memory_mb = max(cost.peak_memory_mb - before_mb, 0.0)


def line(
    of: Section,
    name: str,
    title: str,
    knobs: dict[str, Any],
    error: float | None = None,
    interval: Interval | None = None,
    seconds: Sequence[float] = (),
    **known: float | None,
) -> Setting:
    """Make a setting's line from its error and its times.
    knobs: the setting's parameters. interval: of the error. seconds: a time for each round; their
    median, and with several also their range, are recorded. known: further columns. Ratio and front
    are filled in by `rank`."""
    low, high = interval or (None, None)
    times = {"seconds": float(np.median(seconds)) if len(seconds) else None}
    if len(seconds) > 1:
        times |= {"seconds_low": float(min(seconds)), "seconds_high": float(max(seconds))}
    texts = {"section": of.name, "name": name, "title": title, "metric": of.metric, "unit": of.unit}
    knobs_json = json.dumps(knobs, ensure_ascii=False)
    return Setting(**texts, knobs=knobs_json, error=error, low=low, high=high, **{**times, **known})


def dominates(one: Setting, other: Setting) -> bool:
    """Return whether `one` is at least as fast, accurate and complete as `other`, and better in one
    of these; False if either lacks an error or a time."""
    ours, theirs = ((s.seconds, s.error, -(s.seen_percent or 0.0)) for s in (one, other))
    if None in (*ours, *theirs) or ours == theirs:
        return False
    return all(a <= b for a, b in zip(ours, theirs, strict=True))


def front(settings: Iterable[Setting]) -> list[Setting]:
    """Return the settings that no other dominates (is at least as fast, accurate and complete, and
    better in one), fastest first. Settings without error or time are left out."""
    known = [s for s in settings if s.error is not None and s.seconds is not None]
    return sorted(
        (s for s in known if not any(dominates(t, s) for t in known)),
        key=lambda s: (s.seconds, s.error),
    )


def rank(settings: Sequence[Setting], reference: str) -> list[Setting]:
    """Return one section's settings with their time relative to the reference's (ratio) and their
    place: on the front of all settings, on the front of their method, or dominated by which one.
    reference: name of the setting. If several dominate one, the most accurate one on the front is
    named."""
    best = front(settings)
    own = [
        s
        for method in {s.method for s in settings}
        for s in front(s for s in settings if s.method == method)
    ]
    unit = next((s.seconds for s in settings if s.name == reference), None)
    ranked = []
    for setting in settings:
        over = [s for s in best if dominates(s, setting)]
        ratio = setting.seconds / unit if setting.seconds is not None and unit else None
        by = min(over, key=lambda s: (s.error, s.seconds)).name if over else ""
        fronts = {"on_front": setting in best, "on_method_front": setting in own}
        ranked.append(replace(setting, ratio=ratio, dominated_by=by, **fronts))
    return ranked


def with_acquisition(settings: Iterable[Setting]) -> list[Setting]:
    """Return the settings whose acquisition time is known, with it added to their seconds."""
    known = [(s, s.acquisition_s) for s in settings if s.acquisition_s is not None]
    times = ("seconds", "seconds_low", "seconds_high")
    return [
        replace(s, **{key: v + add_s for key in times if (v := getattr(s, key)) is not None})
        for s, add_s in known
    ]


def answer(
    tradeoff: Tradeoff,
    max_error_mm: float | None = None,
    max_seconds: float | None = None,
    count_acquisition: bool = False,
) -> tuple[Setting, str]:
    """Choose an imaging setting for a largest error, a longest time, or both; return it, and the
    question in words.
    With a largest error it is the cheapest that keeps to the limits, with only a longest time the
    most accurate. count_acquisition: the time to record the echoes counts too. Raises
    HandbenchError if no setting keeps to the limits, naming the nearest."""
    settings = [
        s for s in tradeoff.section("imaging") if s.error is not None and s.seconds is not None
    ]
    settings = with_acquisition(settings) if count_acquisition else settings
    if not settings:
        raise HandbenchError(
            f"{tradeoff.folder}: has no settings of imaging to choose from; measure the section "
            "imaging"
        )
    time_of = "frame and acquisition" if count_acquisition else "frame"
    limits = (
        [f"{METRICS[HEADLINE].title} ≤ {max_error_mm:g} mm"] if max_error_mm is not None else []
    )
    limits += [f"{time_of} ≤ {1e3 * max_seconds:g} ms"] if max_seconds is not None else []
    asked = " and ".join(limits)

    def excess(s: Setting) -> float:
        """The largest factor by which the setting exceeds a limit; at most 1: it keeps to all."""
        error_mm = s.error if s.high is None else s.high
        factors = [error_mm / max_error_mm] if max_error_mm is not None else []
        return max(
            factors + ([HEADROOM * s.seconds_high / max_seconds] if max_seconds is not None else [])
        )

    fit = [s for s in settings if excess(s) <= 1]
    if not fit:
        near = min(settings, key=excess)
        bound = f"up to {near.high:.3g} mm" if near.high is not None else "on these captures"
        raise HandbenchError(
            f"no setting has {asked}; the nearest is '{near.name}' with {near.error:.3g} mm "
            f"({bound}) in "
            f"{1e3 * near.seconds:.3g} ms (up to {1e3 * HEADROOM * near.seconds_high:.3g} ms); "
            "raise the limit, or measure more settings"
        )
    if max_error_mm is None:
        return min(fit, key=lambda s: (s.error, s.seconds)), f"the most accurate with {asked}"
    chosen = min(fit, key=lambda s: (s.seconds, s.error))
    few = " on these captures, too few to promise it for others" if chosen.high is None else ""
    return chosen, f"the cheapest with {asked}{few}"
