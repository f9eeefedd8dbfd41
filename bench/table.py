"""The lines of the table: each figure with its interval, its unit and the paper's figure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bench.metrics import METRICS, ErrorMap, Values, pool, precision
from bench.paper import PAPER
from bench.results import MetricFacts, Row
from bench.statistics import Interval, median_interval, pooled_intervals, precision_interval


def accuracy_rows(method: str, reference: str, maps: Sequence[ErrorMap], seed: int = 0) -> list[Row]:
    """The pooled metrics of a method's error maps against one reference."""
    return _rows(method, reference, pool(maps), pooled_intervals(maps, seed))


def precision_rows(method: str, reference: str, strongest_z_m: Sequence[np.ndarray]) -> list[Row]:
    """The precision from each hand's strongest depths [n_repeats]; needs no reference, is listed with each."""
    values = precision(strongest_z_m)
    interval = precision_interval(strongest_z_m)
    intervals = {} if interval is None else {"precision_mm": interval}
    return _rows(method, reference, values, intervals)


def time_rows(method: str, reference: str, seconds: Sequence[float], seed: int = 0) -> list[Row]:
    """The time per frame from each frame's imaging time; listed with each reference as well."""
    seconds = np.asarray(seconds, dtype=np.float64)
    interval = median_interval(seconds, seed)
    value = float(np.median(seconds)) if len(seconds) else None
    return _rows(method, reference, {"seconds": value}, {} if interval is None else {"seconds": interval})


def metric_facts() -> dict[str, MetricFacts]:
    """The definitions that travel with a result."""
    return {
        key: MetricFacts(title=m.title, unit=m.unit, better=m.better, definition=m.definition)
        for key, m in METRICS.items()
    }


def _rows(method: str, reference: str, values: Values, intervals: dict[str, Interval]) -> list[Row]:
    rows = []
    for key, value in values.items():
        low, high = intervals.get(key, (None, None))
        paper = PAPER.get((key, method))
        rows.append(Row(key, method, value, low, high, METRICS[key].unit, paper, reference))
    return rows
