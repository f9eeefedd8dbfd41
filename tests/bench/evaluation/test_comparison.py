"""Comparisons: known differences, no false ones, Holm's correction, the sentence and what stands out."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from bench.evaluation.depth_errors import error_map
from bench.evaluation.metrics import pool
from bench.evaluation.statistics.paired import compare, holm
from bench.results.error_map import ErrorMap
from bench.results.result_folder import best, shown
from bench.results.tables import COMPARISONS, frame, write
from radar.support.errors import HandbenchError

AXIS_M = 2.5e-3 * np.arange(36)
REFERENCE_M = np.full((36, 36), 0.3)
TITLES = {"2fsk": "2-FSK", "3fsk": "3-FSK"}


def seen(errors_mm: np.ndarray) -> ErrorMap:
    return error_map(AXIS_M, AXIS_M, REFERENCE_M + 1e-3 * errors_mm, REFERENCE_M)


def speckle(rng: np.random.Generator, captures: int = 3) -> np.ndarray:
    """Errors [capture, y, x] of 1 mm that are one over 7.5 mm."""
    return np.kron(rng.normal(size=(captures, 12, 12)), np.ones((3, 3)))


def test_identical_methods_do_not_differ():
    maps = [seen(z) for z in speckle(np.random.default_rng(0))]
    lines = compare({"2fsk": maps, "3fsk": maps}, "truth", titles=TITLES)
    [line] = lines.itertuples()
    assert (line.difference, line.low, line.high, line.p_corrected) == (0, 0, 0, 1) and np.isnan(line.effect)
    assert line.sentence == "no difference shown between 2-FSK and 3-FSK in MAE: 0.000 mm [0.000, 0.000]"
    assert best(lines, "mae_mm", "truth") == ("2fsk", "3fsk")


@pytest.mark.parametrize("captures", [3, 6])
def test_a_constant_shift_is_known_exactly(captures):
    """|e| and |e| + 1 mm at every pixel: what both share cancels, so nothing is left to doubt (float64: 1e-9 mm)."""
    errors_mm = np.abs(speckle(np.random.default_rng(0), captures))
    maps = {"2fsk": [seen(e + 1) for e in errors_mm], "3fsk": [seen(e) for e in errors_mm]}
    lines = compare(maps, "truth", titles=TITLES)
    [line] = lines.itertuples()
    assert (line.better, line.worse, line.p_corrected) == ("3fsk", "2fsk", pytest.approx(0, abs=1e-12))
    assert (line.difference, line.low, line.high) == pytest.approx((1, 1, 1), abs=1e-9)
    assert line.sentence == "3-FSK is better than 2-FSK by 1.0 mm [1.0, 1.0] (MAE)"
    assert (line.n_captures, line.n_blocks) == (captures, 36 * captures)
    assert best(lines, "mae_mm", "truth") == ("3fsk",)


def test_the_difference_is_the_tables():
    rng = np.random.default_rng(1)
    one, other = ([seen(z) for z in a * speckle(rng)] for a in (1.0, 1.5))
    [line] = compare({"a": one, "b": other}, "truth").itertuples()
    assert line.difference == pytest.approx(pool(other)["mae_mm"] - pool(one)["mae_mm"], rel=1e-12)
    assert line.low <= line.difference <= line.high and line.effect > 0


def test_six_captures_have_students_paired_test():
    """Captures of one size: the paired t-test of their MAEs, and Cohen's dz of it."""
    rng = np.random.default_rng(2)
    one, other = 1 + 0.1 * rng.normal(size=6), 1.1 + 0.1 * rng.normal(size=6)
    maps = {m: [seen(np.full((36, 36), e)) for e in values] for m, values in (("a", one), ("b", other))}
    [line] = compare(maps, "truth").itertuples()
    expected = stats.ttest_rel(one, other)
    assert line.p_corrected == pytest.approx(expected.pvalue, rel=1e-6)
    assert line.effect == pytest.approx(abs((other - one).mean()) / (other - one).std(ddof=1), rel=1e-6)
    interval = expected.confidence_interval(0.95)
    sign = np.sign((one - other).mean())
    assert (line.low, line.high) == pytest.approx(sorted((sign * interval.low, sign * interval.high)), rel=1e-6)


def false_positives(methods: int, trials: int) -> int:
    """Trials in which one of `methods` equal methods is shown to be better than another."""
    found = 0
    for trial in range(trials):
        rng = np.random.default_rng(trial)
        shared = speckle(rng)
        maps = {f"m{i}": [seen(z) for z in shared + speckle(rng)] for i in range(methods)}
        found += bool(shown(compare(maps, "truth")).any())
    return found


def test_differences_are_found_falsely_as_often_as_promised():
    """5 % of 200 seeded trials, between the binomial's 0.1 % and 99.9 %; errors are one over 7.5 mm and half of
    their variance is common to both methods."""
    low, high = stats.binom.ppf([0.001, 0.999], 200, 0.05)
    assert low <= false_positives(2, 200) <= high


def test_many_pairs_find_no_more_false_differences_than_one():
    """Six pairs of four methods: Holm keeps 5 % for all of them together, and loses some to what the pairs share."""
    assert false_positives(4, 80) <= stats.binom.ppf(0.999, 80, 0.05)


def test_holm_by_hand():
    """0.01·4, 0.02·3, 0.03·2 and 0.04·1, never falling: 0.04, 0.06, 0.06, 0.06, as in statsmodels' multipletests."""
    assert holm([0.04, 0.01, 0.03, 0.02]) == pytest.approx([0.06, 0.04, 0.06, 0.06], rel=1e-12)
    assert holm([0.5, 0.9, 0.001]) == pytest.approx([1, 1, 0.003], rel=1e-12)
    assert holm([]) == []


def test_more_of_a_share_is_better():
    """A hole of 15 mm in each capture of one method costs it completeness, not accuracy."""
    errors_mm = np.abs(speckle(np.random.default_rng(0)))
    holed = errors_mm.copy()
    for capture, place in enumerate((0, 12, 24)):
        holed[capture, place : place + 6, place : place + 12] = np.nan
    maps = {"holed": [seen(e) for e in holed], "whole": [seen(e) for e in errors_mm]}
    [line] = compare(maps, "truth", "completeness_percent").itertuples()
    assert (line.better, line.worse, line.unit) == ("whole", "holed", "%")
    assert line.difference == pytest.approx(100 * 72 / 36**2, rel=1e-9)
    assert "percentage points" in line.sentence or "no difference shown" in line.sentence


def test_methods_on_different_grids_are_paired_by_place():
    """The same errors, of which one method sees the middle alone: what it sees cancels block by block."""
    z_mm = np.abs(speckle(np.random.default_rng(0), 1)[0]) + 1
    middle = slice(6, 30)
    part = error_map(
        AXIS_M[middle],
        AXIS_M[middle],
        REFERENCE_M[middle, middle] + 1e-3 * z_mm[middle, middle],
        REFERENCE_M[middle, middle],
    )
    lines = compare({"part": [part], "whole": [seen(z_mm)]}, "truth")
    assert lines.n_blocks.tolist() == [36] and not shown(lines).any()


def test_what_cannot_be_tested_says_so():
    """One block observed, or nothing: no interval, no p, and no method stands out by it."""
    lonely = np.full((36, 36), np.nan)
    lonely[:6, :6] = 1.0
    nothing = np.full((36, 36), np.nan)
    errors_mm = speckle(np.random.default_rng(0), 1)[0]
    lines = compare({"a": [seen(errors_mm)], "b": [seen(lonely)], "c": [seen(nothing)]}, "truth")
    assert len(lines) == 1 and lines[["p_corrected", "low"]].isna().all(axis=None) and not shown(lines).any()
    assert "too few blocks to test" in lines.sentence[0]
    assert set(best(lines, "mae_mm", "truth")) == {"a", "b"}
    assert compare({}, "truth").empty and compare({"a": [seen(errors_mm)]}, "truth").empty
    assert best(frame(COMPARISONS), "mae_mm", "truth") == ()


def test_refuses_other_captures_and_metrics_without_a_direction():
    maps = [seen(z) for z in speckle(np.random.default_rng(0))]
    with pytest.raises(HandbenchError, match="unequal numbers of captures"):
        compare({"a": maps, "b": maps[:2]}, "truth")
    for metric in ("max_mm", "bias_mm", "nonsense"):
        with pytest.raises(HandbenchError, match=f"'{metric}' cannot be compared"):
            compare({"a": maps, "b": maps}, "truth", metric)


def test_only_what_is_shown_to_be_worse_is_not_among_the_best():
    def line(better: str, worse: str, p: float) -> tuple:
        return ("mae_mm", better, worse, 1.0, 0.1, 1.9, "mm", p, 1.0, "truth", 3, 30, "")

    lines = frame(COMPARISONS, [line("a", "b", 0.2), line("a", "c", 0.01), line("b", "c", 0.03)])
    assert best(lines, "mae_mm", "truth") == ("a", "b")
    assert best(lines, "mae_mm", "photogrammetry") == ()


def test_comes_as_the_documented_columns(tmp_path):
    maps = [seen(z) for z in speckle(np.random.default_rng(0))]
    write(tmp_path / "comparisons.csv", compare({"a": maps, "b": maps}, "truth"), COMPARISONS)
    header = (tmp_path / "comparisons.csv").read_text().splitlines()[0]
    assert header == (
        "metric,better,worse,difference,low,high,unit,p_corrected,effect,reference,n_captures,n_blocks,sentence"
    )
    assert header.split(",") == COMPARISONS.names
