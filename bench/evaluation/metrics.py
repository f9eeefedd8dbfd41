"""The metrics: unit, direction and definition of each, and the functions that compute them from
error maps."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from handbench.bench.evaluation.depth_errors import ErrorMap as ErrorMap
from handbench.bench.evaluation.intervals import Interval, mean_interval
from handbench.bench.evaluation.repeats import deviation

if TYPE_CHECKING:
    import pandas as pd

Values = dict[str, float | int | None]
Terms = dict[str, Any]  # arrays of one shape, or numbers
HEADLINE = "mae_mm"  # the metric that titles, pictures and fronts speak of
# of the radial velocity: mean error, bias, and the shares of the pixels that are within the map's
# own interval and beyond its unambiguous velocity
VELOCITY = VELOCITY_MAE, VELOCITY_BIAS, VELOCITY_WITHIN, VELOCITY_BEYOND = (
    "velocity_mae_mm_s",
    "velocity_bias_mm_s",
    "velocity_within_percent",
    "velocity_beyond_percent",
)
OVER_FRAMES = ("mae_mm", "max_mm")  # how these vary over the frames is in the table
F_MM = (1, 2, 5)  # thresholds of accuracy, completeness and F-score
BAND = 1.96  # standard deviations that contain 95 % of a normal error


@dataclass(frozen=True)
class Metric:
    """Definition of one metric.
    key: its name in code and files; title: its name for readers. better: whether lower or higher
    values are better ("zero": values nearer to zero). paper: method → the value that the paper
    states."""

    key: str
    title: str
    unit: str
    better: Literal["lower", "higher", "zero"]
    definition: str
    paper: dict[str, float] = field(default_factory=dict)


# in the order of the tables
_KNOWN = tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8"))
METRICS = {key: Metric(key, **facts) for key, facts in _KNOWN.items()}
# of methods, by id
TITLES: dict[str, str] = tomllib.loads(Path(__file__).with_name("titles.toml").read_text("utf-8"))
# and its figures
PAPER = {(m.key, method): value for m in METRICS.values() for method, value in m.paper.items()}


def _measured_pixels(m: ErrorMap) -> ErrorMap:
    """Return an error map with only the pixels that have an error, a reference or a distance, all
    in one row [n].
    The other pixels add nothing to any metric."""
    known = (m.reference_z_m, m.error_m, m.to_reference_m)
    at = np.logical_or.reduce([~np.isnan(values) for values in known if values is not None])
    others = (
        None if values is None else values[at]
        for values in (m.sigma_m, m.to_reference_m, m.to_map_m)
    )
    return ErrorMap(m.x_m, m.y_m, m.error_m[at], m.reference_z_m[at], *others)


def terms(m: ErrorMap) -> Terms:
    """Compute what each pixel adds to the sums from which the metrics are computed: name of the sum
    → [ny, nx].
    Examples are the number of observed pixels, |error|, error² and distances. NaN where the needed
    quantity (σ or a distance) is unknown. The function `figures` turns the sums into metrics."""
    surface, observed = np.isfinite(m.reference_z_m), np.isfinite(m.error_m)
    unknown = np.full(m.error_m.shape, np.nan)
    sigma_m, to_reference_m, to_map_m = (
        unknown if known is None else known for known in (m.sigma_m, m.to_reference_m, m.to_map_m)
    )
    judged = np.isfinite(to_reference_m) | np.isinf(to_reference_m)
    or_nan = 0.0 if m.to_reference_m is not None else np.nan
    error_m = np.where(observed, m.error_m, 0.0)
    within = np.where(np.isnan(sigma_m), np.nan, np.abs(error_m) <= BAND * sigma_m)
    return {
        "surface": surface.astype(float),
        "observed": observed.astype(float),
        "depth_m": np.where(observed, m.reference_z_m, 0.0),
        "error_m": error_m,
        "absolute_m": np.abs(error_m),
        "square_m2": error_m**2,
        "within": np.where(observed, within, 0.0),
        "judged": judged + or_nan,
        "alarm": (judged & ~observed) + or_nan,
        "to_reference_m": np.where(judged, to_reference_m, 0.0) + or_nan,
        "to_map_m": np.where(surface, to_map_m, 0.0),
        **{f"right_{mm}": (observed & (np.abs(error_m) <= 1e-3 * mm)).astype(float) for mm in F_MM},
    }


def figures(t: Terms) -> Terms:
    """Compute the metrics from sums over pixels: metric → value, in the metric's unit.
    t: name → sum over pixels of the array of that name from `terms`. The sums may be numbers, or
    arrays of one shape for elementwise results. NaN or infinite where a metric is undefined."""
    # without one there is nothing to be found
    surface = np.where(t["surface"] > 0, t["surface"], np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        mae_m, mean_square_m2 = t["absolute_m"] / t["observed"], t["square_m2"] / t["observed"]
        to_reference_m, to_map_m = t["to_reference_m"] / t["judged"], t["to_map_m"] / t["surface"]
        return {
            "mae_mm": 1e3 * mae_m,
            "rmse_mm": 1e3 * np.sqrt(mean_square_m2),
            "bias_mm": 1e3 * t["error_m"] / t["observed"],
            "relative_accuracy_percent": 100 * (1 - t["absolute_m"] / t["depth_m"]),
            "observed_percent": 100 * t["observed"] / t["surface"],
            "deviation_mm": 1e3 * np.sqrt(np.maximum(mean_square_m2 - mae_m**2, 0)),
            "within_band_percent": 100 * t["within"] / t["observed"],
            "false_alarm_percent": 100 * t["alarm"] / t["judged"],
            "chamfer_to_reference_mm": 1e3 * to_reference_m,
            "chamfer_to_map_mm": 1e3 * to_map_m,
            "chamfer_mm": 1e3 * (to_reference_m + to_map_m) / 2,
            **{f"complete_{mm}mm_percent": 100 * t[f"right_{mm}"] / t["surface"] for mm in F_MM},
            **{f"accurate_{mm}mm_percent": 100 * t[f"right_{mm}"] / t["judged"] for mm in F_MM},
            **{
                f"f_{mm}mm_percent": 200 * t[f"right_{mm}"] / (surface + t["judged"]) for mm in F_MM
            },
        }


def pool(maps: Sequence[ErrorMap]) -> Values:
    """Compute the metrics over the pixels of all `maps` together: metric → value, None if
    undefined.
    Each pixel has the same weight, whichever map it is from."""
    totals, observed = dict.fromkeys(TERMS, np.float64(0)), [np.empty(0)]
    for m in map(_measured_pixels, maps):
        totals = {name: totals[name] + values.sum() for name, values in terms(m).items()}
        observed.append(np.abs(m.error_m[np.isfinite(m.error_m)]))
    absolute_m = np.concatenate(observed)
    values = {
        key: float(value) if np.isfinite(value) else None for key, value in figures(totals).items()
    }
    ordered = dict.fromkeys(ORDERED)
    if len(absolute_m):
        median_m, p95_m = np.quantile(absolute_m, tuple(QUANTILES.values()))
        ordered = dict(
            zip(ORDERED, (1e3 * float(v) for v in (absolute_m.max(), median_m, p95_m)), strict=True)
        )
    found = values | ordered | {"n_observed": len(absolute_m)}
    return {key: found[key] for key in METRICS if key in found}


def over_frames(mae_mm: np.ndarray, max_mm: np.ndarray) -> Values:
    """Compute how the error of a capture varies over its frames: mean and standard deviation of
    both given errors, and the largest error of all frames: metric → value.
    mae_mm, max_mm [n]: mean and largest absolute error of each frame. Empty for a single frame, or
    if a frame observes nothing."""
    if len(mae_mm) < 2 or not np.isfinite([mae_mm, max_mm]).all():
        return {}
    found: Values = {"frames_largest_mm": float(np.max(max_mm))}
    for name, values in (("mae", mae_mm), ("max", max_mm)):
        found |= {
            f"frames_{name}_mm": float(np.mean(values)),
            f"frames_{name}_deviation_mm": deviation(values),
        }
    return found


def figure_interval(metric: str, values: Sequence[float] | np.ndarray) -> Interval | None:
    """Compute the 95 % interval of a metric's mean, from its value on each capture [n], cut to the
    values that the metric can have.
    Returns None for fewer than five captures (FEWEST), and for percentages that are 0 or 100 in
    every capture, which have no spread."""
    found, facts = mean_interval(values), METRICS[metric]
    if found is None or (facts.unit == "%" and set(np.unique(values)) in ({0.0}, {100.0})):
        return None
    most = 100.0 if facts.unit == "%" else np.inf
    least = -np.inf if facts.better == "zero" or metric.startswith("relative") else 0.0
    return Interval(max(found.low, least), min(found.high, most))


def of_captures(maps: Iterable[ErrorMap]) -> pd.DataFrame:
    """Compute the metrics of each capture's error map. Returns a DataFrame with one line for each
    map and one column for each metric; NaN if undefined."""
    import pandas as pd

    return pd.DataFrame([pool([m]) for m in maps], columns=list(pool([])), dtype=float)


def mean_figures(captures: pd.DataFrame) -> Values:
    """Average the metrics over captures, as in the paper's table: metric → mean, None if undefined.
    captures: one line for each capture, one column for each metric. A metric is averaged over the
    captures that have it. The `pooled_…` metrics and the number of pixels are those of all
    captures' pixels together. The mean of the column `floor_mm`, if present, is None unless every
    capture that observes anything has a floor."""
    pixels = captures.n_observed.sum()
    values = {key: captures[key].mean() for key in captures.columns} | {
        "n_observed": pixels,
        "pooled_mae_mm": (captures.mae_mm * captures.n_observed).sum() / pixels
        if pixels
        else np.nan,
        "pooled_max_mm": captures.max_mm.max(),
    }
    if "floor_mm" in captures:
        values["floor_mm"] = captures.floor_mm[captures.n_observed > 0].mean(skipna=False)
    found: Values = {
        key: float(value) if np.isfinite(value) else None for key, value in values.items()
    }
    return {key: found[key] for key in METRICS if key in found}


QUANTILES = {"median_mm": 0.5, "p95_mm": 0.95}
ORDERED = ("max_mm", *QUANTILES)  # what is no ratio of sums
TERMS = tuple(terms(ErrorMap(np.empty(0), np.empty(0), np.empty((0, 0)), np.empty((0, 0)))))
AVERAGED = tuple(key for key in pool([]) if key != "n_observed")  # over the captures


def definitions(keys: Sequence[str] = tuple(METRICS)) -> dict[str, str]:
    """Describe metrics in the words that results and metric files record: metric → "definition
    [unit]; lower is better"."""
    return {
        k: f"{m.definition} [{m.unit}]; {m.better} is better" for k in keys if (m := METRICS.get(k))
    }
