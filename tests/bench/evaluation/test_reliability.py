"""Reliability of σ, against errors at quantiles of normal distributions, whose coverage and
likelihood are known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from handbench.bench.evaluation.depth_errors import ErrorMap
from handbench.radar.data.depthmap import DepthMap
from tests.bench.evaluation.explained import Scored, explain

SIDE = 100
AXIS_M = 1e-3 * np.arange(SIDE)
REFERENCE_M = np.full((SIDE, SIDE), 0.3)


def table(error_m, sigma_m, reference_sigma_m=None, wrapped=None, captures=1):
    """The reliability of maps of one error and σ."""
    level_db = np.zeros_like(REFERENCE_M)
    given = {"sigma_m": sigma_m, "wrapped": wrapped}
    depth = DepthMap(AXIS_M, AXIS_M, REFERENCE_M + error_m, level_db, "3fsk", **given)
    errors = ErrorMap(AXIS_M, AXIS_M, error_m, REFERENCE_M, reference_sigma_m)
    return explain([Scored("3fsk", "truth", depth, errors)] * captures)["reliability"]


def normal_errors(spread_m):
    """Errors whose shares of the spreads are a normal distribution's quantiles, in any order."""
    share = (np.arange(spread_m.size) + 0.5) / spread_m.size
    return spread_m * np.random.default_rng(7).permutation(norm.ppf(share)).reshape(spread_m.shape)


def test_right_sigmas_cover_what_they_promise():
    rng = np.random.default_rng(5)
    sigma_m = rng.uniform(2e-4, 5e-3, REFERENCE_M.shape)
    reference_m = rng.uniform(1e-4, 2e-3, REFERENCE_M.shape)
    spread_m = np.hypot(sigma_m, reference_m)
    error_m = normal_errors(spread_m)
    found = table(error_m, sigma_m, reference_m)
    assert (found.n_pixels == SIDE**2).all() and found.reference_sigma.all()
    np.testing.assert_allclose(found.observed_percent, found.nominal_percent, atol=0.02)
    expected = np.mean(0.5 * np.log(2 * np.pi * np.e * (1e3 * spread_m) ** 2))
    assert found.nll.tolist() == pytest.approx([expected] * len(found), abs=1e-3)
    alone = table(error_m, sigma_m)  # without the reference's share the intervals are too narrow
    assert alone.observed_percent[4] < 94
    reference_m[0, 0] = np.nan  # one pixel whose reference is not known
    for partial in (alone, table(error_m, sigma_m, reference_m)):
        assert not partial.reference_sigma.any()


def test_flagged_pixels_are_kept_apart_and_unknown_sigmas_left_out():
    sigma_m = np.full(REFERENCE_M.shape, 1e-3)
    error_m, flagged = 0.03 + 0 * sigma_m, np.zeros(REFERENCE_M.shape, bool)
    error_m[10:-2] = normal_errors(sigma_m[10:-2])
    flagged[:10], sigma_m[-2:] = True, [[np.nan], [0]]  # unknown; known to err by nothing
    lines = table(error_m, sigma_m, np.zeros_like(sigma_m), flagged, captures=2)
    assert (lines.n_captures == 2).all() and not len(table(error_m, None))
    found = lines[lines.nominal_percent == 95].set_index("pixels")
    assert found.n_pixels.to_dict() == {"all": 2 * 98 * SIDE, "not flagged": 2 * 88 * SIDE}
    assert found.observed_percent.to_dict() == pytest.approx(
        {"all": 95 * 88 / 98, "not flagged": 95}, abs=0.02
    )
