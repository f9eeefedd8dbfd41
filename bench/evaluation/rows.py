"""Functions that make the lines of a result's main table: each figure with its interval, its unit
and the value of the paper."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from handbench.bench.evaluation.intervals import (
    Interval,
    figure_interval,
    median_interval,
    precision_interval,
)
from handbench.bench.evaluation.metrics import (
    AVERAGED,
    METRICS,
    VELOCITY,
    Values,
    mean_figures,
    precision,
)
from handbench.bench.evaluation.scoring_protocols import PAPER, Protocol
from handbench.bench.evaluation.tables import TABLE, frame

Intervals = dict[str, Interval | None]


def accuracy_rows(
    method: str, reference: str, captures: pd.DataFrame, protocol: Protocol = PAPER
) -> pd.DataFrame:
    """Make the lines of the main table with the accuracy of one method against one reference.
    captures: one line for each capture, one column for each metric, and a column `floor_mm` if the
    ground-truth floor is known. protocol: which metrics are shown."""
    velocity = [key for key in VELOCITY if key in captures and captures[key].notna().any()]
    intervals: Intervals = {
        key: figure_interval(key, captures[key].to_numpy()) for key in (*AVERAGED, *velocity)
    }
    values = {"floor_mm": None} | mean_figures(captures)
    without = set(VELOCITY) - set(velocity)  # a method without velocities has no such lines
    known = {k: value for k, value in values.items() if k in set(protocol.metrics) - without}
    return _rows(method, reference, known, intervals)


def frame_rows(
    method: str, reference: str, captures: Sequence[Values], protocol: Protocol = PAPER
) -> pd.DataFrame:
    """Make the lines of the main table with the figures over all frames, averaged over the
    captures.
    captures: for each capture, how its error varies over the frames: metric → value. A metric that
    any capture lacks is left out."""
    shared = set.intersection(*map(set, captures)) if captures else set()
    found = {
        key: np.array([figures[key] for figures in captures], float)
        for key in shared & set(protocol.metrics)
    }
    values: Values = {key: float(of.mean()) for key, of in found.items()}
    return _rows(
        method, reference, values, {key: figure_interval(key, of) for key, of in found.items()}
    )


def precision_rows(
    method: str,
    reference: str,
    strongest_z_m: Sequence[np.ndarray],
    pixels_mm: Sequence[float] = (),
) -> pd.DataFrame:
    """Make the lines of the main table with the precision of a method, and its precision per pixel
    if known.
    strongest_z_m: for each hand, the depth of its strongest scatterer in every repeat [n_repeats],
    metres. pixels_mm: for each hand, the median over the pixels of their standard deviation, mm.
    The precision does not depend on `reference`, which is only written into the lines."""
    values, key = precision(strongest_z_m), "pixel_precision_mm"
    intervals: Intervals = {"precision_mm": precision_interval(strongest_z_m)}
    if len(pixels_mm):
        known = pd.Series(pixels_mm, dtype=float)
        values[key], intervals[key] = (
            known.mean() if known.notna().any() else None,
            figure_interval(key, known.to_numpy()),
        )
    return _rows(method, reference, values, intervals)


def time_rows(
    method: str, reference: str, seconds: Sequence[float] | np.ndarray, seed: int = 0
) -> pd.DataFrame:
    """Make the line of the main table with the time per frame: the median of `seconds`, with a
    bootstrap interval.
    The time does not depend on `reference`, which is only written into the line."""
    frames_s = np.asarray(seconds, dtype=np.float64)
    value = float(np.median(frames_s)) if len(frames_s) else None
    return _rows(
        method, reference, {"seconds": value}, {"seconds": median_interval(frames_s, seed)}
    )


def _rows(method: str, reference: str, values: Values, intervals: Intervals) -> pd.DataFrame:
    """Make a line of the main table for each of `values` (metric → figure) that is a known metric,
    in the order of METRICS."""
    rows = []
    for key in (key for key in METRICS if key in values):
        low, high = intervals.get(key) or (None, None)
        paper = METRICS[key].paper.get(method)
        rows.append((key, method, values[key], low, high, METRICS[key].unit, paper, reference))
    return frame(TABLE, rows)
