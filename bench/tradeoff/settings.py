"""The settings of a trade-off: their measurement in rounds, the front of the best ones, and the
choice of one.

The front consists of the settings that no other beats: no other is at least as fast, as accurate
and as complete, and better in one of these. A map that shows twice as much of a hand is not beaten
by a more accurate map of half of it.

The chosen setting is the cheapest one that is accurate enough, or the most accurate one that is
fast enough. A setting is judged by the upper end of its error's interval, and by a time a tenth
longer than its slowest round, so that a later run stays within the limits. With too few captures
for an interval, the error itself is used.
"""

import json
import time
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import product
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
from handbench.support.progress import part

HEADROOM = 1.1  # of a later run over the slowest round: the rounds are few
T = TypeVar("T")
Value = TypeVar("Value")


@dataclass(frozen=True)
class TradeoffInputs:
    """The inputs of every section of a trade-off.

    bench: the benchmark with its sweep of settings; base: folder to which its paths are relative;
    work: folder of the run's stages. found: captures, references and failures of a run without
    methods. reference: name of the surface that errors are measured from. targets: captures of the
    calibration target, if that surface comes from photographs. predicted_s: section → predicted
    processor time, s.
    """

    bench: BenchFile
    base: Path
    work: Path
    found: Outcome
    reference: str = "truth"
    targets: list[RunCapture] = field(default_factory=list)
    predicted_s: dict[str, float] = field(default_factory=dict)

    @property
    def sweep(self) -> TradeoffSweep:
        """The settings that the benchmark varies."""
        assert self.bench.tradeoff is not None  # `run` has completed it
        return self.bench.tradeoff

    @property
    def captures(self) -> list[RunCapture]:
        """The captures that have a reference surface."""
        return [
            c
            for c in self.found.captures
            if self.reference in self.found.references.get(c.name, {})
        ]


@dataclass(frozen=True)
class MeasuredSection:
    """A measured section of a trade-off: one step, such as imaging, with a row for each of its
    settings.

    The section on imaging also has facts about what was left out, the paper's claims on time, and
    the settings as benchmarks that can be run.
    """

    section: Section
    lines: list[Setting]
    facts: dict[str, Any] = field(default_factory=dict)
    claims: tuple[Claim, ...] = ()
    runnable: tuple[ImagingSetting, ...] = ()


def section(name: SectionName, reference: str, words: dict[str, Any]) -> Section:
    """Read the title, metric and definition of a section from sections.toml.

    reference: the setting relative to which ratios of times are given. words: name → text, for the
    placeholders in the definition.
    """
    about = tomllib.loads(Path(__file__).with_name("sections.toml").read_text("utf-8"))[name]
    about["definition"] = about["definition"].format(**words)
    return Section(name=name, reference=reference, **about)


def in_rounds(
    settings: Mapping[str, T],
    rounds: int,
    measure: Callable[[T], Iterable[dict[str, Any]]],
    title: str,
    predicted_s: float = 0.0,
) -> dict[str, list[dict[str, Any]]]:
    """Measure every setting once per round, so that a machine that becomes slower affects all
    settings equally.

    Args:
        settings: name → setting.
        rounds: how many times each setting is measured.
        measure: function from a setting to its results (dictionaries): one, several (for instance
            one per capture), or none if the setting fails.
        title: name of the measurement, for the progress bar.
        predicted_s: predicted processor time of all of it, s.

    Returns:
        name → the setting's results, each with its `round`, from 0.
    """
    lines: dict[str, list[dict[str, Any]]] = {name: [] for name in settings}
    for number, name in product(range(rounds), settings):
        label = f"{title}, round {number + 1} of {rounds}: {name}"
        with part(label, predicted_s / (rounds * len(settings))):
            lines[name] += [{"round": number, **line} for line in measure(settings[name])]
    return lines


def timed(work: Callable[[], Value]) -> tuple[Value, float]:
    """Call `work`: (its result, the seconds that it took)."""
    start = time.perf_counter()
    return work(), time.perf_counter() - start


@contextmanager
def added_memory() -> Iterator[Cost]:
    """Yield the cost of a `with` block, which is known at its end. Its peak_memory_mb is the
    largest amount, in MB, by which the block raised the resident memory."""
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
    """Make the row of a setting in a section's table, from its error and its times.

    of: the section. knobs: the setting's parameters. interval: that of the error. seconds: one time
    for each round; their median is recorded and, if there are several, their range. known: values
    of further columns. The ratio of times and the place on the front are added by `rank`.
    """
    low, high = interval or (None, None)
    times = {"seconds": float(np.median(seconds)) if len(seconds) else None}
    if len(seconds) > 1:
        times |= {"seconds_low": float(min(seconds)), "seconds_high": float(max(seconds))}
    texts = {"section": of.name, "name": name, "title": title, "metric": of.metric, "unit": of.unit}
    knobs_json = json.dumps(knobs, ensure_ascii=False)
    return Setting(**texts, knobs=knobs_json, error=error, low=low, high=high, **{**times, **known})


def dominates(one: Setting, other: Setting) -> bool:
    """Return True if `one` is at least as fast, accurate and complete as `other`, and better in one
    of these; False if either has no error or no time."""
    ours, theirs = ((s.seconds, s.error, -(s.seen_percent or 0.0)) for s in (one, other))
    if None in (*ours, *theirs) or ours == theirs:
        return False
    return all(a <= b for a, b in zip(ours, theirs, strict=True))


def front(settings: Iterable[Setting]) -> list[Setting]:
    """Return the settings that no other dominates, fastest first: no other is at least as fast,
    accurate and complete, and better in one of these. Settings without error or time are left
    out."""
    known = [s for s in settings if s.error is not None and s.seconds is not None]
    return sorted(
        (s for s in known if not any(dominates(t, s) for t in known)),
        key=lambda s: (s.seconds, s.error),
    )


def rank(settings: Sequence[Setting], reference: str) -> list[Setting]:
    """Return the settings of one section with the ratio of their time to that of the setting
    `reference`, and with their rank.

    The rank tells whether a setting is on the front of all settings, whether it is on the front of
    those of its method, and which setting dominates it. If several do, it is the most accurate of
    them on the front.
    """
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
    """Return the settings whose acquisition time (that to record the echoes) is known, with this
    time added to their seconds."""
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
    """Choose an imaging setting within a largest error, a longest time, or both: (setting, question
    in words).

    With a largest error, the cheapest setting within the limits is chosen; with only a longest
    time, the most accurate. count_acquisition: the time to record the echoes counts too. Raises
    HandbenchError, which names the nearest setting, if none is within the limits.
    """
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
        """Return the largest factor by which the setting exceeds a limit; it is at most 1 if the
        setting is within all limits."""
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
