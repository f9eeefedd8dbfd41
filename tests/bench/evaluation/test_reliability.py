"""Reliability of σ, against errors at quantiles of normal distributions, whose coverage is
known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from handbench.bench.evaluation.depth_errors import ErrorMap, coverage_percent
from handbench.radar.data.depthmap import DepthMap

AXIS_M = 1e-3 * np.arange(100)
REFERENCE_M = np.full((100, 100), 0.3)


def covered(error_m, sigma_m, reference_sigma_m=None):
    level_db = np.zeros_like(REFERENCE_M)
    depth = DepthMap(AXIS_M, AXIS_M, REFERENCE_M + error_m, level_db, "3fsk", sigma_m=sigma_m)
    return coverage_percent(
        depth, ErrorMap(AXIS_M, AXIS_M, error_m, REFERENCE_M, reference_sigma_m)
    )


def test_right_sigmas_cover_what_they_promise():
    """Errors whose shares of the spreads are a normal distribution's quantiles, in any order; the
    last ten rows have no σ."""
    rng = np.random.default_rng(5)
    sigma_m, reference_m = (rng.uniform(1e-4, most, (100, 100)) for most in (5e-3, 2e-3))
    sigma_m[-10:] = np.nan
    share = (rng.permutation(9000) + 0.5) / 9000
    error_m = np.full((100, 100), 0.03)
    error_m[:90] = np.hypot(sigma_m, reference_m)[:90] * norm.ppf(share).reshape(90, 100)
    found = covered(error_m, sigma_m, reference_m)
    assert found == pytest.approx({nominal: nominal for nominal in found}, abs=0.02)
    assert covered(error_m, sigma_m)[95] < 94  # without the reference's share
    assert covered(error_m, None) == {} == covered(error_m, np.full((100, 100), np.nan))
