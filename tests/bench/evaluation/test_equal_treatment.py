"""Equal treatment: common pixels, risk–coverage curves and their area, against loops written out
and closed forms."""

import numpy as np
import pytest

from handbench.bench.evaluation.equal_treatment import SHARES_PERCENT, risk_mm, treated_figures
from handbench.bench.evaluation.metrics import over_frames
from handbench.bench.evaluation.treatments import TreatedDepths

NAN = np.nan
REFERENCE_M = np.array([[0.3, 0.3, 0.3], [0.3, 0.3, NAN]])


def treated(
    z_mm: list[list[float]], db: list[list[float]], open_mm: list[list[float]] | None = None
) -> TreatedDepths:
    """A map in millimetres behind the reference plane."""
    z_m, open_m = (0.3 + 1e-3 * np.array(values, float) for values in (z_mm, open_mm or z_mm))
    return TreatedDepths(z_m, open_m, np.array(db, float))


FIRST = treated([[1, 2, NAN], [4, 8, 9]], [[0, -5, -9], [-3, -1, 0]], [[1, 2, 16], [4, 8, 9]])
SECOND = treated([[-3, NAN, 5], [7, 1, NAN]], [[-4, -3, -2], [-1, 0, 0]])


def test_errors_stand_on_the_pixels_that_all_see():
    a, b = (of.figures for of in treated_figures({"a": FIRST, "b": SECOND}, REFERENCE_M).values())
    assert a["mae_mm"] == pytest.approx((1 + 4 + 8) / 3)
    assert (b["mae_mm"], b["bias_mm"]) == pytest.approx(((3 + 7 + 1) / 3, (-3 + 7 + 1) / 3))
    assert b["max_mm"] == pytest.approx(7)
    assert a["common_percent"] == b["common_percent"] == pytest.approx(60)


def test_the_curve_takes_the_strongest_pixels_first_whatever_the_threshold():
    first, second = (
        np.cumsum(e) / np.arange(1, len(e) + 1) for e in ([1, 8, 4, 2, 16], [1, 7, 5, 3])
    )
    np.testing.assert_allclose(risk_mm(FIRST, REFERENCE_M), first)
    a, b = treated_figures({"a": FIRST, "b": SECOND}, REFERENCE_M).values()
    assert a.figures["aurc_to_percent"] == pytest.approx(80)  # both reach four of five pixels
    assert a.figures["aurc_mm"] == pytest.approx(first[:4].mean())
    assert b.figures["aurc_mm"] == pytest.approx(second.mean())
    at = dict(zip(SHARES_PERCENT.tolist(), b.curve_mm, strict=True))
    assert at[20.0] == pytest.approx(1) and at[80.0] == pytest.approx(4) and np.isnan(at[100.0])


def test_nothing_in_common_and_no_surface_are_not_figures():
    empty = treated([[NAN] * 3] * 2, [[0] * 3] * 2)
    found = treated_figures({"a": FIRST, "b": empty}, REFERENCE_M)["a"].figures
    assert found["mae_mm"] is found["aurc_mm"] is None and found["common_percent"] == 0
    without = treated_figures({"a": FIRST}, np.full((2, 3), NAN))["a"]
    assert without.figures["common_percent"] is None and np.isnan(without.curve_mm).all()


def test_frames_have_a_mean_a_deviation_and_a_largest():
    found = over_frames(np.array([2.0, 7.0]), np.array([3.0, 7.0]))
    expected = {"mae": 4.5, "mae_deviation": 12.5**0.5, "max": 5, "max_deviation": 8**0.5}
    expected["largest"] = 7
    assert found == pytest.approx({f"frames_{key}_mm": mm for key, mm in expected.items()})
    assert over_frames(np.ones(1), np.ones(1)) == over_frames(np.ones(2), [2.0, NAN]) == {}
