"""The sections of a trade-off: what each is given, what it is held to (sections.toml), and one setting of it as a line
of tradeoff.csv.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bench.evaluation.statistics.intervals import Interval
from bench.results import Section, Setting
from bench.run.sweep import SectionName

if TYPE_CHECKING:  # they import what declares the sweep
    from bench.run.benchmark_file import BenchFile
    from bench.run.outcome import Capture


@dataclass(frozen=True)
class Context:
    """bench: the benchmark, whose paths start from `base`; work: the claimed folder for kept stages; captures: opened,
    folders with echoes, photographs and truth as far as they have them; repeats: timed rounds, interleaved."""

    bench: BenchFile
    base: Path
    work: Path
    captures: list[Capture]
    seed: int
    repeats: int


def section(name: SectionName, reference: str, words: dict[str, Any], **known: str) -> Section:
    """The section of sections.toml; words: fill in its definition; known: what is not there."""
    about = tomllib.loads(Path(__file__).with_name("sections.toml").read_text("utf-8"))[name]
    about["definition"] = about["definition"].format(**words)
    return Section(name=name, reference=reference, **about, **known)


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
    """The setting's line; one time has no range, and no time is None. Its rank, `answer.rank` fills in."""
    low, high = interval or (None, None)
    times = {"seconds": float(np.median(seconds)) if len(seconds) else None}
    if len(seconds) > 1:
        times |= {"seconds_low": float(min(seconds)), "seconds_high": float(max(seconds))}
    texts = {"section": of.name, "name": name, "title": title, "metric": of.metric, "unit": of.unit}
    knobs_json = json.dumps(knobs, ensure_ascii=False)
    return Setting(**texts, knobs=knobs_json, error=error, low=low, high=high, **{**times, **known})
