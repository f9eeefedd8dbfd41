"""The settings of a trade-off: how they are measured, in rounds and side by side, which are worth
their time, and which of them to take.

On the front are the settings that nothing else beats: nothing is at least as fast, accurate and
complete, and better in one. A map that shows twice as much of a hand is not beaten by a more
accurate one of half of it.

To take is the cheapest that is accurate enough, or the most accurate that is fast enough. A setting
is held to the upper end of its error's interval, and to a tenth more than the slowest of its
rounds, so that a later run of it, which is one more draw, keeps what this one promised. Too few
captures have no interval: the error is then that of these.
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
    """The inputs of every section. bench: the benchmark, with its sweep, whose paths start from
    `base`; work: the folder of kept stages; found: captures, references and failures of a run
    without methods; reference: the name of what scores all; targets: the calibration's captures,
    where photographs have to score."""

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
    """A section with the lines of its settings. Of the imaging section: facts of what was left out,
    and why; claims; the settings that can be run."""

    section: Section
    lines: list[Setting]
    facts: dict[str, Any] = field(default_factory=dict)
    claims: tuple[Claim, ...] = ()
    runnable: tuple[ImagingSetting, ...] = ()


def section(name: SectionName, reference: str, words: dict[str, Any]) -> Section:
    """The section of sections.toml; words: fill in its definition."""
    about = tomllib.loads(Path(__file__).with_name("sections.toml").read_text("utf-8"))[name]
    about["definition"] = about["definition"].format(**words)
    return Section(name=name, reference=reference, **about)


def in_rounds(
    settings: Mapping[str, T],
    rounds: int,
    measure: Callable[[T], Iterable[dict[str, Any]]],
    title: str,
) -> dict[str, list[dict[str, Any]]]:
    """Measure every setting once a round, so that a machine that gets slower does so for all of
    them.

    Args:
        settings: by name.
        rounds: how often.
        measure: gives a setting's lines, one or several (of captures, for instance), or none where
            it is refused.
        title: of the progress.

    Returns:
        The lines of each setting, with their `round`.
    """
    lines: dict[str, list[dict[str, Any]]] = {name: [] for name in settings}
    for number in range(rounds):
        for name in track(list(settings), f"{title}, round {number + 1} of {rounds}"):
            lines[name] += [{"round": number, **line} for line in measure(settings[name])]
    return lines


def timed(work: Callable[[], Value]) -> tuple[Value, float]:
    """The result of `work` and its seconds."""
    start = time.perf_counter()
    return work(), time.perf_counter() - start


@contextmanager
def added_memory() -> Iterator[Cost]:
    """Measure a block; of the memory what was added to the resident one."""
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
    """The setting's line; one time has no range, and no time is None. Its rank, `rank` fills in."""
    low, high = interval or (None, None)
    times = {"seconds": float(np.median(seconds)) if len(seconds) else None}
    if len(seconds) > 1:
        times |= {"seconds_low": float(min(seconds)), "seconds_high": float(max(seconds))}
    texts = {"section": of.name, "name": name, "title": title, "metric": of.metric, "unit": of.unit}
    knobs_json = json.dumps(knobs, ensure_ascii=False)
    return Setting(**texts, knobs=knobs_json, error=error, low=low, high=high, **{**times, **known})


def dominates(one: Setting, other: Setting) -> bool:
    """True where `one` is at least as fast, accurate and complete as `other`, and better in one;
    False where either lacks an error or a time."""
    ours, theirs = ((s.seconds, s.error, -(s.seen_percent or 0.0)) for s in (one, other))
    if None in (*ours, *theirs) or ours == theirs:
        return False
    return all(a <= b for a, b in zip(ours, theirs, strict=True))


def front(settings: Iterable[Setting]) -> list[Setting]:
    """The settings that nothing dominates, fastest first; one without error or time is never among
    them."""
    known = [s for s in settings if s.error is not None and s.seconds is not None]
    return sorted(
        (s for s in known if not any(dominates(t, s) for t in known)),
        key=lambda s: (s.seconds, s.error),
    )


def rank(settings: Sequence[Setting], reference: str) -> list[Setting]:
    """The settings of one section with ratio (to the reference's seconds), on_front,
    on_method_front and dominated_by filled in. Of several that dominate a setting the most accurate
    one of the front is named."""
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
    """The settings whose acquisition is known, with its time counted."""
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
    """The imaging setting for a largest error (the cheapest), a longest time (the most accurate),
    or both (the cheapest), with its acquisition among its seconds where that is counted; and the
    question in words. Raises HandbenchError where none keeps to it, naming the nearest."""
    settings = [
        s for s in tradeoff.section("imaging") if s.error is not None and s.seconds is not None
    ]
    settings = with_acquisition(settings) if count_acquisition else settings
    if not settings:
        raise HandbenchError(
            f"{tradeoff.folder}: has no imaging settings to choose from; sweep the section imaging"
        )
    time_of = "frame and acquisition" if count_acquisition else "frame"
    limits = (
        [f"{METRICS[HEADLINE].title} ≤ {max_error_mm:g} mm"] if max_error_mm is not None else []
    )
    limits += [f"{time_of} ≤ {1e3 * max_seconds:g} ms"] if max_seconds is not None else []
    asked = " and ".join(limits)

    def excess(s: Setting) -> float:
        """By what factor the setting goes beyond the limits at worst; at most 1: it keeps to
        them."""
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
            f"no setting has {asked}; the nearest, '{near.name}', has {near.error:.3g} mm "
            f"({bound}) in "
            f"{1e3 * near.seconds:.3g} ms (up to {1e3 * HEADROOM * near.seconds_high:.3g}): "
            "allow more, or sweep "
            "further"
        )
    if max_error_mm is None:
        return min(fit, key=lambda s: (s.error, s.seconds)), f"the most accurate with {asked}"
    chosen = min(fit, key=lambda s: (s.seconds, s.error))
    few = " on these captures, too few to promise it for others" if chosen.high is None else ""
    return chosen, f"the cheapest with {asked}{few}"
