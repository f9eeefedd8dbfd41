"""Intervals: their unit is the capture, and they cover what they promise. References: closed forms
and simulation."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats
from scipy.optimize import brentq
from scipy.special import erf

from handbench.bench.evaluation.depth_errors import ErrorMap, error_map
from handbench.bench.evaluation.intervals import (
    FEWEST,
    figure_interval,
    mean_interval,
    median_interval,
    note,
    precision_interval,
)
from handbench.bench.evaluation.metrics import mean_figures, of_captures, pool
from tests.strategies import examples

AXIS_M = 2.5e-3 * np.arange(12)
BETWEEN_MM = 0.7  # deviation of captures' biases


def seen(error_mm: float | np.ndarray, observed: np.ndarray | bool = True) -> ErrorMap:
    surface = np.full((12, 12), 0.3)
    return error_map(AXIS_M, AXIS_M, np.where(observed, surface + 1e-3 * error_mm, np.nan), surface)


def mae_mm(bias_mm: np.ndarray, noise_mm: float) -> np.ndarray:
    """The mean of a folded normal: MAE of a capture whose pixels err by `noise` about its bias."""
    gauss = noise_mm * np.sqrt(2 / np.pi) * np.exp(-(bias_mm**2) / (2 * noise_mm**2))
    return gauss + bias_mm * erf(bias_mm / noise_mm / np.sqrt(2))


@pytest.mark.parametrize("noise_mm", [0.1, 0.5, 1.0])
@pytest.mark.parametrize(("captures", "least"), [(5, 0.89), (10, 0.92), (20, 0.92)])
def test_the_maes_interval_holds_for_captures_that_differ(captures, least, noise_mm):
    """Captures 0.7 mm apart: 92 to 97 % at ten and more. All errors together are normal, so the
    true MAE has a closed form. Five captures do not know how skewed they are. 4000 trials know a
    share of 95 % to 0.35 %."""
    biases_mm = BETWEEN_MM * np.random.default_rng(0).standard_normal((4000, captures))
    true_mm = np.hypot(BETWEEN_MM, noise_mm) * np.sqrt(2 / np.pi)
    intervals = [figure_interval("mae_mm", values) for values in mae_mm(biases_mm, noise_mm)]
    assert least <= np.mean([low <= true_mm <= high for low, high in intervals]) <= 0.97


def test_figures_without_skewness_have_students_interval():
    values = np.array([0.8, 1.2, 1.0, 0.9, 1.1])
    expected = stats.t.interval(0.95, 4, values.mean(), stats.sem(values))
    assert mean_interval(values) == pytest.approx(expected, rel=1e-9)


@given(st.lists(st.floats(0, 10), min_size=FEWEST, max_size=12), st.floats(1e-3, 1e3))
@examples(100)
def test_an_interval_holds_the_mean_and_follows_the_unit(values, unit):
    low, high = mean_interval(values)
    mean, size = np.mean(values), max(values)
    assert low - 1e-9 * size <= mean <= high + 1e-9 * size
    assert mean_interval(unit * np.array(values)) == pytest.approx(
        (unit * low, unit * high), rel=1e-6, abs=1e-9 * unit
    )


def test_an_interval_leans_to_the_side_of_the_tail():
    values = [1.0, 1.1, 0.9, 1.0, 1.05, 3.0]
    low, high = mean_interval(values)
    assert high - np.mean(values) > 1.5 * (np.mean(values) - low)


def test_four_captures_have_no_interval_and_it_is_said():
    assert (
        mean_interval([1.0, 2.0, 3.0, 4.0]) is None
        and mean_interval([1.0, 2.0, 3.0, 4.0, np.nan]) is None
    )
    assert note(3) == "3 captures: no intervals, which need at least 5 captures"
    assert note(1).startswith("1 capture: too few") and note(FEWEST).endswith(
        "between which the figures vary"
    )


def test_an_interval_stays_within_what_a_metric_can_be():
    skewed = [0.01, 0.01, 0.02, 0.01, 2.0]
    assert figure_interval("mae_mm", skewed).low >= 0
    assert figure_interval("bias_mm", [-1.0, 1.0, -1.1, 1.1, 0.3]).low < 0
    assert figure_interval("observed_percent", [99.0, 99.9, 98.0, 99.9, 99.5]).high <= 100
    assert figure_interval("observed_percent", [100.0] * 6) is None  # no spread was seen


def test_figures_are_formed_for_each_capture_and_then_averaged():
    """By hand: captures of 36 and 144 pixels, one without any; the pooled figures beside them."""
    quarter = np.zeros((12, 12), bool)
    quarter[:6, :6] = True
    peak_mm = np.ones((12, 12))
    peak_mm[0, 0] = 10
    captures = of_captures([seen(4.0, quarter), seen(peak_mm), seen(1.0, False)])
    found = mean_figures(captures)
    one_mm = (143 + 10) / 144
    assert found["mae_mm"] == pytest.approx((4 + one_mm) / 2)
    assert found["max_mm"] == pytest.approx((4 + 10) / 2)
    assert found["pooled_mae_mm"] == pytest.approx((4 * 36 + one_mm * 144) / 180)
    assert found["pooled_max_mm"] == pytest.approx(10)
    assert (
        found["observed_percent"] == pytest.approx(100 * (1 / 4 + 1 + 0) / 3)
        and found["n_observed"] == 180
    )
    assert found["pooled_mae_mm"] == pytest.approx(
        pool([seen(4.0, quarter), seen(peak_mm)])["mae_mm"]
    )


def test_no_figure_from_nothing():
    for maps in ([], [seen(1.0, False)] * 6):
        found = mean_figures(of_captures(maps))
        assert (
            found["mae_mm"] is None and found["pooled_max_mm"] is None and found["n_observed"] == 0
        )


def repeats(
    rng: np.random.Generator, rho: float, sigma_mm: np.ndarray, n: int = 10
) -> list[np.ndarray]:
    """Depths of hands with neighbours' correlation rho (AR 1), stationary."""
    z = rng.standard_normal((n, len(sigma_mm)))
    for k in range(1, n):
        z[k] = rho * z[k - 1] + np.sqrt(1 - rho**2) * z[k]
    return list(0.3 + 1e-3 * sigma_mm[:, None] * z.T)


@pytest.mark.parametrize("rho", [0.0, 0.3, 0.7])
@pytest.mark.parametrize("hands", [3, 10])
def test_the_precisions_interval_holds_with_correlated_repeats(hands, rho):
    """91 to 99 %: 200 trials know a share of 95 % to 1.5 %."""
    rng, sigma_mm = np.random.default_rng(0), np.linspace(0.2, 0.4, hands)
    intervals = [precision_interval(repeats(rng, rho, sigma_mm), trial) for trial in range(200)]
    assert 0.91 <= np.mean([low <= sigma_mm.mean() <= high for low, high in intervals]) <= 0.99


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


@pytest.mark.parametrize("values", [(1.0, 1.2, 1.1, 1.9, 4.0), (-3.0, 0.1, 0.2, 0.3, 0.0, 0.25)])
def test_an_interval_of_skewed_captures_is_halls(values):
    """T + γT²/3 + γ²T³/27 + γ/6n is Student's (Hall 1992): its ends, sought by a root finder, with
    scipy's skewness."""
    n, skew = len(values), stats.skew(values)
    mean, spread = np.mean(values), np.std(values, ddof=1)

    def end(tail: float) -> float:
        t = stats.t.ppf(tail, n - 1) / np.sqrt(n)
        found = brentq(
            lambda x: x + skew * x**2 / 3 + skew**2 * x**3 / 27 + skew / (6 * n) - t, -1e3, 1e3
        )
        return mean - spread * found

    assert mean_interval(values) == pytest.approx((end(0.975), end(0.025)), rel=1e-8)
    assert mean_interval((*values, np.nan, np.inf)) == mean_interval(values)
    assert mean_interval(values[:4]) is None


def test_a_note_counts_the_captures():
    assert note(1) == "1 capture: no intervals, which need at least 5 captures"
    assert note(4).startswith("4 captures: too few") and note(5).startswith(
        "5 captures: the intervals are those of"
    )


def test_three_values_have_a_median_interval():
    """A bootstrap of three draws each of them: the ends are the least (7 of 27 medians) and the
    largest."""
    assert median_interval(np.array([1.0, 2.0, 4.0])) == (1.0, 4.0)
