"""How many captures: published tables and variance components, powers found by drawing,
refusals."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
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

DRAWS = 20_000
# Shrout & Fleiss (1979), Psychol. Bull. 86, table 2: six targets rated by four judges; their table
# 3: mean squares of 11.24 between targets and 1.02 of the residual.
RATINGS = np.array(
    [[9, 2, 5, 8], [6, 1, 3, 2], [8, 4, 6, 8], [7, 1, 2, 6], [10, 5, 6, 9], [6, 2, 4, 7]], float
)


@pytest.mark.parametrize(("effect", "captures"), [(0.2, 199), (0.5, 34), (0.8, 15)])
def test_a_paired_test_takes_as_many_as_published(effect: float, captures: int) -> None:
    """Of dz at 5 % two-sided and a power of 0.8, as G*Power 3 and statsmodels' TTestPower (33.37
    for 0.5) have it."""
    assert captures_needed(lambda n: paired_power(effect, 1.0, n), 0.8) == captures


@pytest.mark.parametrize(("effect", "captures"), [(0.5, 64), (0.8, 26)])
def test_two_groups_take_as_many_as_in_cohens_table(effect: float, captures: int) -> None:
    """Cohen (1988), Statistical power analysis, table 2.4.1: each of two groups at 5 % two-sided
    and a power of 0.8."""
    assert captures_needed(partial(welch_power, effect, (1.0, 1.0)), 0.8) == captures
    # R's power.t.test(n = 20, delta = 1, sd = 1), the example of its help page.
    assert welch_power(1.0, (1.0, 1.0), 20) == pytest.approx(0.8689528, abs=1e-5)


@pytest.mark.parametrize(
    ("effect", "spread", "n"), [(0.2, 0.16, 6), (0.5, 1.0, 12), (1.0, 0.7, 5), (0.0, 1.0, 8)]
)
def test_the_paired_power_is_what_drawing_shows(effect: float, spread: float, n: int) -> None:
    a = np.random.default_rng(n).normal(5.0, 3.0, (DRAWS, n))
    b = a + np.random.default_rng(n + 1).normal(effect, spread, (DRAWS, n))
    shown = (stats.ttest_rel(a, b, axis=1).pvalue < 0.05).mean()
    assert shown == pytest.approx(paired_power(effect, spread, n), abs=4 * np.sqrt(0.25 / DRAWS))


@pytest.mark.parametrize(
    ("effect", "spreads", "n"),
    [(1.0, (1.0, 1.0), 10), (1.5, (2.0, 0.5), 16), (0.6, (0.4, 0.8), 20)],
)
def test_welchs_power_is_what_drawing_shows(
    effect: float, spreads: tuple[float, float], n: int
) -> None:
    rng = np.random.default_rng(n)
    a, b = rng.normal(0.0, spreads[0], (DRAWS, n)), rng.normal(effect, spreads[1], (DRAWS, n))
    shown = (stats.ttest_ind(a, b, axis=1, equal_var=False).pvalue < 0.05).mean()
    assert shown == pytest.approx(
        welch_power(effect, spreads, n), abs=0.015
    )  # its degrees of freedom vary, too


def test_components_of_a_published_table() -> None:
    found = components(RATINGS)
    assert found.capture**2 == pytest.approx((11.24 - 1.02) / 4, abs=0.005)
    assert found.interaction**2 == pytest.approx(1.02, abs=0.005)
    assert np.isnan(found.residual) and found.captures == 6
    facts = {"capture": found.capture, "interaction": found.interaction, "captures": 6}
    assert variance_facts({str(judge): RATINGS[:, judge] for judge in range(4)}) == pytest.approx(
        facts
    )
    assert variance_facts({"a": np.ones(2), "b": np.ones(2)}) == {}


def test_components_are_those_that_were_drawn() -> None:
    rng, (n, k, r) = np.random.default_rng(3), (400, 4, 3)
    figures = (
        5
        + np.arange(k)[:, None]
        + 0.9 * rng.normal(size=(n, 1, 1))
        + 0.5 * rng.normal(size=(n, k, 1))
    )
    found = components(figures + 0.3 * rng.normal(size=(n, k, r)))
    assert found == pytest.approx(Components(0.9, 0.5, 0.3, n), rel=0.1)
    without = components((figures + 0.3 * rng.normal(size=(n, k, r)))[:, :, 0])
    assert without.interaction == pytest.approx(
        np.hypot(0.5, 0.3), rel=0.1
    )  # one frame: the repeats' scatter is in it


@given(st.floats(0.05, 5), st.floats(0.05, 0.95))
def test_the_fewest_are_enough_and_one_less_is_not(effect: float, power: float) -> None:
    found = captures_needed(lambda n: paired_power(effect, 1.0, n), power)
    assert found is not None and paired_power(effect, 1.0, found) >= power
    assert found == 2 or paired_power(effect, 1.0, found - 1) < power


def test_hands_of_a_difference() -> None:
    assert hands_needed(-0.5, [1.0]) == hands_needed(0.5, [1.0]) == 34  # as published, above
    assert hands_needed(0.5, [1.0, 1.0]) == 64
    assert hands_needed(0.5, [1.0], 0.01) > 34
    assert hands_needed(30.0, [1.0]) == hands_needed(0.1, [0.0]) == 5  # fewer are not tested
    assert hands_needed(1e-6, [1.0]) is hands_needed(0.0, [0.0]) is None


def test_too_few_captures_are_refused_in_one_line() -> None:
    with pytest.raises(HandbenchError, match=r"^variance components: 2 captures of 2 methods"):
        components(np.array([[1.0, 1], [2, 1], [np.nan, 1]]))
    with pytest.raises(HandbenchError, match="of 1 methods"):
        components(np.ones((5, 1)))


@pytest.mark.parametrize(
    ("first", "expected"), [(1, 2), (3, 3), (99_999, 99_999), (100_000, 100_000), (100_001, None)]
)
def test_captures_are_sought_from_two_to_a_hundred_thousand(
    first: int, expected: int | None
) -> None:
    assert captures_needed(lambda n: float(n >= first), 0.8) == expected


def test_components_by_hand() -> None:
    """Captures at 0.5, 2.5 and 4.5 (a variance of 4), methods 1 apart on all of them, repeats 1
    above and below: mean squares of 4·4 between captures, 0 of the interaction and 12/6 of the
    residual."""
    cells = np.array([[0.0, 1], [2, 3], [4, 5]])
    assert components(cells) == pytest.approx(Components(2.0, 0.0, np.nan, 3), nan_ok=True)
    found = components(cells[..., None] + np.array([-1.0, 1.0]))
    assert found == pytest.approx(Components(2.0, 0.0, np.sqrt(2), 3))
    crossed = components(
        np.array([[0.0, 2], [2, 2], [4, 2]])
    )  # means 1, 2, 3; what is left: ∓1, 0, ±1
    assert (crossed.capture, crossed.interaction) == pytest.approx((0.0, np.sqrt(2)))


def test_without_scatter_every_difference_is_shown_by_the_fewest() -> None:
    assert paired_power(0.1, 0.0, 5) == welch_power(0.1, (0.0, 0.0), 5) == 1.0
    assert (
        paired_power(1.0, 1e-3, 5) == 1.0
    )  # √5·1000 standard errors, of which scipy's noncentral t is NaN
    assert welch_power(0.0, (1.0, 1.0), 8) == pytest.approx(
        0.05, abs=1e-9
    )  # no effect: as often as by chance
