"""The metrics. Each is one entry: its name, unit, direction and definition, the function that
computes it, the tables that show it, and the figures of the paper. This is the only file that a new
metric needs.

Most metrics are computed from the pixels of one map; how they are combined to a figure of the main
table is in `combine`. A few are made from the scores of others alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import KW_ONLY, dataclass, field
from typing import Any, Literal

import numpy as np

from handbench.bench.evaluation.combine import (
    Combine,
    mean_if_any,
    mean_of_captures,
    mean_of_floors,
    median,
    over_frames,
    over_repeats,
    pooled_mae,
    pooled_max,
    total,
)
from handbench.bench.evaluation.depth_errors import BAND, ErrorMap, Pixels, VelocityErrors
from handbench.bench.evaluation.intervals import (
    Interval,
    deviation,
    mean_interval,
    precision_interval,
    precision_mm,
    relative_precision_percent,
)

Values = dict[str, float | int | None]  # metric → figure in its unit, None if undefined
Better = Literal["lower", "higher", "zero"]
HEADLINE = "mae_mm"  # the metric that titles, pictures and fronts speak of
F_MM = (1, 2, 5)  # thresholds of accuracy, completeness and F-score
NORMAL_MEAN = float(np.sqrt(2 / np.pi))  # mean of |e| over σ, for a normal e
COMMON = "common_percent"  # the only metric that exists under equal treatment alone
TREATMENTS = {"none": "unsmoothed", "window": "all averaged over 5 × 5"}  # equal ones, in words


METRICS: dict[str, Metric] = {}  # in the order of the tables


@dataclass(frozen=True)
class Metric:
    """Definition of one metric, which METRICS lists from then on.
    key: its name in code and files; title: its name for readers. better: whether lower or higher
    values are better ("zero": values nearer to zero). of, of_velocities: function that computes it
    from the pixels or the radial velocities of one map, NaN or infinite if undefined. combine:
    makes the figure of the main table from the scores of a method. shown: the tables that show it
    besides table.csv, separated by blanks: main (beside the paper), summary (a row for each
    method), limits (what limits a result), readme, compare, frames (of every frame), common (on the
    pixels that all methods see), motion. paper: method → the figure that the paper states."""

    key: str
    title: str
    unit: str
    better: Better
    definition: str
    of: Callable[[Pixels], Any] | None = None
    _: KW_ONLY
    of_velocities: Callable[[VelocityErrors], Any] | None = None
    combine: Combine = mean_of_captures
    shown: str = ""
    paper: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        METRICS[self.key] = self

    def interval(self, values: Sequence[float] | np.ndarray) -> Interval | None:
        """Compute the 95 % interval of the metric's mean from its value on each capture [n], cut to
        the values that it can have.
        None for fewer than five captures, and for percentages that are 0 or 100 in every capture,
        which have no spread."""
        interval = mean_interval(values)
        percent = self.unit == "%"
        if interval is None or (percent and set(np.unique(values)) in ({0.0}, {100.0})):
            return None
        least = -np.inf if self.better == "zero" or self.key.startswith("relative") else 0.0
        most = 100.0 if percent else np.inf
        return Interval(max(interval.low, least), min(interval.high, most))


def chosen(place: str) -> list[str]:
    """Return the metrics that a table shows, in their order. place: see `Metric.shown`."""
    return [key for key, metric in METRICS.items() if place in metric.shown.split()]


def figures(errors: ErrorMap, velocities: VelocityErrors | None = None, place: str = "") -> Values:
    """Compute the metrics of one map: metric → figure in its unit, None if undefined.
    velocities: errors of the map's radial velocities; None: it has none. place: compute only the
    metrics shown there."""
    values: dict[str, Any] = {}
    with np.errstate(divide="ignore", invalid="ignore"):
        pixels = Pixels(errors)
        for key in chosen(place) if place else METRICS:
            if of := METRICS[key].of:
                values[key] = of(pixels)
            elif velocities and (of_velocities := METRICS[key].of_velocities):
                values[key] = of_velocities(velocities)
    return {
        key: (value if isinstance(value, int) else float(value)) if np.isfinite(value) else None
        for key, value in values.items()
    }


def on_common_pixels(metric: str) -> str:
    """Return the end of a metric's title under equal treatment: " on common pixels" for a metric of
    the pixels that all methods observe, "" for another."""
    return "" if metric == COMMON else " on common pixels"


def share_right(mm: float, pixels: Callable[[Pixels], np.float64]) -> Callable[[Pixels], Any]:
    """Return a function of one map: the share of its pixels, in percent, that are observed with an
    error of at most `mm` millimetres. pixels: the number that is 100 %."""
    return lambda p: 100 * (p.seen_m <= 1e-3 * mm).sum() / pixels(p)


def mean(values: np.ndarray) -> np.float64:
    """Return the mean of `values` [n]; NaN if there are none."""
    return values.sum() / np.float64(len(values))


def quantile(values: np.ndarray, share: float) -> float:
    """Return a quantile of `values` [n], linear between order statistics; NaN if there are none."""
    return float(np.quantile(values, share)) if len(values) else np.nan


# The paper's figures: J. Bräunig, V. Wirth, M. Stamminger, I. Ullmann, M. Vossiek: the 3-FSK paper.
# Table I (poses B, F and U of the ASL alphabet against photogrammetry; three printed hands × 10
# repeats) and the relative values of its text. The relative accuracy follows from the MAE:
# 100·(1 − 1.7 mm / 0.3 m) = 99.4 %. The relative precisions follow from no one distance: at 0.3 m,
# 3.6 mm would be 98.8 % and 0.3 mm 99.9 %. They are kept as printed.
Metric(
    "mae_mm",
    "MAE",
    "mm",
    "lower",
    "mean of |z − z_ref| over the observed pixels",
    lambda p: 1e3 * p.mean_m,
    shown="main summary readme compare frames common motion",
    paper={"2fsk": 6.6, "3fsk": 1.7, "broadband": 1.0, "narrowband": 13.4},
)
Metric(
    "floor_mm",
    "ground-truth floor",
    "mm",
    "lower",
    "MAE that a perfect radar would show against this reference, because the reference "
    "errs itself: mean of √(2/π)·σ over the observed pixels, σ along z from mesh and "
    "registration together; 0 for a simulator's own surface, none where a part of σ is "
    "unknown",
    lambda p: 1e3 * NORMAL_MEAN * mean(p.sigma_m),
    combine=mean_of_floors,
    shown="main limits readme",
)
Metric(
    "max_mm",
    "MAX of AE",
    "mm",
    "lower",
    "largest |z − z_ref| of the observed pixels",
    lambda p: 1e3 * p.seen_m.max(initial=-np.inf),
    shown="main readme compare frames common",
    paper={"2fsk": 39.2, "3fsk": 28.8, "broadband": 32.0, "narrowband": 64.9},
)
Metric(
    "pooled_mae_mm",
    "pooled MAE",
    "mm",
    "lower",
    "mean of |z − z_ref| over the observed pixels of all captures together",
    combine=pooled_mae,
)
Metric(
    "pooled_max_mm",
    "pooled MAX of AE",
    "mm",
    "lower",
    "largest |z − z_ref| of the observed pixels of all captures together",
    combine=pooled_max,
)
Metric(
    "rmse_mm",
    "RMSE",
    "mm",
    "lower",
    "square root of the mean of (z − z_ref)² over the observed pixels",
    lambda p: 1e3 * np.sqrt(p.mean_square_m2),
)
Metric(
    "median_mm",
    "median of AE",
    "mm",
    "lower",
    "median of |z − z_ref| over the observed pixels",
    lambda p: 1e3 * quantile(p.seen_m, 0.5),
    shown="common",
)
Metric(
    "p95_mm",
    "95th percentile of AE",
    "mm",
    "lower",
    "95th percentile of |z − z_ref| over the observed pixels, linear between order statistics",
    lambda p: 1e3 * quantile(p.seen_m, 0.95),
    shown="common",
)
Metric(
    "bias_mm",
    "bias",
    "mm",
    "zero",
    "mean of z − z_ref over the observed pixels; positive: the map lies behind the reference",
    lambda p: 1e3 * p.error_m.sum() / p.n_observed,
    shown="common",
)
Metric(
    "relative_accuracy_percent",
    "relative accuracy",
    "%",
    "higher",
    "100·(1 − MAE / mean z_ref of the observed pixels), z counted from the aperture's plane",
    lambda p: 100 * (1 - p.absolute_m.sum() / p.depth_m.sum()),
    paper={"3fsk": 99.4},
)
Metric(
    "observed_percent",
    "observed",
    "%",
    "higher",
    "share of the reference's pixels that the map has a depth for, right or wrong",
    lambda p: 100 * p.n_observed / p.n_surface,
    shown="main limits readme",
)
for _mm in F_MM:
    Metric(
        f"complete_{_mm}mm_percent",
        f"completeness at {_mm} mm",
        "%",
        "higher",
        f"share of the reference's pixels that are observed with |z − z_ref| ≤ {_mm} mm: seen and "
        "right",
        share_right(_mm, lambda p: p.n_surface),
        shown="main summary readme compare" if _mm == 2 else "",
    )
Metric(
    "n_observed",
    "observed pixels",
    "pixels",
    "higher",
    "number of observed pixels: map and reference both finite; of all captures together",
    lambda p: int(p.n_observed),
    combine=total,
)
Metric(
    "deviation_mm",
    "deviation of AE",
    "mm",
    "lower",
    "standard deviation (n) of |z − z_ref| over the observed pixels",
    lambda p: 1e3 * np.sqrt(np.maximum(p.mean_square_m2 - p.mean_m**2, 0)),
)
Metric(
    "within_band_percent",
    "errors explained by the ground truth",
    "%",
    "higher",
    "share of the observed pixels with |z − z_ref| ≤ 1.96·σ, σ the reference's own "
    "standard deviation along z; 95 % for a perfect radar; none where σ is unknown at an "
    "observed pixel",
    lambda p: (
        100
        * np.where(np.isnan(p.sigma_m), np.nan, p.seen_m <= BAND * p.sigma_m).sum()
        / p.n_observed
    ),
)
Metric(
    "false_alarm_percent",
    "false alarms",
    "%",
    "lower",
    "share of the map's judged pixels that have no reference surface in them or in their "
    "eight neighbours; judged are pixels with a reference and such ones: not the outline,"
    " what it encloses, or invented surface",
    lambda p: 100 * np.sum(p.judged & ~p.observed) / p.n_judged,
)
Metric(
    "chamfer_to_reference_mm",
    "chamfer, map to reference",
    "mm",
    "lower",
    "mean distance of the map's judged points (false alarms among them) to the nearest "
    "point of the reference, whose points are its depths at the pixel centres",
    lambda p: 1e3 * p.to_reference_m,
)
Metric(
    "chamfer_to_map_mm",
    "chamfer, reference to map",
    "mm",
    "lower",
    "mean distance of the reference's points to the nearest judged point of the map; none"
    " without one",
    lambda p: 1e3 * p.to_map_m,
)
Metric(
    "chamfer_mm",
    "chamfer",
    "mm",
    "lower",
    "mean of the two one-sided chamfer distances",
    lambda p: 1e3 * (p.to_reference_m + p.to_map_m) / 2,
)
for _mm in F_MM:
    Metric(
        f"accurate_{_mm}mm_percent",
        f"accuracy at {_mm} mm",
        "%",
        "higher",
        f"share of the map's judged pixels, false alarms among them, with |z − z_ref| ≤ {_mm} mm",
        share_right(_mm, lambda p: p.n_judged),
    )
for _mm in F_MM:
    Metric(
        f"f_{_mm}mm_percent",
        f"F-score at {_mm} mm",
        "%",
        "higher",
        f"harmonic mean of accuracy and completeness at {_mm} mm",
        share_right(_mm, lambda p: (p.n_surface + p.n_judged) / 2),
    )
Metric(
    "velocity_mae_mm_s",
    "velocity MAE",
    "mm/s",
    "lower",
    "mean of |v − v_ref| over the pixels with a depth, a velocity and a reference, v the "
    "radial velocity; none where map or reference has no velocities",
    of_velocities=lambda v: 1e3 * mean(np.abs(v.error_m_s)),
    combine=mean_if_any,
    shown="main summary frames motion",
)
Metric(
    "velocity_bias_mm_s",
    "velocity bias",
    "mm/s",
    "zero",
    "mean of v − v_ref over the same pixels; positive: the map moves away from the array faster",
    of_velocities=lambda v: 1e3 * mean(v.error_m_s),
    combine=mean_if_any,
    shown="frames",
)
Metric(
    "velocity_within_percent",
    "velocities within their intervals",
    "%",
    "higher",
    "share of the same pixels with |v − v_ref| ≤ 1.96·σ, σ the map's own standard "
    "deviation of v; 95 % where σ is right",
    of_velocities=lambda v: 100 * mean(v.within),
    combine=mean_if_any,
)
Metric(
    "velocity_beyond_percent",
    "beyond the unambiguous velocity",
    "%",
    "lower",
    "share of the same pixels whose |v_ref| exceeds the largest velocity that the map can tell",
    of_velocities=lambda v: 100 * mean(v.beyond),
    combine=mean_if_any,
    shown="main",
)
Metric(
    "frames_mae_mm",
    "MAE, mean over the frames",
    "mm",
    "lower",
    "mean over all frames of the MAE of each; none where one frame was imaged",
    combine=over_frames("mae_mm", np.mean),
)
Metric(
    "frames_mae_deviation_mm",
    "MAE, deviation between frames",
    "mm",
    "lower",
    "standard deviation (n − 1) over the frames of the MAE of each",
    combine=over_frames("mae_mm", deviation),
)
Metric(
    "frames_max_mm",
    "MAX of AE, mean over the frames",
    "mm",
    "lower",
    "mean over all frames of the largest |z − z_ref| of each; none where one frame was imaged",
    combine=over_frames("max_mm", np.mean),
)
Metric(
    "frames_max_deviation_mm",
    "MAX of AE, deviation between frames",
    "mm",
    "lower",
    "standard deviation (n − 1) over the frames of the largest |z − z_ref| of each",
    combine=over_frames("max_mm", deviation),
)
Metric(
    "frames_largest_mm",
    "MAX of AE of all frames",
    "mm",
    "lower",
    "largest |z − z_ref| of the observed pixels of all frames",
    combine=over_frames("max_mm", np.max),
)
Metric(
    "common_percent",
    "common pixels",
    "%",
    "higher",
    "share of the reference's pixels that every method has a depth for, each above its "
    "own threshold",
    shown="main",
)
Metric(
    "precision_mm",
    "precision",
    "mm",
    "lower",
    "standard deviation (n − 1) of the z of the strongest scatterer over the repeats, "
    "averaged over the hands",
    combine=over_repeats(precision_mm, precision_interval),
    shown="main summary readme compare",
    paper={"2fsk": 3.6, "3fsk": 0.3},
)
Metric(
    "pixel_precision_mm",
    "precision per pixel",
    "mm",
    "lower",
    "standard deviation (n − 1) of z over the repeats at each pixel, median over the "
    "pixels that are observed in all repeats",
)
Metric(
    "relative_precision_percent",
    "relative precision",
    "%",
    "higher",
    "100·(1 − precision / mean z of the strongest scatterer); the paper's own values "
    "(98.3 % for 3.6 mm, 99.99 % for 0.3 mm) share no reference distance, so compare the "
    "millimetres",
    combine=over_repeats(relative_precision_percent),
    paper={"2fsk": 98.3, "3fsk": 99.99},
)
Metric(
    "seconds",
    "time per frame",
    "s",
    "lower",
    "median over the frames of the wall-clock time from echoes in memory to the depth map",
    combine=median,
    shown="main summary readme compare",
)
Metric(
    "surface_rms_mm",
    "surface RMS",
    "mm",
    "lower",
    "root mean square distance of a reconstructed surface from the true one, at the points that "
    "rays along z, 0.5 mm apart, meet first; parts that were not reconstructed add no error",
)


def definitions(keys: Iterable[str] = METRICS) -> dict[str, str]:
    """Describe metrics in words: metric → "definition [unit]; lower is better"."""
    described = ((key, METRICS[key]) for key in keys)
    return {key: f"{m.definition} [{m.unit}]; {m.better} is better" for key, m in described}
