"""Figures of methods under equal treatment: on the pixels that all methods observe, with the same
smoothing. Much of a method's error depends on its thresholds and filters; these figures do not.
"""

from collections.abc import Mapping

import numpy as np

from handbench.bench.evaluation.depth_errors import ErrorMap
from handbench.bench.evaluation.metrics import Values, figures

TREATMENTS = {"none": "unsmoothed", "window": "all averaged over 5 × 5"}  # in words
FEWEST_PERCENT = 1.0  # of the surface; with fewer a method would decide the others' common pixels
COMMON = "common_percent"  # the only metric that exists under equal treatment alone


def on_common_pixels(metric: str) -> str:
    """Return the end of a metric's title under equal treatment: " on common pixels" for a metric of
    the pixels that all methods observe, "" for another."""
    return "" if metric == COMMON else " on common pixels"


def taking_part(maps: Mapping[str, np.ndarray], reference_z_m: np.ndarray) -> dict[str, np.ndarray]:
    """Select the methods that observe at least 1 % of the surface (FEWEST_PERCENT).
    maps: method → its depths [ny, nx], metres, NaN where there is none, on the pixel grid of the
    reference; reference_z_m [ny, nx]: depths of the surface, metres, NaN where there is none."""
    surface = np.isfinite(reference_z_m)
    fewest = FEWEST_PERCENT / 100 * surface.sum()
    return {m: z_m for m, z_m in maps.items() if (np.isfinite(z_m) & surface).sum() >= fewest}


def treated_figures(maps: Mapping[str, np.ndarray], reference_z_m: np.ndarray) -> dict[str, Values]:
    """Compute the figures of every method on one capture, under one equal treatment (same smoothing
    for all methods): method → metric → value.
    maps: method → its depths [ny, nx], metres, all on the pixel grid of the reference;
    reference_z_m [ny, nx]: depths of the surface, metres. Errors count only on the pixels that all
    methods observe."""
    common = np.isfinite([reference_z_m, *maps.values()]).all(axis=0)
    surface = np.isfinite(reference_z_m).sum()
    y, x = (np.arange(n, dtype=float) for n in common.shape)
    found = {}
    for method, z_m in maps.items():
        error_m = np.where(common, z_m - reference_z_m, np.nan)
        values = figures(ErrorMap(x, y, error_m, reference_z_m), place="common")
        values[COMMON] = 100 * float(common.sum() / surface) if surface else None
        found[method] = values
    return found
