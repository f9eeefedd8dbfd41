"""The main table of a result, a function of its scores: each figure with its interval, its unit and
the value of the paper."""

import numpy as np
import pandas as pd

from handbench.bench.evaluation.intervals import Interval, median_interval, precision_interval
from handbench.bench.evaluation.metrics import (
    AVERAGED,
    METRICS,
    OVER_FRAMES,
    VELOCITY,
    Values,
    figure_interval,
    mean_figures,
    over_frames,
)
from handbench.bench.evaluation.repeats import precision_mm, relative_precision_percent
from handbench.bench.evaluation.scoring_protocols import REFERENCES, Protocol
from handbench.bench.evaluation.tables import TABLE, by_method, frame

# of scores.csv, for the precision: depth of the strongest scatterer in every repeat, m; and median
# over the pixels of the standard deviation over the repeats, mm
STRONGEST, PER_PIXEL = "strongest_z_m", "pixel_precision_mm"
Figures = dict[str, tuple[float | int | None, Interval | None]]  # metric → value, interval


def main_table(
    scores: pd.DataFrame, protocol: Protocol, seed: int, with_paper: bool
) -> pd.DataFrame:
    """Compute the main table (TABLE) from the table of scores (SCORES): the figures of each method,
    for one reference after the other.
    scores: only the captures and methods of the table, in their order. protocol: which metrics are
    shown. seed: of the bootstrap. with_paper: False leaves the column `paper` empty."""
    rows: list[tuple[object, ...]] = []
    hands = scores[scores.metric == STRONGEST].capture.unique()
    of_method = dict(iter(scores.groupby("method", sort=False)))
    for reference in REFERENCES:
        for method, captures in by_method(scores, reference).items():
            own = of_method[method]
            figures = (
                _accuracy(captures)
                | _over_frames(own[(own.reference == reference) & (own.treatment == "")])
                | _precision(own, hands)
                | {"seconds": _time(own, seed)}
            )
            for metric in (m for m in METRICS.values() if m.key in protocol.metrics):
                if metric.key in figures:
                    value, interval = figures[metric.key]
                    paper = metric.paper.get(method) if with_paper else None
                    ends = interval or (None, None)
                    rows.append((metric.key, method, value, *ends, metric.unit, paper, reference))
    return frame(TABLE, rows)


def _accuracy(captures: pd.DataFrame) -> Figures:
    """Average the metrics of one method over captures. captures: one line for each capture, one
    column for each metric."""
    values: Values = {"floor_mm": None} | mean_figures(captures)
    return {
        key: (
            value,
            figure_interval(key, captures[key].to_numpy())
            if key in (*AVERAGED, *VELOCITY)
            else None,
        )
        for key, value in values.items()
        if key not in VELOCITY or value is not None  # a method without velocities has no such lines
    }


def _over_frames(scores: pd.DataFrame) -> Figures:
    """Average over the captures how the error of one method varies over the frames. A metric that
    any capture lacks is left out. scores: those of the method against one reference."""
    mae_mm, max_mm = (
        [mm.to_numpy() for _, mm in of.groupby("capture", sort=False).value]
        for of in (scores[scores.metric == metric] for metric in OVER_FRAMES)
    )
    captures = pd.DataFrame([over_frames(*both) for both in zip(mae_mm, max_mm, strict=True)])
    each = {key: of.to_numpy(float) for key, of in captures.items() if of.notna().all()}
    return {str(key): (float(of.mean()), figure_interval(str(key), of)) for key, of in each.items()}


def _precision(scores: pd.DataFrame, hands: np.ndarray) -> Figures:
    """Compute the precision of one method, and its precision per pixel; {} if it was not measured.
    hands: names of the captures that measure the precision."""
    strongest, pixels = (scores[scores.metric == name] for name in (STRONGEST, PER_PIXEL))
    figures: Figures = {}
    if len(strongest):
        z_m = [strongest.value[strongest.capture == hand].to_numpy() for hand in hands]
        figures["precision_mm"] = precision_mm(z_m), precision_interval(z_m)
        figures["relative_precision_percent"] = relative_precision_percent(z_m), None
    if len(pixels):
        mm = pixels.value
        value = mm.mean() if mm.notna().any() else None
        figures[PER_PIXEL] = value, figure_interval(PER_PIXEL, mm.to_numpy())
    return figures


def _time(scores: pd.DataFrame, seed: int) -> tuple[float | None, Interval | None]:
    """Compute the median time per image of one method, with a bootstrap interval."""
    seconds = scores.value[scores.metric == "seconds"].to_numpy()
    return float(np.median(seconds)) if len(seconds) else None, median_interval(seconds, seed)
