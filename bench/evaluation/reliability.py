"""Reliability of a depth map's own σ: the share of the errors that its intervals hold, and the errors' likelihood."""

from collections.abc import Iterator
from statistics import NormalDist

import numpy as np

from bench.results.error_map import ErrorMap
from radar.data.depthmap import DepthMap

NOMINAL_PERCENT = (50, 68, 80, 90, 95, 99)


def reliability_lines(depth: DepthMap, errors: ErrorMap) -> Iterator[dict[str, object]]:
    """A capture's lines of RELIABILITY, for all pixels and for those that are not flagged as doubtful; none where the
    map has no σ. The reference's σ is added in quadrature where it is known."""
    if depth.sigma_m is None:
        return
    reference_m = np.full(errors.error_m.shape, np.nan) if errors.sigma_m is None else errors.sigma_m
    sigma_mm = 1e3 * np.hypot(depth.sigma_m, np.nan_to_num(reference_m))
    told = np.isfinite(errors.error_m) & np.isfinite(sigma_mm) & (sigma_mm > 0)
    known = bool(np.isfinite(reference_m[told]).all())
    sure = told if depth.wrapped is None else told & ~depth.wrapped
    for pixels, chosen in (("all", told), ("not flagged", sure)):
        error_mm, spread_mm = 1e3 * errors.error_m[chosen], sigma_mm[chosen]
        facts = {"pixels": pixels, "reference_sigma": known, "n_pixels": len(error_mm)}
        facts |= {"nll": negative_log_likelihood(error_mm, spread_mm)}
        for nominal in NOMINAL_PERCENT:
            yield facts | {"nominal_percent": nominal, "observed_percent": covered(error_mm / spread_mm, nominal)}


def covered(deviations: np.ndarray, nominal_percent: float) -> float:
    """Percentage of errors over their σ [n] that the normal interval of nominal_percent about 0 holds; NaN of none."""
    reach = NormalDist().inv_cdf(0.5 + nominal_percent / 200)
    return 100 * float(np.mean(np.abs(deviations) <= reach)) if len(deviations) else np.nan


def negative_log_likelihood(error_mm: np.ndarray, sigma_mm: np.ndarray) -> float:
    """Mean of −ln N(e; 0, σ²) of errors [n] in mm: ½ ln(2πe σ²) where all σ are equal and right; NaN of none."""
    each = 0.5 * (np.log(2 * np.pi * sigma_mm**2) + (error_mm / sigma_mm) ** 2)
    return float(each.mean()) if len(each) else np.nan
