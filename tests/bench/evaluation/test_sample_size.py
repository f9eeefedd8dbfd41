"""How many captures: published tables and variance components, powers found by drawing,
refusals."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from handbench.bench.evaluation.sample_size import (
    Components,
    captures_needed,
    components,
    hands_needed,
    paired_power,
    variance_facts,
    welch_power,
)
from handbench.support.errors import HandbenchError


# Shrout & Fleiss (1979), Psychol. Bull. 86, table 2: six targets rated by four judges; their table
# 3: mean squares of 11.24 between targets and 1.02 of the residual.
@pytest.mark.parametrize(("effect", "captures"), [(0.2, 199), (0.5, 34), (0.8, 15)])
def test_a_paired_test_takes_as_many_as_published(effect: float, captures: int) -> None:
    """Of dz at 5 % two-sided and a power of 0.8, as G*Power 3 and statsmodels' TTestPower (33.37
    for 0.5) have it."""
    assert captures_needed(lambda n: paired_power(effect, 1.0, n), 0.8) == captures


def test_two_groups_have_the_published_power() -> None:
    """R's power.t.test(n = 20, delta = 1, sd = 1), the example of its help page."""
    assert welch_power(1.0, (1.0, 1.0), 20) == pytest.approx(0.8689528, abs=1e-5)


def test_hands_of_a_difference() -> None:
    assert hands_needed(-0.5, [1.0]) == hands_needed(0.5, [1.0]) == 34  # as published, above
    assert hands_needed(0.5, [1.0, 1.0]) == 64  # Cohen (1988), table 2.4.1
    assert hands_needed(0.5, [1.0], 0.01) > 34
    assert hands_needed(30.0, [1.0]) == hands_needed(0.1, [0.0]) == 5  # fewer are not tested
    assert hands_needed(1e-6, [1.0]) is hands_needed(0.0, [0.0]) is None


def test_too_few_captures_are_refused_in_one_line() -> None:
    with pytest.raises(HandbenchError, match="there are 2 captures and 2 methods"):
        components(np.array([[1.0, 1], [2, 1], [np.nan, 1]]))
    with pytest.raises(HandbenchError, match="and 1 methods"):
        components(np.ones((5, 1)))


@pytest.mark.parametrize("first", [1, 3, 100_000, 100_001])
def test_captures_are_sought_from_two_to_a_hundred_thousand(first: int) -> None:
    found = captures_needed(lambda n: float(n >= first), 0.8)
    assert found == (max(first, 2) if first <= 100_000 else None)


def test_components_by_hand() -> None:
    """Captures at 0.5, 2.5 and 4.5 (a variance of 4), methods 1 apart on all of them, repeats 1
    above and below: mean squares of 4·4 between captures, 0 of the interaction and 12/6 of the
    residual."""
    cells = np.array([[0.0, 1], [2, 3], [4, 5]])
    found = components(cells[..., None] + np.array([-1.0, 1.0]))
    assert found == pytest.approx(Components(2.0, 0.0, np.sqrt(2), 3))


def test_without_scatter_every_difference_is_shown_by_the_fewest() -> None:
    assert paired_power(0.1, 0.0, 5) == welch_power(0.1, (0.0, 0.0), 5) == 1.0
    # 2236 and 38 standard errors, of which scipy's noncentral t is NaN
    assert paired_power(1.0, 1e-3, 5) == paired_power(12.0, 1.0, 10) == 1.0


def test_welchs_power_is_what_drawing_shows() -> None:
    rng, spreads, n, draws = np.random.default_rng(16), (2.0, 0.5), 16, 20_000
    a, b = (rng.normal(*group, (draws, n)) for group in ((0.0, spreads[0]), (1.5, spreads[1])))
    shown = (stats.ttest_ind(a, b, axis=1, equal_var=False).pvalue < 0.05).mean()
    # its degrees of freedom vary, too
    assert shown == pytest.approx(welch_power(1.5, spreads, n), abs=0.015)


def test_components_of_a_published_table() -> None:
    """Shrout & Fleiss (1979), Psychol. Bull. 86, table 2, six targets rated by four judges, and 3:
    mean squares of 11.24 between targets and 1.02 of the residual."""
    judges = {"a": [9, 6, 8, 7, 10, 6], "b": [2, 1, 4, 1, 5, 2], "c": [5, 3, 6, 2, 6, 4]}
    judges["d"] = [8, 2, 8, 6, 9, 7]
    found = variance_facts({name: np.array(of, float) for name, of in judges.items()})
    assert found["capture"] ** 2 == pytest.approx((11.24 - 1.02) / 4, abs=0.005)
    assert found["interaction"] ** 2 == pytest.approx(1.02, abs=0.005) and found["captures"] == 6
