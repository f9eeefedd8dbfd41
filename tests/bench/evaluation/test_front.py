"""Fronts and choices on tables that are small enough to be judged by eye."""

import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from handbench.bench.evaluation.front import HEADROOM, chosen, figures, front
from handbench.bench.evaluation.front import ranked as rank
from handbench.bench.evaluation.metrics import HEADLINE
from tests.refusals import refuse
from tests.strategies import examples

IDS = {"slow": "broadband", "worse": "broadband", "other": "narrowband"}


def table(**methods: tuple[float, float, float]) -> pd.DataFrame:
    """The lines of methods with (error in mm, seconds, right within 2 mm in %), with intervals."""
    metrics = {HEADLINE: 0.2, "seconds": 0.1, "complete_2mm_percent": 0.0}
    lines = [
        (metric, name, value, (1 - part) * value, (1 + part) * value, "truth")
        for name, values in methods.items()
        for (metric, part), value in zip(metrics.items(), values, strict=True)
    ]
    return pd.DataFrame(lines, columns=["metric", "method", "value", "low", "high", "reference"])


NAN = float("nan")
SETTINGS = figures(
    table(
        slow=(0.5, 0.3, 50.0),
        fast=(5.0, 0.02, 50.0),
        worse=(6.0, 0.4, 50.0),
        other=(6.0, 0.4, 50.0),
        unknown=(NAN, 0.01, 50.0),
    )
)


def test_the_front_names_what_dominates_of_all_and_of_one_method():
    ranked = rank(SETTINGS, IDS)
    assert ranked.index.tolist() == ["slow", "fast", "worse", "other"]
    assert front(ranked).index.tolist() == ["fast", "slow"]
    assert ranked.dominated_by.tolist() == ["", "", "slow", "slow"]
    assert ranked.on_own_front.tolist() == [True, True, False, True]


def test_a_setting_that_sees_more_is_not_beaten_by_one_that_sees_less():
    both = rank(figures(table(whole=(2.0, 0.5, 30.0), half=(1.0, 0.1, 15.0))))
    assert both.on_front.all()
    same = rank(figures(table(whole=(2.0, 0.5, 30.0), half=(1.0, 0.1, 30.0))))
    assert front(same).index.tolist() == ["half"]
    wrong = rank(figures(table(right=(2.0, 0.5, 30.0), wrong=(1.0, 0.1, 0.0))))
    assert front(wrong).index.tolist() == ["right"]


FIGURES = st.tuples(*[st.integers(1, 6)] * 2, st.sampled_from([1, 2]))


@examples(40)
@given(st.lists(FIGURES, min_size=1, max_size=12))
def test_every_setting_is_on_the_front_or_dominated_by_one_that_is(settings):
    lines = {f"s{k}": tuple(map(float, values)) for k, values in enumerate(settings)}
    ranked = rank(figures(table(**lines)))
    assert ranked.on_front.any()
    for name, line in ranked.iterrows():
        if line.on_front:
            assert line.dominated_by == ""
            continue
        better = ranked.loc[line.dominated_by]
        mm, s, percent = lines[str(name)]
        assert better.on_front and better.error <= mm and better.seconds <= s
        assert better.share_percent >= percent


@pytest.mark.parametrize(
    ("limits", "name"),
    [
        ({"max_error_mm": 2.0}, "slow"),  # 'near' has 1.9 mm, but up to 2.28 mm
        ({"max_error_mm": 2.3}, "near"),
        ({"max_seconds": 0.34}, "near"),  # 'slow' takes 0.3 s, up to 0.33 s, later a tenth more
        ({"max_error_mm": 6.1, "max_seconds": 1.1 * HEADROOM * 0.3 + 1e-9}, "near"),
    ],
)
def test_methods_are_chosen_by_their_worst(limits, name):
    settings = figures(table(slow=(0.5, 0.3, 50.0), fast=(5.0, 0.02, 50.0), near=(1.9, 0.01, 50.0)))
    assert chosen(settings, **limits) == name
    refuse(lambda: chosen(settings, max_error_mm=0.1), "'slow'")
