"""The lines of the table: each figure with its interval, its unit and the paper's figure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bench.evaluation.floor import floor_interval, floor_mm
from bench.evaluation.metrics import METRICS, Values, pool, precision
from bench.evaluation.paper import PAPER
from bench.evaluation.scoring_protocols import PAPER as PAPER_PROTOCOL
from bench.evaluation.scoring_protocols import Protocol
from bench.evaluation.statistics.intervals import Interval, median_interval, pooled_intervals, precision_interval
from bench.results import MetricFacts, Row
from bench.results.error_map import ErrorMap
from groundtruth.mesh.depth import Reference


def accuracy_rows(
    method: str,
    reference: str,
    maps: Sequence[ErrorMap],
    seed: int = 0,
    surfaces: Sequence[Reference] | None = None,
    protocol: Protocol = PAPER_PROTOCOL,
) -> list[Row]:
    """The protocol's pooled metrics of a method's error maps against one reference, and the floor that the `surfaces`
    with which they were compared, one a map, set to the MAE (None: their uncertainty is not known). seed: the floor's
    draws."""
    values = pool(maps)
    intervals = pooled_intervals(maps, estimate=values)
    values["floor_mm"] = None
    if surfaces is not None:
        values["floor_mm"] = floor_mm(maps, surfaces)
        spread = floor_interval(maps, surfaces, seed, value=values["floor_mm"]) if values["floor_mm"] else None
        intervals |= {} if spread is None else {"floor_mm": spread}
    return _rows(method, reference, {key: values[key] for key in values if key in protocol.metrics}, intervals)


def precision_rows(
    method: str, reference: str, strongest_z_m: Sequence[np.ndarray], deviations: Sequence[ErrorMap] | None = None
) -> list[Row]:
    """The precision from each hand's strongest depths [n_repeats] and, where told, per pixel from each hand's
    `deviation_map`; needs no reference, is listed with each."""
    values = precision(strongest_z_m)
    interval = precision_interval(strongest_z_m)
    intervals = {} if interval is None else {"precision_mm": interval}
    if deviations is not None:
        values["pixel_precision_mm"] = pool(deviations)["median_mm"]
        spread = pooled_intervals(deviations).get("median_mm")
        intervals |= {} if spread is None else {"pixel_precision_mm": spread}
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
    for key in sorted(values, key=list(METRICS).index):
        low, high = intervals.get(key, (None, None))
        paper = PAPER.get((key, method))
        rows.append(Row(key, method, values[key], low, high, METRICS[key].unit, paper, reference))
    return rows
