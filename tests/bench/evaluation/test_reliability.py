"""Reliability of σ, against simulated normal errors whose coverage and likelihood are known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom

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


def within_binomial(observed_percent: float, nominal_percent: float, count: int) -> bool:
    """Whether so many of `count` independent errors may lie in an interval: in all but one of a
    million draws."""
    low, high = binom.interval(1 - 1e-6, count, nominal_percent / 100)
    return low <= observed_percent / 100 * count <= high


def test_coverage_of_right_sigmas_is_binomial():
    rng = np.random.default_rng(5)
    sigma_m = rng.uniform(2e-4, 5e-3, REFERENCE_M.shape)
    reference_m = rng.uniform(1e-4, 2e-3, REFERENCE_M.shape)
    spread_m = np.hypot(sigma_m, reference_m)
    error_m = rng.normal(0, spread_m)
    found = table(error_m, sigma_m, reference_m)
    for line in found.itertuples():
        assert line.n_pixels == SIDE**2 and line.reference_sigma
        assert within_binomial(line.observed_percent, line.nominal_percent, SIDE**2)
    expected = np.mean(0.5 * np.log(2 * np.pi * np.e * (1e3 * spread_m) ** 2))
    assert found.nll.tolist() == pytest.approx([expected] * len(found), abs=5 * np.sqrt(0.5) / SIDE)
    alone = table(error_m, sigma_m)  # without the reference's share the intervals are too narrow
    assert not within_binomial(alone.observed_percent[4], 95, SIDE**2)
    reference_m[0, 0] = np.nan  # one pixel whose reference is not known
    for partial in (alone, table(error_m, sigma_m, reference_m)):
        assert not partial.reference_sigma.any()


def test_flagged_pixels_are_kept_apart_and_unknown_sigmas_left_out():
    rng = np.random.default_rng(7)
    sigma_m, error_m = np.full(REFERENCE_M.shape, 1e-3), rng.normal(0, 1e-3, REFERENCE_M.shape)
    flagged = np.zeros(REFERENCE_M.shape, bool)
    flagged[:10], error_m[:10] = True, 0.03
    sigma_m[-2:] = [[np.nan], [0]]  # unknown; known to err by nothing
    lines = table(error_m, sigma_m, np.zeros_like(sigma_m), flagged, captures=2)
    assert (lines.n_captures == 2).all() and not len(table(error_m, None))
    found = lines[lines.nominal_percent == 95].set_index("pixels")
    assert found.n_pixels.to_dict() == {"all": 2 * 98 * SIDE, "not flagged": 2 * 88 * SIDE}
    held = found.observed_percent
    assert within_binomial(held["not flagged"], 95, 88 * SIDE)
    assert held["all"] == pytest.approx(held["not flagged"] * 88 / 98)
