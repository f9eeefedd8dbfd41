"""Reliability of σ, against simulated normal errors whose coverage and likelihood are known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom

from handbench.bench.evaluation.depth_errors import ErrorMap
from handbench.bench.evaluation.error_causes import (
    NOMINAL_PERCENT,
    coverage_percent,
    negative_log_likelihood,
)
from handbench.radar.data.depthmap import DepthMap
from tests.bench.evaluation.explained import Scored, explain

SIDE = 100
AXIS_M = 1e-3 * np.arange(SIDE)
REFERENCE_M = np.full((SIDE, SIDE), 0.3)


def table(error_m, sigma_m, reference_sigma_m=None, wrapped=None, captures=1):
    """The reliability of maps of one error and σ."""
    depth = DepthMap(
        AXIS_M,
        AXIS_M,
        REFERENCE_M + error_m,
        np.zeros_like(REFERENCE_M),
        "3fsk",
        sigma_m=sigma_m,
        wrapped=wrapped,
    )
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
    error_m = rng.normal(0, np.hypot(sigma_m, reference_m))
    found = table(error_m, sigma_m, reference_m)
    assert (
        found.nominal_percent[:6].tolist() == list(NOMINAL_PERCENT) and found.reference_sigma.all()
    )
    for line in found.itertuples():
        assert line.n_pixels == SIDE**2
        assert within_binomial(line.observed_percent, line.nominal_percent, SIDE**2)
    spread_mm = 1e3 * np.hypot(sigma_m, reference_m)
    expected = np.mean(0.5 * np.log(2 * np.pi * np.e * spread_mm**2))
    assert found.nll.tolist() == pytest.approx([expected] * len(found), abs=5 * np.sqrt(0.5) / SIDE)
    reference_m[0, 0] = np.nan  # one pixel whose reference tells none
    assert not table(error_m, sigma_m, reference_m).reference_sigma.any()
    alone = table(error_m, sigma_m)  # without the reference's share the intervals are too narrow
    assert not alone.reference_sigma.any()
    assert not within_binomial(alone.observed_percent[4], 95, SIDE**2)


def test_likelihood_is_its_closed_form():
    """−ln N has the expectation ½ ln(2πe σ²) and the variance ½ where σ is right; with σ' = k·σ it
    is ½ ln(2π k² σ²) + 1/(2k²)."""
    rng, sigma_mm, count = np.random.default_rng(6), 0.7, 200_000
    error_mm = rng.normal(0, sigma_mm, count)
    allowed = 5 * np.sqrt(0.5 / count)
    right = negative_log_likelihood(error_mm, np.full(count, sigma_mm))
    assert right == pytest.approx(0.5 * np.log(2 * np.pi * np.e * sigma_mm**2), abs=allowed)
    for k in (0.5, 2.0):
        told = negative_log_likelihood(error_mm, np.full(count, k * sigma_mm))
        expected = 0.5 * np.log(2 * np.pi * k**2 * sigma_mm**2) + 0.5 / k**2
        assert told == pytest.approx(expected, abs=allowed / k**2) and told > right


def test_coverage_counts_what_lies_within():
    deviations = np.array([0.0, 0.5, -0.7, 1.0, -1.5, 3.0])
    assert coverage_percent(deviations, 50) == pytest.approx(100 * 2 / 6)  # ±0.674
    assert coverage_percent(deviations, 68) == pytest.approx(100 * 3 / 6)  # ±0.994
    assert coverage_percent(deviations, 99) == pytest.approx(100 * 5 / 6)  # ±2.576


def test_flagged_pixels_are_told_apart_and_unknown_sigmas_left_out():
    rng = np.random.default_rng(7)
    sigma_m, error_m = np.full(REFERENCE_M.shape, 1e-3), rng.normal(0, 1e-3, REFERENCE_M.shape)
    flagged = np.zeros(REFERENCE_M.shape, bool)
    flagged[:10], error_m[:10] = True, 0.03
    sigma_m[-1] = np.nan
    found = table(error_m, sigma_m, np.zeros_like(sigma_m), flagged, captures=2).set_index(
        ["pixels", "nominal_percent"]
    )
    assert (
        found.n_pixels["all", 95] == 2 * 99 * SIDE
        and found.n_pixels["not flagged", 95] == 2 * 89 * SIDE
    )
    assert (found.n_captures == 2).all()
    assert within_binomial(found.observed_percent["not flagged", 95], 95, 89 * SIDE)
    assert found.observed_percent["all", 95] == pytest.approx(
        found.observed_percent["not flagged", 95] * 89 / 99
    )


def test_a_map_without_sigma_has_no_reliability():
    assert not len(table(np.zeros_like(REFERENCE_M), None))


def test_both_sigmas_are_added_as_variances():
    """3 and 4 mm are 5 mm: an error as large lies beyond the interval of 68 % (±0.994) and within
    that of 80 %."""
    shape = REFERENCE_M.shape
    found = table(np.full(shape, 5e-3), np.full(shape, 3e-3), np.full(shape, 4e-3)).query(
        "pixels == 'all'"
    )
    assert found.nominal_percent.tolist() == [50, 68, 80, 90, 95, 99]
    assert found.observed_percent.tolist() == [0, 0, 100, 100, 100, 100]
    assert found.nll.tolist() == pytest.approx([0.5 * (np.log(2 * np.pi * 25) + 1)] * 6, rel=1e-6)
    nothing = np.zeros(shape)
    nothing[0] = 1e-3  # elsewhere neither is known to err: no interval
    assert table(np.full(shape, 5e-3), nothing).n_pixels.tolist() == [shape[1]] * 12
