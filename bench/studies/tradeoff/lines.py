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
    **known: float | None,
) -> Setting:
    """The setting's line; one time has no range, and no time is None. Its rank, `pareto.rank` fills in."""
    low, high = interval or (None, None)
    times = {"seconds": float(np.median(seconds)) if len(seconds) else None}
    if len(seconds) > 1:
        times |= {"seconds_low": float(min(seconds)), "seconds_high": float(max(seconds))}
    texts = {"section": section.name, "name": name, "title": title, "metric": section.metric, "unit": section.unit}
    knobs_json = json.dumps(knobs, ensure_ascii=False)
    return Setting(**texts, knobs=knobs_json, error=error, low=low, high=high, **{**times, **known})
