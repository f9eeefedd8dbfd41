"""One setting of a section as a line of tradeoff.csv."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from bench.evaluation.statistics.intervals import Interval
from bench.results import Section, Setting


def line(
    section: Section,
    name: str,
    title: str,
    knobs: dict[str, Any],
    error: float | None = None,
    interval: Interval | None = None,
    seconds: Sequence[float] = (),
    acquisition_s: float | None = None,
    peak_memory_mb: float | None = None,
    seen_percent: float | None = None,
) -> Setting:
    """The setting's line; one time has no range, and no time is None. Its rank, `pareto.rank` fills in."""
    ranged = len(seconds) > 1
    return Setting(
        section=section.name,
        name=name,
        title=title,
        knobs=json.dumps(knobs, ensure_ascii=False),
        metric=section.metric,
        error=error,
        low=None if interval is None else interval.low,
        high=None if interval is None else interval.high,
        unit=section.unit,
        seconds=float(np.median(seconds)) if len(seconds) else None,
        seconds_low=float(min(seconds)) if ranged else None,
        seconds_high=float(max(seconds)) if ranged else None,
        ratio=None,
        acquisition_s=acquisition_s,
        plan_s=None,
        imaging_s=None,
        extraction_s=None,
        operations=None,
        peak_memory_mb=peak_memory_mb,
        on_front=False,
        dominated_by="",
        seen_percent=seen_percent,
    )
