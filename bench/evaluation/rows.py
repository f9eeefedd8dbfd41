"""The lines of the table: each figure with its interval, its unit and the paper's figure."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from handbench.bench.evaluation import scoring_protocols
from handbench.bench.evaluation.floor import floor_interval, floor_mm
from handbench.bench.evaluation.metrics import AVERAGED, METRICS, Values, averaged, of_captures, precision
from handbench.bench.evaluation.scoring_protocols import Protocol
from handbench.bench.evaluation.statistics.intervals import (
    Interval,
    figure_interval,
    median_interval,
    precision_interval,
)
from handbench.bench.results.about import MetricFacts
from handbench.bench.results.error_map import ErrorMap
from handbench.bench.results.tables import TABLE, frame
from handbench.groundtruth.mesh.depth import Reference

Intervals = dict[str, Interval | None]


def accuracy_rows(
    method: str,
    reference: str,
    maps: Sequence[ErrorMap],
    seed: int = 0,
    surfaces: Sequence[Reference] | None = None,
    protocol: Protocol = scoring_protocols.PAPER,
    captures: pd.DataFrame | None = None,
) -> pd.DataFrame:
    """The protocol's metrics of a method's error maps, one a capture, against one reference, and the floor that the
    `surfaces` with which they were compared, one a map, set to the mean absolute error (None: their uncertainty is not
    known). seed: the floor's draws; captures: `of_captures` of the maps with their `floor_mm`, where it is at hand."""
    floor = None
    if captures is not None:
        mean_mm = captures.floor_mm[captures.n_observed > 0].mean(skipna=False)
        floor = float(mean_mm) if np.isfinite(mean_mm) else None
    elif surfaces is not None:
        floor = floor_mm(maps, surfaces)
    captures = of_captures(maps) if captures is None else captures
    intervals: Intervals = {key: figure_interval(key, captures[key].to_numpy()) for key in AVERAGED}
    values = averaged(captures) | {"floor_mm": floor}
    if surfaces is not None and floor:
        intervals["floor_mm"] = floor_interval(maps, surfaces, seed, value=floor)
    return _rows(method, reference, {key: values[key] for key in values if key in protocol.metrics}, intervals)


def frame_rows(
    method: str, reference: str, captures: Sequence[Values], protocol: Protocol = scoring_protocols.PAPER
) -> pd.DataFrame:
    """The protocol's figures over all frames, from each capture's `over_frames`; none unless all captures have them."""
    shared = set.intersection(*map(set, captures)) if captures else set()
    found = {key: np.array([figures[key] for figures in captures], float) for key in shared & set(protocol.metrics)}
    values: Values = {key: float(of.mean()) for key, of in found.items()}
    return _rows(method, reference, values, {key: figure_interval(key, of) for key, of in found.items()})


def precision_rows(
    method: str, reference: str, strongest_z_m: Sequence[np.ndarray], deviations: Sequence[ErrorMap] | None = None
) -> pd.DataFrame:
    """The precision from each hand's strongest depths [n_repeats] and, where told, per pixel from each hand's
    `deviation_map`; needs no reference, is listed with each."""
    values = precision(strongest_z_m)
    intervals: Intervals = {"precision_mm": precision_interval(strongest_z_m)}
    if deviations is not None:
        captures = of_captures(deviations)
        values["pixel_precision_mm"] = averaged(captures)["median_mm"]
        intervals["pixel_precision_mm"] = figure_interval("pixel_precision_mm", captures.median_mm.to_numpy())
    return _rows(method, reference, values, intervals)


def time_rows(method: str, reference: str, seconds: Sequence[float], seed: int = 0) -> pd.DataFrame:
    """The time per frame from each frame's imaging time; listed with each reference as well."""
    frames_s = np.asarray(seconds, dtype=np.float64)
    value = float(np.median(frames_s)) if len(frames_s) else None
    return _rows(method, reference, {"seconds": value}, {"seconds": median_interval(frames_s, seed)})


def metric_facts() -> dict[str, MetricFacts]:
    """The definitions that travel with a result."""
    return {key: MetricFacts.model_validate(metric, from_attributes=True) for key, metric in METRICS.items()}


def _rows(method: str, reference: str, values: Values, intervals: Intervals) -> pd.DataFrame:
    """The figures that are among the registry's, in its order."""
    rows = []
    for key in (key for key in METRICS if key in values):
        low, high = intervals.get(key) or (None, None)
        paper = METRICS[key].paper.get(method)
        rows.append((key, method, values[key], low, high, METRICS[key].unit, paper, reference))
    return frame(TABLE, rows)
