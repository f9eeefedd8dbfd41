"""Methods under equal treatment: on the pixels that all see, smoothed alike, and by their own order
of amplitudes.

Thresholds and filters of their own decide much of a method's error. Two measures are free of them:
the error on the pixels that every method sees, and the risk–coverage curve (El-Yaniv & Wiener 2010;
its area: Geifman et al. 2019), the error of a method's strongest pixels over the share of the
surface that they are, whatever the threshold.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from handbench.bench.evaluation.depth_errors import ErrorMap
from handbench.bench.evaluation.metrics import HEADLINE, Values, pool
from handbench.bench.evaluation.treatments import TreatedDepths

SHARES_PERCENT = np.arange(0.5, 100.1, 0.5)  # of the surface, at which the curve is told
TREATMENTS = {"none": "unsmoothed", "window": "all averaged over 5 × 5"}  # in words
EQUAL_METRICS = ("common_percent", "aurc_mm", "aurc_to_percent")  # under equal treatment alone
FIGURES = (HEADLINE, "median_mm", "p95_mm", "max_mm", "bias_mm")  # on the common pixels


class TreatedFigures(NamedTuple):
    """A method's figures of one capture under one treatment, and the mean absolute error at
    SHARES_PERCENT, mm [n], NaN where the method does not reach."""

    figures: Values
    curve_mm: np.ndarray


def on_common_pixels(metric: str) -> str:
    """The words with which a metric's title goes on under equal treatment; none for one that needs
    no common pixels."""
    return "" if metric in EQUAL_METRICS else " on common pixels"


def treated_figures(
    maps: Mapping[str, TreatedDepths], reference_z_m: np.ndarray
) -> dict[str, TreatedFigures]:
    """Each method's figures against one reference [ny, nx], of the maps of all methods on its
    grid."""
    common = np.isfinite(reference_z_m)
    for alike in maps.values():
        common = common & np.isfinite(alike.z_m)
    risks_mm = {method: risk_mm(alike, reference_z_m) for method, alike in maps.items()}
    reached = min(map(len, risks_mm.values()), default=0)
    surface = np.isfinite(reference_z_m).sum()
    y, x = (np.arange(n, dtype=float) for n in common.shape)
    found = {}
    for method, alike in maps.items():
        pooled = pool(
            [ErrorMap(x, y, np.where(common, alike.z_m - reference_z_m, np.nan), reference_z_m)]
        )
        figures = {key: pooled[key] for key in FIGURES}
        figures["common_percent"] = 100 * float(common.sum() / surface) if surface else None
        figures["aurc_mm"] = float(risks_mm[method][:reached].mean()) if reached else None
        figures["aurc_to_percent"] = 100 * float(reached / surface) if surface else None
        found[method] = TreatedFigures(figures, _at_shares(risks_mm[method], int(surface)))
    return found


def risk_mm(alike: TreatedDepths, reference_z_m: np.ndarray) -> np.ndarray:
    """Mean absolute error of the 1, 2, … n strongest pixels on the surface, mm [n]; equal
    amplitudes stay in the order of the map."""
    seen = np.isfinite(alike.open_z_m) & np.isfinite(reference_z_m)
    error_mm = 1e3 * np.abs(alike.open_z_m - reference_z_m)[seen]
    order = np.argsort(-alike.open_db[seen], kind="stable")
    return np.cumsum(error_mm[order]) / np.arange(1, len(order) + 1)


def _at_shares(risk: np.ndarray, surface: int) -> np.ndarray:
    counts = np.round(SHARES_PERCENT / 100 * surface).astype(int)
    reached = (counts >= 1) & (counts <= len(risk))
    curve_mm = np.full(len(counts), np.nan)
    curve_mm[reached] = risk[counts[reached] - 1]
    return curve_mm
