"""What is measured: each metric's unit, direction and definition, and its value for a depth map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from radar.errors import HandbenchError

Values = dict[str, float | int | None]


@dataclass(frozen=True)
class Metric:
    """One figure of merit. better: the direction in which a method improves ("zero": nearer to zero)."""

    key: str
    title: str
    unit: str
    better: Literal["lower", "higher", "zero"]
    definition: str


METRICS = {metric.key: metric for metric in (
    Metric("mae_mm", "MAE", "mm", "lower", "mean of |z − z_ref| over the observed pixels"),
    Metric("floor_mm", "ground-truth floor", "mm", "lower",
           "MAE that a perfect radar would show against this reference, because the reference errs itself: mean of "
           "√(2/π)·σ over the observed pixels, σ along z from mesh and registration together; 0 for a simulator's own "
           "surface, none where a part of σ is unknown; its interval: 95 % of what such a radar would show, the "
           "registration's error common to all pixels, the mesh's to blocks of 15 mm"),
    Metric("max_mm", "MAX of AE", "mm", "lower",
           "largest |z − z_ref| of the observed pixels; its interval ends at the largest error that was seen"),
    Metric("rmse_mm", "RMSE", "mm", "lower",
           "square root of the mean of (z − z_ref)² over the observed pixels"),
    Metric("median_mm", "median of AE", "mm", "lower", "median of |z − z_ref| over the observed pixels"),
    Metric("p95_mm", "95th percentile of AE", "mm", "lower",
           "95th percentile of |z − z_ref| over the observed pixels, linear between order statistics"),
    Metric("bias_mm", "bias", "mm", "zero",
           "mean of z − z_ref over the observed pixels; positive: the map lies behind the reference"),
    Metric("relative_accuracy_percent", "relative accuracy", "%", "higher",
           "100·(1 − MAE / mean z_ref of the observed pixels), z counted from the aperture's plane"),
    Metric("completeness_percent", "completeness", "%", "higher",
           "share of the reference's pixels that are observed"),
    Metric("n_observed", "observed pixels", "pixels", "higher",
           "number of observed pixels: map and reference both finite; pooled over the captures"),
    Metric("precision_mm", "precision", "mm", "lower",
           "standard deviation (n − 1) of the z of the strongest scatterer over the repeats, "
           "averaged over the hands"),
    Metric("relative_precision_percent", "relative precision", "%", "higher",
           "100·(1 − precision / mean z of the strongest scatterer); the paper's own values (98.3 % for 3.6 mm, "
           "99.99 % for 0.3 mm) share no reference distance, so compare the millimetres"),
    Metric("seconds", "time per frame", "s", "lower",
           "median over the frames of the wall-clock time from echoes in memory to the depth map"),
)}


@dataclass(frozen=True)
class ErrorMap:
    """Signed errors of one depth map on the pixel centres x_m [nx], y_m [ny].

    error_m [ny, nx] = z − z_ref, NaN where unobserved; reference_z_m [ny, nx], NaN where there is no surface.
    """

    x_m: np.ndarray
    y_m: np.ndarray
    error_m: np.ndarray
    reference_z_m: np.ndarray


def error_map(x_m: np.ndarray, y_m: np.ndarray, z_m: np.ndarray, reference_z_m: np.ndarray) -> ErrorMap:
    """Compare depths z_m with reference_z_m, both [ny, nx] on pixel centres x_m [nx], y_m [ny], metres."""
    if not z_m.shape == reference_z_m.shape == (len(y_m), len(x_m)):
        raise HandbenchError(
            f"depth map {z_m.shape} and reference {reference_z_m.shape} do not lie on one grid "
            f"[ny, nx] = {(len(y_m), len(x_m))}; render the reference on the depth map's grid"
        )
    reference_z_m = np.where(np.isfinite(reference_z_m), reference_z_m, np.nan).astype(np.float64)
    error_m = np.where(np.isfinite(z_m), z_m, np.nan) - reference_z_m
    return ErrorMap(np.asarray(x_m, np.float64), np.asarray(y_m, np.float64), error_m, reference_z_m)


def score(z_m: np.ndarray, reference_z_m: np.ndarray) -> Values:
    """Metrics of one depth map against a reference of its shape, metres; NaN: not observed, no surface."""
    ny, nx = z_m.shape
    return pool([error_map(np.arange(nx), np.arange(ny), z_m, reference_z_m)])


def pool(maps: Sequence[ErrorMap]) -> Values:
    """Metrics over the pixels of all `maps` together (a mean over pixels, never a mean of means).

    A figure that has nothing to stand on is None.
    """
    error_m = np.concatenate([m.error_m.ravel() for m in maps]) if maps else np.empty(0)
    reference_z_m = np.concatenate([m.reference_z_m.ravel() for m in maps]) if maps else np.empty(0)
    observed = np.isfinite(error_m)
    n_reference = int(np.isfinite(reference_z_m).sum())
    n_observed = int(observed.sum())
    completeness = 100 * n_observed / n_reference if n_reference else None
    accuracy = dict.fromkeys(ACCURACY)
    if n_observed:
        accuracy = _accuracy(error_m[observed], reference_z_m[observed])
    return accuracy | {"completeness_percent": completeness, "n_observed": n_observed}


ACCURACY = ("mae_mm", "max_mm", "rmse_mm", "median_mm", "p95_mm", "bias_mm", "relative_accuracy_percent")


def _accuracy(error_m: np.ndarray, reference_z_m: np.ndarray) -> Values:
    absolute_m = np.abs(error_m)
    values = {
        "mae_mm": 1e3 * absolute_m.mean(),
        "max_mm": 1e3 * absolute_m.max(),
        "rmse_mm": 1e3 * np.sqrt((error_m**2).mean()),
        "median_mm": 1e3 * np.median(absolute_m),
        "p95_mm": 1e3 * np.quantile(absolute_m, 0.95),
        "bias_mm": 1e3 * error_m.mean(),
        "relative_accuracy_percent": 100 * (1 - absolute_m.mean() / reference_z_m.mean()),
    }
    return {key: float(value) for key, value in values.items()}


def strongest_scatterer_z_m(z_m: np.ndarray, amplitude: np.ndarray) -> np.ndarray:
    """Depth of the strongest scatterer in each repeat [n], from depths and linear amplitudes [n, ny, nx].

    The scatterer is one and the same in all repeats: the pixel with the largest mean amplitude of those observed in
    every repeat. (The strongest pixel of each repeat by itself may jump between glints of nearly equal strength, and
    would measure the distance between them.) NaN when no pixel is observed in every repeat.
    """
    steady = np.isfinite(z_m).all(axis=0)
    if not steady.any():
        return np.full(len(z_m), np.nan)
    strongest = np.argmax(np.where(steady, amplitude.mean(axis=0), -np.inf))
    return z_m.reshape(len(z_m), -1)[:, strongest]


def precision(strongest_z_m: Sequence[np.ndarray]) -> Values:
    """Precision from each hand's strongest depths [n_repeats], metres; None without `usable_repeats`."""
    hands = usable_repeats(strongest_z_m)
    if not hands:
        return {"precision_mm": None, "relative_precision_percent": None}
    precision_m = np.mean([np.std(z, ddof=1) for z in hands])
    distance_m = np.mean([z.mean() for z in hands])
    return {
        "precision_mm": float(1e3 * precision_m),
        "relative_precision_percent": float(100 * (1 - precision_m / distance_m)),
    }


def usable_repeats(strongest_z_m: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Each hand's depths without its NaN repeats (nothing imaged).

    Empty when a hand keeps fewer than two: a mean over fewer hands would be another figure.
    """
    hands = [z[np.isfinite(z)] for z in (np.asarray(hand, dtype=np.float64) for hand in strongest_z_m)]
    return hands if all(len(z) > 1 for z in hands) else []


def definitions(keys: Sequence[str] = tuple(METRICS)) -> dict[str, str]:
    """Metric → "definition [unit]; lower is better", as result and metric files carry it."""
    return {k: f"{m.definition} [{m.unit}]; {m.better} is better" for k in keys if (m := METRICS.get(k))}
