"""Intervals: they contain the estimate, cover what they promise, and widen where pixels err together."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from bench.metrics import ErrorMap, error_map, pool
from bench.statistics import (
    _cut,
    _quantiles,
    _resampled,
    median_interval,
    pooled_intervals,
    precision_interval,
)


def noise_map(rng: np.random.Generator, n: int = 40, deviation_m: float = 1e-3, bias_m: float = 0) -> ErrorMap:
    """Independent normal errors on an n × n grid of 2.5 mm, an eighth of the pixels unobserved."""
    axis = 2.5e-3 * np.arange(n)
    reference_m = np.full((n, n), 0.3)
    z_m = reference_m + bias_m + deviation_m * rng.normal(size=(n, n))
    z_m[rng.random((n, n)) < 0.125] = np.nan
    return error_map(axis, axis, z_m, reference_m)


@given(st.integers(0, 10**6), st.integers(1, 6), st.floats(-2e-3, 2e-3))
@settings(max_examples=25, deadline=None)
def test_contains_the_estimate(seed, captures, bias_m):
    rng = np.random.default_rng(seed)
    maps = [noise_map(rng, n=14, bias_m=bias_m) for _ in range(captures)]
    estimate, intervals = pool(maps), pooled_intervals(maps, seed, resamples=60)
    assert set(intervals) == set(estimate) - {"n_observed"}
    assert all(low <= estimate[key] <= high for key, (low, high) in intervals.items())


def test_one_draw_of_every_block_is_the_estimate():
    """The block sums and the pixels themselves must give the same figures (rounding only)."""
    maps = [noise_map(np.random.default_rng(seed)) for seed in range(3)]
    blocks = _cut(maps, 0.015)
    resampled = _resampled(blocks, np.ones((1, sum(blocks.per_capture)), dtype=int))
    estimate = pool(maps)
    assert {key: value[0] for key, value in resampled.items()} == pytest.approx(
        {key: estimate[key] for key in resampled}, rel=1e-12
    )


def test_quantiles_are_those_of_the_repeated_pixels():
    rng = np.random.default_rng(3)
    values, block, counts = rng.random(50), rng.integers(0, 6, 50), rng.integers(0, 4, (20, 6))
    counts[:, 0] += 1
    got = _quantiles(values, block, counts, (0.5, 0.95))
    for r, count in enumerate(counts):
        np.testing.assert_allclose(got[:, r], np.quantile(np.repeat(values, count[block]), [0.5, 0.95]), rtol=1e-12)


def test_is_seeded():
    maps = [noise_map(np.random.default_rng(0))]
    assert pooled_intervals(maps, seed=7) == pooled_intervals(maps, seed=7)
    assert pooled_intervals(maps, seed=7) != pooled_intervals(maps, seed=8)


def test_covers_independent_noise():
    """A 95 % interval over 49 blocks: 200 trials lie within 4 standard errors (6 %) of it, less the 3 %
    that a percentile bootstrap of few blocks is known to lose."""
    expected_mm = np.sqrt(2 / np.pi)
    hits = 0
    for trial in range(200):
        low, high = pooled_intervals([noise_map(np.random.default_rng(trial))], trial, resamples=200)["mae_mm"]
        hits += low <= expected_mm <= high
    assert 0.86 <= hits / 200 <= 1


def test_pixels_that_err_together_widen_the_interval():
    """Errors equal within 15 mm carry 36 times less information than pixels: about 6 times the width."""
    rng = np.random.default_rng(0)
    axis = 2.5e-3 * np.arange(60)
    error_m = np.kron(1e-3 * rng.normal(size=(10, 10)), np.ones((6, 6)))
    maps = [ErrorMap(axis, axis, error_m, np.full_like(error_m, 0.3))]
    widths = [np.diff(pooled_intervals(maps, block_m=b)["mae_mm"])[0] for b in (0.015, 2.5e-3)]
    assert 4 < widths[0] / widths[1] < 9


def test_five_captures_are_resampled_too():
    """Captures that differ by their bias: the interval knows it from five captures on."""
    rng = np.random.default_rng(0)
    maps = [noise_map(rng, bias_m=bias_m) for bias_m in (-2e-3, -1e-3, 0, 1e-3, 2e-3)]
    five, four = (np.diff(pooled_intervals(m)["bias_mm"])[0] for m in (maps, maps[:4]))
    assert five > 5 * four


def test_a_maximum_ends_at_the_largest_error():
    maps = [noise_map(np.random.default_rng(0))]
    assert pooled_intervals(maps)["max_mm"].high == pool(maps)["max_mm"]


def test_no_interval_from_nothing():
    nothing = np.full((20, 20), np.nan)
    axis = 2.5e-3 * np.arange(20)
    assert pooled_intervals([]) == {}
    assert pooled_intervals([ErrorMap(axis, axis, nothing, nothing)]) == {}
    assert pooled_intervals([ErrorMap(axis, axis, nothing, np.full((20, 20), 0.3))]) == {}
    assert pooled_intervals([noise_map(np.random.default_rng(0), n=4)]) == {}  # one block


def test_resamples_without_observed_pixels_are_left_out():
    """One observed block among four: some resamples miss it, and the rest still give numbers."""
    axis = 2.5e-3 * np.arange(12)
    error_m = np.full((12, 12), np.nan)
    error_m[:6, :6] = 1e-3
    low, high = pooled_intervals([ErrorMap(axis, axis, error_m, np.full((12, 12), 0.3))])["mae_mm"]
    assert low == pytest.approx(1, rel=1e-12) and high == pytest.approx(1, rel=1e-12)


def test_one_hands_precision_has_the_textbook_interval():
    z_m = 0.3 + 1e-3 * np.random.default_rng(0).normal(size=10)
    s_mm = 1e3 * np.std(z_m, ddof=1)
    expected = [s_mm * np.sqrt(9 / stats.chi2.ppf(p, 9)) for p in (0.975, 0.025)]
    assert precision_interval([z_m]) == pytest.approx(expected, rel=1e-9)


def test_precision_interval_covers_three_unequal_hands():
    """Ten repeats of hands with deviations of 0.2, 0.3 and 0.4 mm: 95 % ± 3 standard errors of 1000 trials, and
    2 % for the approximation."""
    rng, sigma_mm = np.random.default_rng(1), np.array([0.2, 0.3, 0.4])
    hits = 0
    for _ in range(1000):
        low, high = precision_interval(list(0.3 + 1e-3 * sigma_mm[:, None] * rng.normal(size=(3, 10))))
        hits += low <= sigma_mm.mean() <= high
    assert 0.91 <= hits / 1000 <= 0.99


def test_precision_interval_of_nothing_and_of_no_scatter():
    assert precision_interval([]) is None
    assert precision_interval([np.array([0.3, np.nan])]) is None
    assert precision_interval([np.full(10, 0.25)]) == (0, 0)


def test_median_interval():
    values = np.random.default_rng(0).normal(5, 1, 100)
    low, high = median_interval(values)
    assert low < np.median(values) < high
    assert high - low < 1  # the median of 100 has a standard error of 0.125
    assert median_interval(values[:2]) is None
