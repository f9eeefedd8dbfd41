"""Metrics: golden values, perfect and shifted predictions, unobserved pixels, precision."""

from __future__ import annotations

import statistics

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from bench.metrics import (
    METRICS,
    definitions,
    error_map,
    pool,
    precision,
    score,
    strongest_scatterer_z_m,
)
from bench.paper import PAPER, TITLES
from radar.errors import HandbenchError

NAN = float("nan")
depths_m = arrays(np.float64, (4, 5), elements=st.floats(0.2, 0.5) | st.just(NAN))


def surface_m() -> np.ndarray:
    x, y = np.meshgrid(np.linspace(-1, 1, 30), np.linspace(-1, 1, 40))
    return np.where(x**2 + y**2 < 0.8, 0.3 + 0.02 * x * y, np.nan)


@pytest.mark.parametrize(("metric", "golden"), [
    ("mae_mm", (6.6, 1.7, 1.0, 13.4)),
    ("max_mm", (39.2, 28.8, 32.0, 64.9)),
    ("precision_mm", (3.6, 0.3, None, None)),
    ("relative_accuracy_percent", (None, 99.4, None, None)),
    ("relative_precision_percent", (98.3, 99.99, None, None)),
])
def test_the_papers_table(metric, golden):
    assert tuple(PAPER.get((metric, method)) for method in TITLES) == golden


def test_relative_accuracy_is_the_papers():
    """1.7 mm at 0.3 m are the paper's 99.4 %, to its last digit."""
    values = score(np.full((3, 3), 0.3017), np.full((3, 3), 0.3))
    assert round(values["relative_accuracy_percent"], 1) == PAPER["relative_accuracy_percent", "3fsk"]


def test_truth_scored_as_prediction_is_perfect():
    values = score(surface_m(), surface_m())
    assert values["n_observed"] == np.isfinite(surface_m()).sum()
    assert values["completeness_percent"] == values["relative_accuracy_percent"] == 100
    assert all(values[key] == 0 for key in values if key.endswith("_mm"))


def test_one_millimetre_is_one_millimetre():
    """Every mean, quantile and maximum of a constant error is that error (float64: 1e-9 mm at 0.3 m)."""
    values = score(surface_m() + 1e-3, surface_m())
    for key in (key for key in values if key.endswith("_mm")):
        assert values[key] == pytest.approx(1, abs=1e-9)
    assert score(surface_m() - 1e-3, surface_m())["bias_mm"] == pytest.approx(-1, abs=1e-9)


@given(depths_m, depths_m)
def test_agrees_with_plain_python(z_m, reference_z_m):
    errors_mm = [1e3 * (z - r) for z, r in zip(z_m.flat, reference_z_m.flat, strict=True) if z == z and r == r]
    values = score(z_m, reference_z_m)
    assert values["n_observed"] == len(errors_mm)
    if not errors_mm:
        assert values["mae_mm"] is values["max_mm"] is values["relative_accuracy_percent"] is None
        return
    absolute_mm = sorted(map(abs, errors_mm))
    expected = {
        "mae_mm": statistics.fmean(absolute_mm),
        "max_mm": absolute_mm[-1],
        "rmse_mm": statistics.fmean(e * e for e in errors_mm) ** 0.5,
        "median_mm": statistics.median(absolute_mm),
        "bias_mm": statistics.fmean(errors_mm),
        "completeness_percent": 100 * len(errors_mm) / np.isfinite(reference_z_m).sum(),
    }
    assert {key: values[key] for key in expected} == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_nothing_observed_is_none_not_zero():
    values = score(np.full((2, 2), NAN), np.full((2, 2), 0.3))
    assert values["n_observed"] == 0 and values["completeness_percent"] == 0
    others = set(values) - {"n_observed", "completeness_percent"}
    assert others and all(values[key] is None for key in others)


def test_without_a_reference_there_is_no_completeness():
    assert score(np.full((2, 2), 0.3), np.full((2, 2), NAN))["completeness_percent"] is None
    assert pool([])["completeness_percent"] is None


def test_infinite_depths_are_unobserved():
    values = score(np.array([[0.301, np.inf]]), np.array([[0.3, 0.3]]))
    assert values["n_observed"] == 1 and values["max_mm"] == pytest.approx(1, abs=1e-9)


def test_pools_pixels_not_means():
    """Three pixels of 1 mm and one of 9 mm make 3 mm; the mean of the captures' means would be 5 mm."""
    many = error_map(np.arange(3), np.arange(1), np.full((1, 3), 0.301), np.full((1, 3), 0.3))
    one = error_map(np.arange(1), np.arange(1), np.full((1, 1), 0.309), np.full((1, 1), 0.3))
    assert pool([many, one])["mae_mm"] == pytest.approx(3, abs=1e-9)


def test_refuses_different_grids():
    with pytest.raises(HandbenchError, match="do not lie on one grid"):
        error_map(np.arange(3), np.arange(2), np.zeros((2, 3)), np.zeros((3, 2)))


def test_strongest_scatterer_is_one_pixel_observed_in_every_repeat():
    z_m = np.array([[[0.30, 0.31, 0.33]], [[0.40, NAN, 0.34]]])
    amplitude = np.array([[[0.5, 1.0, 0.9]], [[0.95, 1.0, 0.8]]])  # means 0.725, 1 (once unobserved), 0.85
    assert strongest_scatterer_z_m(z_m, amplitude).tolist() == [0.33, 0.34]
    assert np.isnan(strongest_scatterer_z_m(np.full((2, 1, 3), NAN), amplitude)).all()


def test_precision_is_the_mean_of_the_hands_deviations():
    """Deviations of 1 and 2 mm (n − 1); pooling the variances instead would give 1.58 mm."""
    values = precision([np.array([0.299, 0.3, 0.301]), np.array([0.298, 0.3, NAN, 0.302])])
    assert values["precision_mm"] == pytest.approx(1.5, abs=1e-9)
    assert values["relative_precision_percent"] == pytest.approx(99.5, abs=1e-9)


@pytest.mark.parametrize("hands", [[], [np.array([0.3])], [np.array([0.3, 0.31]), np.array([0.3, NAN])]])
def test_precision_needs_two_repeats_of_every_hand(hands):
    assert precision(hands) == {"precision_mm": None, "relative_precision_percent": None}


def test_every_figure_is_defined_with_its_unit():
    produced = set(score(surface_m(), surface_m())) | set(precision([]))
    assert produced | {"seconds", "floor_mm"} == set(METRICS)
    suffixes = {"mm": "_mm", "%": "_percent", "s": "seconds", "pixels": "n_observed"}
    assert all(key.endswith(suffixes[metric.unit]) for key, metric in METRICS.items())
    assert "mm" in definitions(["mae_mm"])["mae_mm"]
