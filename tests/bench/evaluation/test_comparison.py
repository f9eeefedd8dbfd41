"""Comparisons: known differences, no false ones, Holm's correction, the sentence and what stands
out."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from handbench.bench.evaluation.paired import (
    amount_text,
    amounts_text,
    compare,
    f_test,
    holm_corrected,
    paired_test,
    welch_test,
)
from handbench.bench.evaluation.tables import COMPARISONS, frame, write
from handbench.bench.results.result_folder import best, shown
from handbench.support.errors import HandbenchError

TITLES = {"2fsk": "2-FSK", "3fsk": "3-FSK"}


def speckle(seed: int, captures: int = 6) -> np.ndarray:
    return 1 + 0.1 * np.random.default_rng(seed).normal(size=captures)


def test_identical_methods_do_not_differ():
    figures = {"2fsk": speckle(0), "3fsk": speckle(0)}
    lines = compare(figures, "truth", titles=TITLES)
    [line] = lines.itertuples()
    assert (line.difference, line.low, line.high, line.p_corrected) == (0, 0, 0, 1) and np.isnan(
        line.effect
    )
    assert (
        line.sentence
        == "no difference shown between 2-FSK and 3-FSK in MAE: 0.000 mm [0.000, 0.000]"
    )
    assert best(lines, "mae_mm", "truth") == ("2fsk", "3fsk")


def test_a_constant_shift_is_known_exactly():
    """What both methods share cancels, so nothing is left to doubt (float64: 1e-9 mm)."""
    lines = compare({"2fsk": speckle(0) + 1, "3fsk": speckle(0)}, "truth", titles=TITLES)
    [line] = lines.itertuples()
    assert (line.better, line.worse, line.p_corrected) == (
        "3fsk",
        "2fsk",
        pytest.approx(0, abs=1e-12),
    )
    assert (line.difference, line.low, line.high) == pytest.approx((1, 1, 1), abs=1e-9)
    assert line.sentence == "3-FSK is better than 2-FSK by 1.0 mm [1.0, 1.0] (MAE)"
    assert line.n_captures == 6 and best(lines, "mae_mm", "truth") == ("3fsk",)


def test_six_captures_have_students_paired_test():
    one, other = speckle(1), speckle(2) + 0.05
    [line] = compare({"a": one, "b": other}, "truth").itertuples()
    expected = stats.ttest_rel(one, other)
    assert line.p_corrected == pytest.approx(expected.pvalue, rel=1e-9)
    assert line.effect == pytest.approx(
        abs((other - one).mean()) / (other - one).std(ddof=1), rel=1e-9
    )
    assert line.difference == pytest.approx(abs(other.mean() - one.mean()))
    assert line.low <= line.difference <= line.high


def test_two_samples_have_welchs_test():
    one, other = speckle(1, 7), speckle(2, 9) + 0.05
    expected = stats.ttest_ind(other, one, equal_var=False)
    found = welch_test(one, other)
    assert found.p == pytest.approx(expected.pvalue, rel=1e-9)
    assert (found.low, found.high) == pytest.approx(
        tuple(expected.confidence_interval(0.95)), rel=1e-9
    )
    assert np.isnan(welch_test(one[:4], other).p) and welch_test(one[:4], other).difference > 0


def false_positives(methods: int, trials: int) -> int:
    """Trials in which one of `methods` equal methods is shown to be better than another. Each is
    better on some captures and worse on others: offsets of method × capture, beside what a capture
    does to all."""
    found = 0
    for trial in range(trials):
        rng = np.random.default_rng(trial)
        shared = 2 + 0.7 * rng.normal(size=10)
        figures = {f"m{i}": shared + 0.5 * rng.normal(size=10) for i in range(methods)}
        found += bool(shown(compare(figures, "truth")).any())
    return found


def test_differences_are_found_falsely_as_often_as_promised():
    """5 % of 400 seeded trials, between the binomial's 0.1 % and 99.9 %, whatever method × capture
    adds."""
    low, high = stats.binom.ppf([0.001, 0.999], 400, 0.05)
    assert low <= false_positives(2, 400) <= high


def test_many_pairs_find_no_more_false_differences_than_one():
    """Six pairs of four methods: Holm keeps 5 % for all of them together, and loses some to what
    the pairs share."""
    assert false_positives(4, 100) <= stats.binom.ppf(0.999, 100, 0.05)


def test_holm_by_hand():
    """0.01·4, 0.02·3, 0.03·2 and 0.04·1, never falling: 0.04, 0.06, 0.06, 0.06, as in statsmodels'
    multipletests."""
    assert holm_corrected([0.04, 0.01, 0.03, 0.02]) == pytest.approx(
        [0.06, 0.04, 0.06, 0.06], rel=1e-12
    )
    assert holm_corrected([0.5, np.nan, 0.9, 0.001]) == pytest.approx(
        [1, np.nan, 1, 0.003], rel=1e-12, nan_ok=True
    )
    assert holm_corrected([]) == []


def test_more_of_a_share_is_better():
    lines = compare(
        {"holed": 90 * speckle(0), "whole": 95 * speckle(0)}, "truth", "observed_percent"
    )
    [line] = lines.itertuples()
    assert (line.better, line.worse, line.unit) == ("whole", "holed", "%")
    assert line.difference == pytest.approx(5 * speckle(0).mean()) and line.low > 0
    assert "whole is better than holed by 5.0 percentage points" in line.sentence


def test_what_cannot_be_tested_says_so():
    """Four captures: a difference on these, no interval, no p, and no method stands out."""
    lines = compare(
        {"a": speckle(0, 4), "b": speckle(0, 4) + 0.5, "c": np.full(4, np.nan)}, "truth"
    )
    assert (
        len(lines) == 1
        and lines[["p_corrected", "low"]].isna().all(axis=None)
        and not shown(lines).any()
    )
    assert (
        lines.sentence[0]
        == "a is ahead of b by 0.50 mm (MAE) on 4 captures: too few captures for a test"
    )
    assert best(lines, "mae_mm", "truth") == ()
    assert compare({}, "truth").empty and compare({"a": speckle(0)}, "truth").empty
    assert best(frame(COMPARISONS), "mae_mm", "truth") == ()


def test_refuses_other_captures_and_metrics_without_a_direction():
    with pytest.raises(HandbenchError, match="unequal numbers of captures"):
        compare({"a": speckle(0), "b": speckle(0)[:2]}, "truth")
    with pytest.raises(HandbenchError, match="'bias_mm' cannot be compared"):
        compare({"a": speckle(0), "b": speckle(1)}, "truth", "bias_mm")


def test_only_what_is_shown_to_be_worse_is_not_among_the_best():
    def line(better: str, worse: str, p: float) -> tuple:
        return ("mae_mm", better, worse, 1.0, 0.1, 1.9, "mm", p, 1.0, "truth", 6, 0, "", "")

    lines = frame(COMPARISONS, [line("a", "b", 0.2), line("a", "c", 0.01), line("b", "c", 0.03)])
    assert best(lines, "mae_mm", "truth") == ("a", "b")
    assert best(lines, "mae_mm", "photogrammetry") == ()


def test_comes_as_the_documented_columns(tmp_path):
    write(
        tmp_path / "comparisons.csv",
        compare({"a": speckle(0), "b": speckle(1)}, "truth"),
        COMPARISONS,
    )
    header = (tmp_path / "comparisons.csv").read_text().splitlines()[0]
    assert header == (
        "metric,better,worse,difference,low,high,unit,p_corrected,effect,reference,n_captures,n_blocks,sentence,treatment"
    )
    assert header.split(",") == COMPARISONS.names


@pytest.mark.parametrize(
    ("difference", "text"),
    [
        (1.0, "1.0 mm"),
        (0.999, "1.00 mm"),
        (-12.34, "−12.3 mm"),
        (0.1, "0.10 mm"),
        (0.0994, "0.099 mm"),
        (0.0, "0.000 mm"),
    ],
)
def test_amounts_have_one_place_from_one_two_from_a_tenth_and_three_below(difference, text):
    assert amount_text(difference, "mm") == text
    assert amounts_text(abs(difference), -1.0, 2.0, "mm").startswith(text.strip("−"))


def test_samples_that_do_not_scatter_differ_or_not():
    ones, five = np.ones(5), np.full(6, 1.5)
    assert welch_test(ones, five) == (0.5, 0.5, 0.5, 0.0) and welch_test(ones, ones) == (0, 0, 0, 1)
    assert welch_test(ones[:4], five)[0] == 0.5 and np.isnan(welch_test(ones[:4], five).p)
    assert paired_test(five, five + 0.25) == pytest.approx((0.25, 0.25, 0.25, 0.0))
    assert paired_test(five, five) == (0, 0, 0, 1)
    none = np.full(6, np.nan)
    assert (
        np.isnan(paired_test(none, five)[0])
        and np.isnan(welch_test(none, five)[0])
        and np.isnan(welch_test(five, none)[0])
    )


def test_the_ratio_of_precisions_lies_between_quantiles_of_f():
    """s_b/s_a = 2 of 10 and 12 repeats: σ_b/σ_a between 2/√F(0.975; 11, 9) and 2/√F(0.025; 11,
    9)."""
    a, b = np.linspace(-1, 1, 10), np.linspace(-1, 1, 12)
    a, b = 1e-3 * a / a.std(ddof=1), 2e-3 * b / b.std(ddof=1)
    found = f_test([a], [b])
    low, high = (2 / np.sqrt(stats.f.ppf(tail, 11, 9)) - 1 for tail in (0.975, 0.025))
    assert (found.difference, found.low, found.high) == pytest.approx((1.0, low, high), rel=1e-9)
    assert f_test([a], [a]) == (0, 0, 0, 1)
    still = f_test([a], [np.zeros(5)])
    assert still.difference == pytest.approx(-1) and np.isnan(still[1:]).all()
