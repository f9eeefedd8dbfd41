"""Equal treatment: figures on common pixels, by hand."""

import numpy as np
import pytest

from handbench.bench.evaluation.paired import taking_part, treated_figures

NAN = np.nan
REFERENCE_M = np.array([[0.3, 0.3, 0.3], [0.3, 0.3, NAN]])
FIRST = 0.3 + 1e-3 * np.array([[1, 2, NAN], [4, 8, 9]])
SECOND = 0.3 + 1e-3 * np.array([[-3, NAN, 5], [7, 1, NAN]])


def test_errors_stand_on_the_pixels_that_all_see():
    a, b = treated_figures({"a": FIRST, "b": SECOND}, REFERENCE_M).values()
    assert a["mae_mm"] == pytest.approx((1 + 4 + 8) / 3)
    assert (b["mae_mm"], b["bias_mm"]) == pytest.approx(((3 + 7 + 1) / 3, (-3 + 7 + 1) / 3))
    assert b["max_mm"] == pytest.approx(7)
    assert a["common_percent"] == b["common_percent"] == pytest.approx(60)


@pytest.mark.parametrize(("pixels", "takes_part"), [(0, False), (3, False), (4, True)])
def test_a_map_of_under_one_percent_does_not_decide_the_others_common_pixels(pixels, takes_part):
    few = np.where(np.arange(400) < pixels, 0.301, NAN).reshape(20, 20)
    assert ("few" in taking_part({"few": few}, np.full((20, 20), 0.3))) == takes_part


def test_nothing_in_common_and_no_surface_are_not_figures():
    found = treated_figures({"a": FIRST, "b": np.full((2, 3), NAN)}, REFERENCE_M)["a"]
    assert found["mae_mm"] is None and found["common_percent"] == 0
    assert treated_figures({"a": FIRST}, np.full((2, 3), NAN))["a"]["common_percent"] is None
