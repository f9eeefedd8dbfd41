"""Figures of methods under equal treatment: on the pixels that all methods observe, with the same
smoothing, and with pixels ordered by amplitude.

Much of a method's error depends on its thresholds and filters. Two figures do not: the error on the
pixels that every method observes, and the risk–coverage curve (El-Yaniv & Wiener 2010; area under
it: Geifman et al. 2019). This curve is the error of a method's strongest pixels as a function of
the share of the surface that they cover, so it covers every threshold.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from handbench.bench.evaluation.depth_errors import ErrorMap
from handbench.bench.evaluation.metrics import HEADLINE, Values, pool
from handbench.bench.evaluation.treatments import TreatedDepths

SHARES_PERCENT = np.arange(0.5, 100.1, 0.5)  # of the surface, at which the curve is recorded
FEWEST_PERCENT = 1.0  # of the surface; with fewer a method would decide the others' common pixels
TREATMENTS = {"none": "unsmoothed", "window": "all averaged over 5 × 5"}  # in words
EQUAL_METRICS = ("common_percent", "aurc_mm", "aurc_to_percent")  # only under equal treatment
FIGURES = (HEADLINE, "median_mm", "p95_mm", "max_mm", "bias_mm")  # on the common pixels


class TreatedFigures(NamedTuple):
    """Figures of one method on one capture under one equal treatment (same smoothing for all
    methods).
    figures: metric → value. curve_mm [n]: mean absolute error of the strongest pixels that cover
    0.5, 1, 1.5, … 100 % of the surface (SHARES_PERCENT); NaN at shares that the method does not
    reach."""

    figures: Values
    curve_mm: np.ndarray


def on_common_pixels(metric: str) -> str:
    """Return the end of a metric's title under equal treatment: " on common pixels" for a metric of
    the pixels that all methods observe, "" for another."""
    return "" if metric in EQUAL_METRICS else " on common pixels"


def taking_part(
    maps: Mapping[str, TreatedDepths], reference_z_m: np.ndarray
) -> dict[str, TreatedDepths]:
    """Select the methods that observe at least 1 % of the surface (FEWEST_PERCENT).
    maps: method → its depths, all on the pixel grid of the reference; reference_z_m [ny, nx]:
    depths of the surface, metres, NaN where there is none."""
    surface = np.isfinite(reference_z_m)
    fewest = FEWEST_PERCENT / 100 * surface.sum()
    return {m: of for m, of in maps.items() if (np.isfinite(of.z_m) & surface).sum() >= fewest}


def treated_figures(
    maps: Mapping[str, TreatedDepths], reference_z_m: np.ndarray
) -> dict[str, TreatedFigures]:
    """Compute the figures of every method on one capture, under one equal treatment (same smoothing
    for all methods): method → figures.
    maps: method → its depths, all on the pixel grid of the reference; reference_z_m [ny, nx]:
    depths of the surface, metres. Errors count only on the pixels that all methods observe. The
    area under the risk–coverage curve (aurc_mm) ends at the share of the surface that all methods
    reach."""
    common = np.isfinite(reference_z_m)
    for depths in maps.values():
        common = common & np.isfinite(depths.z_m)
    risks_mm = {method: risk_mm(depths, reference_z_m) for method, depths in maps.items()}
    reached = min(map(len, risks_mm.values()), default=0)
    surface = np.isfinite(reference_z_m).sum()
    y, x = (np.arange(n, dtype=float) for n in common.shape)
    found = {}
    for method, depths in maps.items():
        pooled = pool(
            [ErrorMap(x, y, np.where(common, depths.z_m - reference_z_m, np.nan), reference_z_m)]
        )
        figures = {key: pooled[key] for key in FIGURES}
        figures["common_percent"] = 100 * float(common.sum() / surface) if surface else None
        figures["aurc_mm"] = float(risks_mm[method][:reached].mean()) if reached else None
        figures["aurc_to_percent"] = 100 * float(reached / surface) if surface else None
        found[method] = TreatedFigures(figures, _at_shares(risks_mm[method], int(surface)))
    return found


def risk_mm(depths: TreatedDepths, reference_z_m: np.ndarray) -> np.ndarray:
    """Compute the risk–coverage curve [n], mm: its k-th value is the mean absolute error of the k
    strongest pixels.
    Only pixels with a depth and a reference count; pixels of equal amplitude keep the order of the
    map. reference_z_m [ny, nx]: depths of the surface, metres."""
    seen = np.isfinite(depths.open_z_m) & np.isfinite(reference_z_m)
    error_mm = 1e3 * np.abs(depths.open_z_m - reference_z_m)[seen]
    order = np.argsort(-depths.open_db[seen], kind="stable")
    return np.cumsum(error_mm[order]) / np.arange(1, len(order) + 1)


def _at_shares(risk: np.ndarray, surface: int) -> np.ndarray:
    counts = np.round(SHARES_PERCENT / 100 * surface).astype(int)
    reached = (counts >= 1) & (counts <= len(risk))
    curve_mm = np.full(len(counts), np.nan)
    curve_mm[reached] = risk[counts[reached] - 1]
    return curve_mm
