"""Metrics: golden values, perfect and shifted predictions, unobserved pixels, precision."""

from __future__ import annotations

import statistics

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from handbench.bench.evaluation.depth_errors import (
    deviation_map,
    error_map,
    strongest_scatterer_z_m,
)
from handbench.bench.evaluation.intervals import precision_mm, relative_precision_percent
from handbench.bench.evaluation.metrics import F_MM, METRICS, figures
from tests.refusals import refuse

NAN = float("nan")


def score(z_m: np.ndarray, reference_z_m: np.ndarray) -> dict[str, float | int | None]:
    """Metrics of one depth map against a reference of its shape, metres, on pixels of 1 mm; NaN:
    not observed, no surface."""
    y_m, x_m = (1e-3 * np.arange(n) for n in z_m.shape)
    return figures(error_map(x_m, y_m, z_m, reference_z_m, met=np.isfinite(reference_z_m)))


depths_m = arrays(np.float64, (4, 5), elements=st.floats(0.2, 0.5) | st.just(NAN))


@pytest.mark.parametrize(
    ("metric", "golden"),
    [
        ("mae_mm", (6.6, 1.7, 1.0, 13.4)),
        ("max_mm", (39.2, 28.8, 32.0, 64.9)),
        ("precision_mm", (3.6, 0.3, None, None)),
        ("relative_accuracy_percent", (None, 99.4, None, None)),
        ("relative_precision_percent", (98.3, 99.99, None, None)),
    ],
)
def test_the_papers_table(metric, golden):
    methods = ("2fsk", "3fsk", "broadband", "narrowband")
    assert tuple(METRICS[metric].paper.get(method) for method in methods) == golden
    if metric == "relative_accuracy_percent":  # 1.7 mm at 0.3 m, to its last digit
        assert round(score(np.full((3, 3), 0.3017), np.full((3, 3), 0.3))[metric], 1) == golden[1]


def plane_m() -> np.ndarray:
    """A plane at 0.3 m that fills the inner part of the grid."""
    z_m = np.full((30, 30), np.nan)
    z_m[5:-5, 5:-5] = 0.3
    return z_m


def test_one_millimetre_is_one_millimetre():
    """Every mean, quantile, maximum and, on a plane, chamfer distance of a constant error is that
    error (float64: 1e-9 mm at 0.3 m); it does not deviate. All points are within 2 mm."""
    values = score(plane_m() + 1e-3, plane_m())
    # the deviation is a difference of squares, known to √(1e-16)·1 mm
    assert values.pop("deviation_mm") == pytest.approx(0, abs=1e-6)
    for key in (key for key, value in values.items() if key.endswith("_mm") and value is not None):
        assert values[key] == pytest.approx(1, abs=1e-9), key
    assert values["f_2mm_percent"] == values["f_5mm_percent"] == 100


def test_a_shift_along_a_slope_is_nearer_than_its_error_along_z():
    """A plane of slope 1 moved by 10 mm along z: 10/√2 mm away. The nearest pixel centre lies
    within 0.71 mm along the slope of the foot of the perpendicular, which adds under 0.04 mm; at
    the plane's edges, 3 % of it, the foot lies outside."""
    axis_m = 1e-3 * np.arange(400)
    slope_m = np.broadcast_to(axis_m, (20, 400)) + 0.3
    m = error_map(axis_m, axis_m[:20], slope_m + 0.01, slope_m, met=np.ones(slope_m.shape, bool))
    assert figures(m)["mae_mm"] == pytest.approx(10, abs=1e-9)
    assert figures(m)["chamfer_mm"] == pytest.approx(10 / np.sqrt(2), abs=0.15)


def test_false_alarms_are_judged_only_where_nothing_can_be():
    """Map everywhere at 0.3 m, surface in the left third, invented surface in the middle one: the
    outline's neighbours and the invention are not judged, and neither is a hole that the surface
    encloses."""
    met, column = np.zeros((12, 30), bool), np.arange(30)
    met[:, :20] = True
    reference_m = np.where(column < 10, 0.3, np.nan) * np.ones((12, 1))
    met[5, 5], reference_m[5, 5] = False, np.nan
    m = error_map(1e-3 * column, 1e-3 * column[:12], np.full((12, 30), 0.3), reference_m, met=met)
    judged = np.isfinite(m.to_reference_m)
    assert judged[:, :10].sum() == 119 and not judged[:, 10:21].any() and judged[:, 21:].all()
    near, far_mm = 119 / 227, 12 * np.arange(12, 21).sum() / 227  # columns from the 9th
    expected = {
        "false_alarm_percent": 100 * 108 / 227,
        "mae_mm": 0,
        "chamfer_to_map_mm": 0,
        "chamfer_to_reference_mm": far_mm,
        "chamfer_mm": far_mm / 2,
        "f_5mm_percent": 100 * 2 * near / (near + 1),
    }
    values = figures(m)
    assert {key: values[key] for key in expected} == pytest.approx(expected, rel=1e-9)


def test_what_is_not_known_is_none():
    """Without the rays nothing is known about what is next to the surface, and without σ nothing
    about the ground truth."""
    z_m, axis_m = plane_m(), 1e-3 * np.arange(30)
    known = error_map(axis_m, axis_m, z_m, z_m, np.zeros_like(z_m), np.isfinite(z_m))
    partial = error_map(axis_m, axis_m, z_m, z_m)
    points = ("chamfer", "f_", "accurate_", "false_alarm", "within_band", "floor")
    beside = {key for key in METRICS if key.startswith(points)}
    assert all(figures(known)[key] is not None for key in beside)
    assert {key for key, value in figures(partial).items() if value is None} == beside


def test_precision_per_pixel_is_the_median_of_the_pixels_seen_in_all_repeats():
    """Deviations of 1, 2 and 3 mm; a fourth pixel that one repeat misses does not count."""
    z_m = 0.3 + 1e-3 * np.array([-1.0, 0, 1])[:, None, None] * np.array([[1.0, 2, 3, 50]])
    z_m[1, 0, 3] = np.nan
    spread = deviation_map(np.arange(4), np.arange(1), z_m)
    np.testing.assert_allclose(spread.error_m, [[1e-3, 2e-3, 3e-3, np.nan]], rtol=1e-9)
    assert np.isnan(deviation_map(np.arange(4), np.arange(1), z_m[:1]).error_m).all()


@given(depths_m, depths_m)
def test_agrees_with_plain_python(z_m, reference_z_m):
    pairs = zip(z_m.flat, reference_z_m.flat, strict=True)
    errors_mm = [1e3 * (z - r) for z, r in pairs if z == z and r == r]
    values = score(z_m, reference_z_m)
    assert values["n_observed"] == len(errors_mm)
    if not errors_mm:
        return
    absolute_mm = sorted(map(abs, errors_mm))
    expected = {
        "mae_mm": statistics.fmean(absolute_mm),
        "max_mm": absolute_mm[-1],
        "rmse_mm": statistics.fmean(e * e for e in errors_mm) ** 0.5,
        "median_mm": statistics.median(absolute_mm),
        "bias_mm": statistics.fmean(errors_mm),
        "observed_percent": 100 * len(errors_mm) / np.isfinite(reference_z_m).sum(),
    }
    assert {key: values[key] for key in expected} == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_seen_is_not_right():
    """A plane of 400 pixels: 100 of them 30 mm off, 100 by 1.5 mm, 100 not seen, 100 right; and 16
    of nothing."""
    z_m, reference_m = plane_m(), plane_m()
    z_m[5:10] += 30e-3
    z_m[10:15] += 1.5e-3
    z_m[15:20] = NAN
    z_m[:4, :4] = 0.3
    values = score(z_m, reference_m)
    for mm, right in zip(F_MM, (100, 200, 200), strict=True):
        accurate, complete = 100 * right / 316, 100 * right / 400
        found = [values[f"{share}_{mm}mm_percent"] for share in ("accurate", "complete", "f")]
        f_score = 2 / (1 / accurate + 1 / complete)
        assert found == pytest.approx([accurate, complete, f_score])


def test_refuses_different_grids():
    refuse(lambda: error_map(np.arange(3), np.arange(2), np.zeros((2, 3)), np.zeros((3, 2))))


def test_strongest_scatterer_is_one_pixel_observed_in_every_repeat():
    """Mean amplitudes of 0.725, 1 (of a pixel that is once unobserved) and 0.85."""
    z_m = np.array([[[0.30, 0.31, 0.33]], [[0.40, NAN, 0.34]]])
    amplitude = np.array([[[0.5, 1.0, 0.9]], [[0.95, 1.0, 0.8]]])
    assert strongest_scatterer_z_m(z_m, amplitude).tolist() == [0.33, 0.34]
    assert np.isnan(strongest_scatterer_z_m(np.full((2, 1, 3), NAN), amplitude)).all()


def test_precision_is_the_mean_of_the_hands_deviations():
    """Deviations of 1 and 2 mm (n − 1); pooling the variances instead would give 1.58 mm. Every
    hand needs two repeats."""
    hands = [np.array([0.299, 0.3, 0.301]), np.array([0.298, 0.3, NAN, 0.302])]
    assert precision_mm(hands) == pytest.approx(1.5, abs=1e-9)
    assert relative_precision_percent(hands) == pytest.approx(99.5, abs=1e-9)
    for few in ([], [*hands, np.array([0.3, NAN])]):
        assert precision_mm(few) is None is relative_precision_percent(few)


def test_the_band_is_of_observed_pixels_alone():
    """Two of three observed pixels within 1.96 mm; what is not observed, known or not, takes no
    part, and one observed pixel that is not known is enough for none."""
    z_m, sigma_m = np.array([[0.301, 0.3019, 0.302, NAN, NAN]]), np.full((1, 5), 1e-3)
    for unknown, percent in ((4, 200 / 3), (0, None)):
        sigma_m[0, unknown] = NAN
        m = error_map(1e-3 * np.arange(5), np.zeros(1), z_m, np.full((1, 5), 0.3), sigma_m)
        assert figures(m)["within_band_percent"] == pytest.approx(percent)


def test_shares_of_a_map_that_saw_nothing_are_zero_and_of_no_surface_unknown():
    """The other figures are None: tests/hard_cases."""
    nothing, plate = np.full((3, 3), NAN), np.full((3, 3), 0.3)
    values, false = score(nothing, plate), score(plate, nothing)
    zero = ("n_observed", "observed_percent", "f_2mm_percent", "complete_2mm_percent")
    assert [values[key] for key in zero] == [0] * 4
    assert false["false_alarm_percent"] == 100 and false["observed_percent"] is None
