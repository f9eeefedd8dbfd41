"""Reliability of a depth map's σ: the share of its errors inside the intervals that σ gives."""

from statistics import NormalDist

import numpy as np

from handbench.bench.evaluation.depth_errors import ErrorMap
from handbench.radar.data.depthmap import DepthMap

NOMINAL_PERCENT = (50, 68, 80, 90, 95, 99)


def coverage_percent(depth: DepthMap, errors: ErrorMap) -> dict[int, float]:
    """Return the share of a map's errors inside the central normal intervals about its depths:
    nominal → observed, percent. σ of the map and, where known, of the reference are added in
    quadrature. Empty if the map has no σ, or no pixel with an error and a σ above 0."""
    if depth.sigma_m is None:
        return {}
    reference_m = 0.0 if errors.sigma_m is None else np.nan_to_num(errors.sigma_m)
    sigma_m = np.hypot(depth.sigma_m, reference_m)
    usable = np.isfinite(errors.error_m) & np.isfinite(sigma_m) & (sigma_m > 0)
    if not usable.any():
        return {}
    deviations = np.abs(errors.error_m[usable]) / sigma_m[usable]
    reaches = {p: NormalDist().inv_cdf(0.5 + p / 200) for p in NOMINAL_PERCENT}
    return {p: 100 * float(np.mean(deviations <= reach)) for p, reach in reaches.items()}
