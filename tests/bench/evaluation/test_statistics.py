"""Intervals: their unit is the capture, and they cover what they promise. References: closed forms
and simulation."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from scipy.special import erf

from handbench.bench.evaluation.depth_errors import ErrorMap, error_map
from handbench.bench.evaluation.intervals import mean_interval, median_interval, precision_interval
from handbench.bench.evaluation.metrics import METRICS, figures
from handbench.bench.evaluation.scoring_protocols import PAPER, main_table
from handbench.bench.evaluation.tables import SCORES, frame

AXIS_M = 2.5e-3 * np.arange(12)
BETWEEN_MM = 0.7  # deviation of captures' biases


def seen(error_mm: float | np.ndarray, observed: np.ndarray | bool = True) -> ErrorMap:
    surface = np.full((12, 12), 0.3)
    return error_map(AXIS_M, AXIS_M, np.where(observed, surface + 1e-3 * error_mm, np.nan), surface)


def mae_mm(bias_mm: np.ndarray, noise_mm: float) -> np.ndarray:
    """The mean of a folded normal: MAE of a capture whose pixels err by `noise` about its bias."""
    gauss = noise_mm * np.sqrt(2 / np.pi) * np.exp(-(bias_mm**2) / (2 * noise_mm**2))
    return gauss + bias_mm * erf(bias_mm / noise_mm / np.sqrt(2))


@pytest.mark.parametrize("noise_mm", [0.1, 1.0])
@pytest.mark.parametrize(("captures", "least"), [(5, 0.89), (10, 0.92), (20, 0.92)])
def test_the_maes_interval_holds_for_captures_that_differ(captures, least, noise_mm):
    """Captures 0.7 mm apart: 92 to 97 % at ten and more. All errors together are normal, so the
    true MAE has a closed form. Five captures do not know how skewed they are. 4000 trials know a
    share of 95 % to 0.35 %."""
    biases_mm = BETWEEN_MM * np.random.default_rng(0).standard_normal((4000, captures))
    true_mm = np.hypot(BETWEEN_MM, noise_mm) * np.sqrt(2 / np.pi)
    intervals = [METRICS["mae_mm"].interval(values) for values in mae_mm(biases_mm, noise_mm)]
    assert least <= np.mean([low <= true_mm <= high for low, high in intervals]) <= 0.97


def test_figures_without_skewness_have_students_interval():
    """With skewness: tests/hard_cases."""
    values = np.array([0.8, 1.2, 1.0, 0.9, 1.1, np.nan])
    expected = stats.t.interval(0.95, 4, 1.0, stats.sem(values[:5]))
    assert mean_interval(values) == pytest.approx(expected, rel=1e-9)


def test_an_interval_stays_within_what_a_metric_can_be():
    skewed = [0.01, 0.01, 0.02, 0.01, 2.0]
    assert METRICS["mae_mm"].interval(skewed).low >= 0
    assert METRICS["bias_mm"].interval([-1.0, 1.0, -1.1, 1.1, 0.3]).low < 0
    assert METRICS["observed_percent"].interval([99.0, 99.9, 98.0, 99.9, 99.5]).high <= 100
    assert METRICS["observed_percent"].interval([100.0] * 6) is None  # no spread was seen


def test_figures_are_formed_for_each_capture_and_then_averaged():
    """By hand: captures of 36 and 144 pixels, one without any; the pooled figures beside them."""
    quarter, peak_mm = np.zeros((12, 12), bool), np.ones((12, 12))
    quarter[:6, :6], peak_mm[0, 0] = True, 10
    maps = {"a": seen(4.0, quarter), "b": seen(peak_mm), "c": seen(1.0, False)}
    lines = [(c, "x", "truth", "", 0, *f) for c, m in maps.items() for f in figures(m).items()]
    found = main_table(frame(SCORES, lines), PAPER, 0, False).set_index("metric").value
    one_mm = (143 + 10) / 144
    expected = {
        "mae_mm": (4 + one_mm) / 2,
        "max_mm": (4 + 10) / 2,
        "pooled_mae_mm": (4 * 36 + one_mm * 144) / 180,
        "pooled_max_mm": 10,
        "observed_percent": 100 * (1 / 4 + 1 + 0) / 3,
        "n_observed": 180,
    }
    assert {key: found[key] for key in expected} == pytest.approx(expected)


@pytest.mark.parametrize("hands", [1, 3, 10])
def test_the_precisions_interval_holds(hands):
    """Ten repeats of each hand: 94 to 96 %, as 4000 trials know a share of 95 % to 0.35 %; of one
    hand exactly, of several by Welch and Satterthwaite's degrees of freedom."""
    sigma_mm = np.linspace(0.2, 0.4, hands)
    trials = np.random.default_rng(0).standard_normal((4000, hands, 10)) * sigma_mm[:, None]
    intervals = [precision_interval(list(0.3 + 1e-3 * z_mm)) for z_mm in trials]
    assert 0.94 <= np.mean([low <= sigma_mm.mean() <= high for low, high in intervals]) <= 0.96


def test_too_little_has_no_interval():
    assert mean_interval([1.0, 2.0, 3.0, 4.0, np.nan]) is None
    assert precision_interval([]) is None is precision_interval([np.array([0.3, np.nan])])
    # a bootstrap of three draws each of them: the ends are the least and the largest
    three = np.array([1.0, 2.0, 4.0])
    assert median_interval(three) == (1.0, 4.0) and median_interval(three[:2]) is None
