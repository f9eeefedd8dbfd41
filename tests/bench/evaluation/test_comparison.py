"""Comparisons: known differences and what stands out. False ones and Holm's
correction: tests/hard_cases."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from scipy import stats

from handbench.bench.evaluation.paired import compare, f_test, welch_test
from handbench.bench.results.result_folder import best, shown


def speckle(seed: int, captures: int = 6) -> np.ndarray:
    return 1 + 0.1 * np.random.default_rng(seed).normal(size=captures)


@pytest.mark.parametrize(("shift_mm", "first"), [(0, ("2fsk", "3fsk")), (1, ("3fsk",))])
def test_a_constant_shift_is_known_exactly(shift_mm, first):
    """What both methods share cancels, so nothing is left to doubt (float64: 1e-9 mm)."""
    lines = compare({"2fsk": speckle(0) + shift_mm, "3fsk": speckle(0)}, "truth")
    [line] = lines.itertuples()
    assert (line.p_corrected < 1e-12) == bool(shift_mm) and line.n_captures == 6
    assert (line.difference, line.low, line.high) == pytest.approx([shift_mm] * 3, abs=1e-9)
    assert best(lines) == list(first)


def test_six_captures_have_students_paired_test():
    one, other = speckle(1), speckle(2) + 0.05
    [line] = compare({"a": one, "b": other}, "truth").itertuples()
    d = other - one
    assert line.p_corrected == pytest.approx(stats.ttest_rel(one, other).pvalue, rel=1e-9)
    assert line.effect == pytest.approx(abs(d.mean()) / d.std(ddof=1), rel=1e-9)
    assert line.low <= line.difference <= line.high
    three = {"a": one, "b": other, "c": speckle(3) + 1}  # the least p of three pairs counts thrice
    least = min(stats.ttest_rel(*pair).pvalue for pair in combinations(three.values(), 2))
    assert compare(three, "truth").p_corrected.min() == pytest.approx(3 * least, rel=1e-9)


def test_two_samples_have_welchs_test():
    one, other = speckle(1, 7), speckle(2, 9) + 0.05
    expected = stats.ttest_ind(other, one, equal_var=False)
    found = welch_test(one, other)
    assert found.p == pytest.approx(expected.pvalue, rel=1e-9)
    assert found[1:3] == pytest.approx(tuple(expected.confidence_interval(0.95)), rel=1e-9)
    ones = np.ones(5)
    assert welch_test(ones, 1.5 * ones) == (0.5, 0.5, 0.5, 0.0)  # which do not scatter
    assert welch_test(ones[:4], 1.5 * ones)[0] == 0.5 and np.isnan(welch_test(ones[:4], ones).p)
    assert np.isnan(welch_test(np.nan * ones, ones)[0])


def test_more_of_a_share_is_better():
    shares = {"holed": 90 * speckle(0), "whole": 95 * speckle(0)}
    [line] = compare(shares, "truth", "observed_percent").itertuples()
    assert (line.better, line.worse, line.unit) == ("whole", "holed", "%")
    assert line.difference == pytest.approx(5 * speckle(0).mean()) and line.low > 0


def test_what_cannot_be_tested_is_not():
    """Four captures: a difference on these, no interval, no p, and no method stands out."""
    four = speckle(0, 4)
    lines = compare({"a": four, "b": four + 0.5, "c": np.full(4, np.nan)}, "truth")
    assert len(lines) == 1 and lines[["p_corrected", "low"]].isna().all(axis=None)
    assert not shown(lines).any() and best(lines) == []
    [small] = compare({"a": four, "b": four + 0.004}, "truth").sentence
    [none] = compare({"a": four, "b": four}, "truth").sentence
    assert "0.0040 mm" in small and "0.0" not in none  # no lead of 0.00 mm
    assert compare({}, "truth").empty and compare({"a": speckle(0)}, "truth").empty


def test_the_ratio_of_precisions_lies_between_quantiles_of_f():
    """s_b/s_a = 2 of 10 and 12 repeats: σ_b/σ_a between 2/√F(0.975; 11, 9) and 2/√F(0.025; 11,
    9)."""
    a, b = np.linspace(-1, 1, 10), np.linspace(-1, 1, 12)
    a, b = 1e-3 * a / a.std(ddof=1), 2e-3 * b / b.std(ddof=1)
    low, high = (2 / np.sqrt(stats.f.ppf(tail, 11, 9)) - 1 for tail in (0.975, 0.025))
    assert f_test([a], [b])[:3] == pytest.approx((1.0, low, high), rel=1e-9)
    assert f_test([a], [np.zeros(5)]) == pytest.approx((-1, *[np.nan] * 3), nan_ok=True)


def test_precisions_are_compared_by_the_f_test():
    """Whichever comes first, at the table's 5 % points of F(20, 20), 2.464; and not of nothing."""
    unit = 1e-3 * np.tile([-1.0, 1.0, 0.0], 7)
    more = np.sqrt(2.4645) * unit
    for a, b in ((unit, more), (more, unit)):
        assert f_test([a], [b]).p == pytest.approx(0.05, rel=2e-3)
    assert np.isnan(f_test([], [unit]).difference) and np.isnan(f_test([np.zeros(5)], [unit]).p)
