"""How the scores of a method become one figure of the main table, with its interval."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from handbench.bench.evaluation.intervals import Interval, median_interval

if TYPE_CHECKING:
    import pandas as pd

    from handbench.bench.evaluation.metrics import Metric

# in scores.csv, for the precision: depth of the strongest scatterer in every repeat, m; and median
# over the pixels of the standard deviation over the repeats, mm
STRONGEST = "strongest_z_m"
PER_PIXEL = "pixel_precision_mm"


@dataclass(frozen=True, eq=False)
class MethodScores:
    """The scores of one method against one reference, with its own settings.
    lines: metric → lines of the table of scores, those without a reference included. captures:
    metric → captures on which any method has it. seed: of bootstrap intervals."""

    lines: dict[str, pd.DataFrame]
    captures: dict[str, np.ndarray]
    seed: int

    def of_captures(self, metric: str) -> np.ndarray:
        """Return a metric of the first frame of each capture [n]; NaN where undefined."""
        lines = self.lines.get(metric)
        return np.empty(0) if lines is None else lines.value[lines.frame == 0].to_numpy()

    def of_frames(self, metric: str) -> list[np.ndarray]:
        """Return a metric of all frames [n], for each capture on which any method has it; [] if the
        method has it on none."""
        lines = self.lines.get(metric)
        if lines is None:
            return []
        return [lines.value[lines.capture == name].to_numpy() for name in self.captures[metric]]


Figure = tuple[float | None, Interval | None] | None  # None: the table has no such line
Combine = Callable[["Metric", MethodScores], Figure]


def mean_of_captures(metric: Metric, scores: MethodScores) -> Figure:
    """Average over the captures that have the metric."""
    values = scores.of_captures(metric.key)
    if not len(values):
        return None
    count = np.isfinite(values).sum()
    return np.nansum(values) / count if count else None, metric.interval(values)


def mean_if_any(metric: Metric, scores: MethodScores) -> Figure:
    """Average over the captures that have the metric; no line if none has."""
    any_has = np.isfinite(scores.of_captures(metric.key)).any()
    return mean_of_captures(metric, scores) if any_has else None


def mean_of_floors(metric: Metric, scores: MethodScores) -> Figure:
    """Average over the captures that observe anything; unknown unless all of these have a floor."""
    observed = scores.of_captures("n_observed") > 0
    floors = scores.of_captures(metric.key)[observed]
    return floors.mean() if len(floors) else None, None


def total(metric: Metric, scores: MethodScores) -> Figure:
    """Add over the captures."""
    return scores.of_captures(metric.key).sum(), None


def pooled_mae(metric: Metric, scores: MethodScores) -> Figure:
    """Average over the pixels of all captures together."""
    count = scores.of_captures("n_observed")
    absolute_mm = np.nansum(scores.of_captures("mae_mm") * count)
    return absolute_mm / count.sum() if count.sum() else None, None


def pooled_max(metric: Metric, scores: MethodScores) -> Figure:
    """Return the largest of all captures."""
    return np.fmax.reduce(scores.of_captures("max_mm"), initial=np.nan), None


def over_frames(of: str, statistic: Callable[[np.ndarray], float]) -> Combine:
    """Return a function that averages over the captures a statistic of the frames of each.
    of: the metric whose frames are meant. No line for a single frame, or if a frame of any capture
    observes nothing."""

    def combine(metric: Metric, scores: MethodScores) -> Figure:
        captures = scores.of_frames(of)
        if not all(len(frames) > 1 and np.isfinite(frames).all() for frames in captures):
            return None
        values = np.array([statistic(frames) for frames in captures])
        return values.mean(), metric.interval(values)

    return combine


def over_repeats(
    statistic: Callable[[Sequence[np.ndarray]], float | None],
    interval: Callable[[Sequence[np.ndarray]], Interval | None] | None = None,
) -> Combine:
    """Return a function that computes a statistic, and its interval, from the depth of the
    strongest scatterer in the repeats of every hand. No line without repeats."""

    def combine(metric: Metric, scores: MethodScores) -> Figure:
        hands = scores.of_frames(STRONGEST)
        return (statistic(hands), interval(hands) if interval else None) if hands else None

    return combine


def median(metric: Metric, scores: MethodScores) -> Figure:
    """Return the median over all frames of all captures, with a bootstrap interval."""
    values = np.concatenate([np.empty(0), *scores.of_frames(metric.key)])
    return np.median(values) if len(values) else None, median_interval(values, scores.seed)
