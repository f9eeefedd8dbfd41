"""Equal treatment: common pixels, risk–coverage curves and their area, against loops written out
and closed forms."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from handbench.bench.evaluation.equal_treatment import SHARES_PERCENT, risk_mm, treated_figures
from handbench.bench.evaluation.metrics import over_frames
from handbench.bench.evaluation.treatments import SMOOTHING, TreatedDepths
from handbench.bench.results.about import TREATMENTS
from handbench.reports.tables import blocks

NAN = np.nan
REFERENCE_M = np.array([[0.3, 0.3, 0.3], [0.3, 0.3, NAN]])


def alike(
    z_mm: list[list[float]], db: list[list[float]], open_mm: list[list[float]] | None = None
) -> TreatedDepths:
    """A map in millimetres behind the reference plane."""
    z_m, open_m = (0.3 + 1e-3 * np.array(values, float) for values in (z_mm, open_mm or z_mm))
    return TreatedDepths(z_m, open_m, np.array(db, float))


FIRST = alike([[1, 2, NAN], [4, 8, 9]], [[0, -5, -9], [-3, -1, 0]], [[1, 2, 16], [4, 8, 9]])
SECOND = alike([[-3, NAN, 5], [7, 1, NAN]], [[-4, -3, -2], [-1, 0, 0]])


def test_errors_stand_on_the_pixels_that_all_see():
    found = treated_figures({"a": FIRST, "b": SECOND}, REFERENCE_M)
    assert found["a"].figures["mae_mm"] == pytest.approx((1 + 4 + 8) / 3)
    assert found["b"].figures["mae_mm"] == pytest.approx((3 + 7 + 1) / 3)
    assert found["b"].figures["max_mm"] == pytest.approx(7)
    assert found["b"].figures["bias_mm"] == pytest.approx((-3 + 7 + 1) / 3)
    assert [of.figures["common_percent"] for of in found.values()] == [pytest.approx(60)] * 2


def test_the_curve_takes_the_strongest_pixels_first_whatever_the_threshold():
    np.testing.assert_allclose(
        risk_mm(FIRST, REFERENCE_M), np.cumsum([1, 8, 4, 2, 16]) / np.arange(1, 6)
    )
    np.testing.assert_allclose(
        risk_mm(SECOND, REFERENCE_M), np.cumsum([1, 7, 5, 3]) / np.arange(1, 5)
    )
    found = treated_figures(
        {"a": FIRST, "b": SECOND}, REFERENCE_M
    )  # both reach four of five pixels
    assert found["a"].figures["aurc_to_percent"] == pytest.approx(80)
    assert found["a"].figures["aurc_mm"] == pytest.approx(
        np.mean(np.cumsum([1, 8, 4, 2]) / np.arange(1, 5))
    )
    assert found["b"].figures["aurc_mm"] == pytest.approx(
        np.mean(np.cumsum([1, 7, 5, 3]) / np.arange(1, 5))
    )
    at = dict(zip(SHARES_PERCENT.tolist(), found["b"].curve_mm, strict=True))
    assert at[20.0] == pytest.approx(1) and at[80.0] == pytest.approx(4) and np.isnan(at[100.0])


@given(st.integers(0, 2**31))
def test_amplitudes_that_say_nothing_give_the_mean_error_and_a_perfect_order_its_integral(seed):
    """Errors 1 … n mm on n pixels: sorted by amplitude, the mean of the k smallest is (k + 1)/2, so
    that the area over the width is (n + 3)/4; in the worst order it is n + 1 − (n + 3)/4."""
    n, rng = 40, np.random.default_rng(seed)
    error_mm = rng.permutation(np.arange(1.0, n + 1)).reshape(5, 8)
    plane_m = np.full((5, 8), 0.3)
    best, worst = (
        TreatedDepths(plane_m + 1e-3 * error_mm, plane_m + 1e-3 * error_mm, s * error_mm)
        for s in (-1, 1)
    )
    found = treated_figures({"best": best, "worst": worst}, plane_m)
    assert found["best"].figures["aurc_mm"] == pytest.approx((n + 3) / 4)
    assert found["worst"].figures["aurc_mm"] == pytest.approx(n + 1 - (n + 3) / 4)
    assert (
        found["best"].figures["mae_mm"]
        == found["worst"].figures["mae_mm"]
        == pytest.approx((n + 1) / 2)
    )


def test_nothing_in_common_and_no_surface_are_not_figures():
    empty = alike([[NAN] * 3] * 2, [[0] * 3] * 2)
    found = treated_figures({"a": FIRST, "b": empty}, REFERENCE_M)
    assert found["a"].figures["mae_mm"] is None and found["a"].figures["aurc_mm"] is None
    assert found["a"].figures["common_percent"] == 0
    without = treated_figures({"a": FIRST}, np.full((2, 3), NAN))
    assert without["a"].figures["common_percent"] is None and np.isnan(without["a"].curve_mm).all()


def test_every_treatment_has_words():
    assert {"", *TREATMENTS} == {"", *SMOOTHING}
    assert set(blocks.TREATMENTS) == set(SMOOTHING)
    assert all(
        f"{size} × {size}" in blocks.TREATMENTS[name]
        for name, size in SMOOTHING.items()
        if size > 1
    )


def test_frames_have_a_mean_a_deviation_and_a_largest():
    found = over_frames(np.array([2.0, 7.0]), np.array([3.0, 7.0]))
    assert found["frames_mae_mm"] == pytest.approx(4.5) and found["frames_max_mm"] == pytest.approx(
        5
    )
    assert found["frames_mae_deviation_mm"] == pytest.approx(np.std([2, 7], ddof=1))
    assert found["frames_max_deviation_mm"] == pytest.approx(np.std([3, 7], ddof=1))
    assert found["frames_largest_mm"] == pytest.approx(7)
    one, unseen = np.array([2.0]), np.array([2.0, 7.0, NAN])
    assert over_frames(one, one) == over_frames(unseen, unseen) == {}


def test_the_curve_is_told_at_every_half_per_cent_that_is_reached():
    """On 200 pixels a half per cent is one more pixel, from the first to the last; 150 are
    reached."""
    reference_m, rng = np.full((10, 20), 0.3), np.random.default_rng(0)
    error_mm = rng.uniform(0, 5, 200)
    z_m = np.where(np.arange(200) < 150, 0.3 + 1e-3 * error_mm, NAN).reshape(10, 20)
    found = treated_figures(
        {"a": TreatedDepths(z_m, z_m, -np.arange(200.0).reshape(10, 20))}, reference_m
    )["a"]
    assert (SHARES_PERCENT[0], SHARES_PERCENT[-1], len(SHARES_PERCENT)) == (0.5, 100.0, 200)
    np.testing.assert_allclose(
        found.curve_mm[:150], [error_mm[:k].mean() for k in range(1, 151)], rtol=1e-9
    )
    assert np.isnan(found.curve_mm[150:]).all()
    assert (found.figures["aurc_to_percent"], found.figures["common_percent"]) == (75, 75)
