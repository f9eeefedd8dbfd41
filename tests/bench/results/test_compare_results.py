"""Two results side by side: known differences and none, same captures and others, honest intervals,
refusals."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

from handbench.bench import results
from handbench.bench.evaluation.depth_errors import ErrorMap, error_map
from handbench.bench.evaluation.paired import f_test
from handbench.bench.evaluation.tables import DIFFERENCES, REPEATS, TABLE, TASKS, frame
from handbench.bench.results.compare_results import Compared, _same, compare_results, write_compared
from handbench.support.errors import HandbenchError

AXIS_M = 2.5e-3 * np.arange(36)
REFERENCE_M = np.full((36, 36), 0.3)
NAMES = ("B", "F", "U", "V", "W", "X")


def speckle(seed: int, captures: int = 6) -> np.ndarray:
    """Errors [capture, y, x] of 1 mm that are one over 7.5 mm."""
    return np.kron(np.random.default_rng(seed).normal(size=(captures, 12, 12)), np.ones((3, 3)))


def seen(errors_mm: np.ndarray, reference_m: np.ndarray = REFERENCE_M) -> ErrorMap:
    return error_map(AXIS_M, AXIS_M, reference_m + 1e-3 * errors_mm, reference_m)


def result(
    folder: Path,
    errors_mm: np.ndarray,
    names: tuple[str, ...] = NAMES,
    shift_m: float = 0.0,
    **facts: object,
) -> results.Result:
    """A result of one method on flat hands that lie shift_m further away; facts: of its About."""
    for name, errors in zip(names, errors_mm, strict=True):
        results.write_errors(folder, name, "3fsk", "truth", seen(errors, REFERENCE_M + shift_m))
        results.write_surface(
            folder, name, "truth", results.SurfaceMap(AXIS_M, AXIS_M, REFERENCE_M + shift_m)
        )
    rng = np.random.default_rng(len(names))
    repeats = frame(
        REPEATS, [("B", "3fsk", i, z) for i, z in enumerate(0.3 + 1e-3 * rng.normal(size=10))]
    )
    about = results.About(
        name="flat",
        protocol={"id": "paper", "version": 2, "compared": ["mae_mm", "observed_percent"]},
        metrics=results.metric_facts(),
        inputs={},
        versions={"handbench": "1"},
        machine={"gemm_gflops": 100.0},
        captures=tuple(results.CaptureFacts(name=name, references=("truth",)) for name in names),
        methods=(
            results.MethodFacts(
                name="3fsk", title="3-FSK", config={n: {"step_m": 0.001} for n in names}
            ),
        ),
    )
    table = frame(TABLE, [("seconds", "3fsk", 0.5, 0.4, 0.6, "s", None, "truth")])
    about = about.model_copy(update=facts)
    config = 'name = "flat"\n[[method]]\nid = "3fsk"\n'
    return results.Result(folder, about, table, frame(TASKS), config, {"repeats": repeats})


def line(compared: Compared, metric: str = "mae_mm") -> Any:
    [found] = compared.differences[compared.differences.metric == metric].itertuples()
    return found


def test_a_result_does_not_differ_from_itself(tmp_path):
    a = result(tmp_path, speckle(0))
    compared = compare_results(a, a)
    assert compared.differences.metric.tolist() == ["mae_mm", "observed_percent", "precision_mm"]
    for d in compared.differences.itertuples():
        assert (d.difference, d.low, d.high, d.p_corrected, d.better) == (0, 0, 0, 1, "")
        assert d.a == d.b and str(d.difference) == "0.0"
    assert line(compared).sentence == (
        "3-FSK: no difference shown between A and B in MAE against truth: 0.000 mm [0.000, 0.000]"
    )
    assert compared.changes.empty


def test_a_shift_of_a_millimetre_is_found_with_its_size(tmp_path):
    """|e| and |e| + 1 mm at every pixel of the same captures: nothing is left to doubt (float64:
    1e-9 mm)."""
    errors_mm, captures = np.abs(speckle(0)), 6
    a, b = result(tmp_path / "a", errors_mm), result(tmp_path / "b", errors_mm + 1)
    for compared, sign, better, worse in (
        (compare_results(a, b), 1, "A", "B"),
        (compare_results(b, a), -1, "B", "A"),
    ):
        d = line(compared)
        assert (d.difference, d.low, d.high) == pytest.approx((sign, sign, sign), abs=1e-9)
        assert (d.better, d.paired, d.n_a, d.n_b) == (
            better,
            True,
            captures,
            captures,
        ) and d.p_corrected < 1e-6
        assert (
            d.sentence
            == f"3-FSK: {better} is better than {worse} by 1.0 mm [1.0, 1.0] (MAE against truth)"
        )


def test_more_of_a_share_is_better(tmp_path):
    """B misses a third of every capture, so A is better."""
    errors_mm = np.abs(speckle(0, 6))
    holed = errors_mm.copy()
    holed[:, :12] = np.nan
    names = tuple("BFUVWX")
    d = line(
        compare_results(
            result(tmp_path / "a", errors_mm, names), result(tmp_path / "b", holed, names)
        ),
        "observed_percent",
    )
    assert d.difference == pytest.approx(-100 / 3, rel=1e-9)
    assert (d.better, d.high < 0) == ("A", True) and "percentage points" in d.sentence


@pytest.mark.parametrize(
    ("names", "shift_m"), [(tuple("GHIKLM"), 0.0), (NAMES, 2e-3)], ids=["names", "places"]
)
def test_other_captures_are_two_samples(tmp_path, names, shift_m):
    """Other names, or the same names on a hand that lies 2 mm further away."""
    a, b = (
        result(tmp_path / "a", speckle(0)),
        result(tmp_path / "b", 3 * speckle(1), names, shift_m),
    )
    compared = compare_results(a, b)
    d = line(compared)
    assert not d.paired and d.better == "A" and d.low < d.difference < d.high
    assert (
        "different captures (B, F, U, V, W, X; " in compared.basis[0]
        and "independent" in compared.basis[0]
    )


def test_the_captures_that_both_have_are_compared(tmp_path):
    errors_mm = speckle(0)
    a, b = result(tmp_path / "a", errors_mm), result(tmp_path / "b", errors_mm[1:], NAMES[1:])
    compared = compare_results(a, b)
    assert line(compared).difference == 0 and line(compared).n_a == line(compared).n_b == 5
    assert "(F, U, V, W, X, without the 1 that only one has)" in compared.basis[0]


def test_three_captures_are_too_few_to_tell(tmp_path):
    errors_mm = np.abs(speckle(0, 3))
    a, b = (result(tmp_path / str(add), errors_mm + add, NAMES[:3]) for add in (0, 1))
    d = line(compare_results(a, b))
    assert (
        d.difference == pytest.approx(1)
        and np.isnan([d.low, d.p_corrected]).all()
        and d.better == ""
    )
    told = "in MAE against truth: too few captures for a test (B − A: 1.0 mm)"
    assert d.sentence.endswith(f"{told}; needs 5 hands to show this difference") and d.needed == 5


@pytest.mark.parametrize(("shift_m", "each"), [(0.0, ""), (5e-3, " of each")])
def test_a_difference_that_is_not_shown_says_how_many_hands_it_needs(tmp_path, shift_m, each):
    """Against the power of the t test of the spread between captures, at 5 % over both lines that
    are tested."""
    base = np.abs(speckle(0))
    a = result(tmp_path / "a", base)
    b = result(tmp_path / "b", base + 0.2 + np.arange(-3, 3)[:, None, None], shift_m=shift_m)
    d = line(compare_results(a, b))
    assert d.better == "" and d.needed > 6
    assert f"; needs {d.needed:.0f} hands{each} to show this difference" in d.sentence
    figures = [
        [np.abs(r.errors(n, "3fsk", "truth").error_m).mean() * 1e3 for n in NAMES] for r in (a, b)
    ]
    squares = np.var(figures, axis=1, ddof=1)
    tests = compare_results(a, b).differences.p_corrected.notna().sum()

    def power(n: float) -> float:
        if each:  # Welch
            freedom, error = (
                (n - 1) * squares.sum() ** 2 / (squares**2).sum(),
                np.sqrt(squares.sum() / n),
            )
        else:
            freedom, error = n - 1, np.std(np.subtract(*figures), ddof=1) / np.sqrt(n)
        return stats.nct.sf(stats.t.isf(0.025 / tests, freedom), freedom, abs(d.difference) / error)

    assert power(d.needed - 1) < 0.8 < power(d.needed)


def test_precisions_are_compared_by_the_f_test():
    rng = np.random.default_rng(0)
    a, b = [1e-3 * rng.normal(size=10)], [3e-3 * rng.normal(size=12)]
    found = f_test(a, b)
    ratio = np.var(b[0], ddof=1) / np.var(a[0], ddof=1)
    assert found.p == pytest.approx(2 * stats.f.sf(ratio, 11, 9), rel=1e-9)
    assert found.difference == pytest.approx(
        1e3 * (np.std(b[0], ddof=1) - np.std(a[0], ddof=1)), rel=1e-9
    )
    assert 0 < found.low < found.difference < found.high and found.p < 0.05


def test_precisions_differ_falsely_as_often_as_promised():
    """5 % of 400 seeded trials with three hands of unlike precision, between the binomial's 0.1 %
    and 99.9 %."""
    low, high = stats.binom.ppf([0.001, 0.999], 400, 0.05)
    scales = np.array([[1.0], [2.0], [0.5]])
    draws = (np.random.default_rng(trial).normal(size=(2, 3, 10)) for trial in range(400))
    assert low <= sum(f_test(scales * a, scales * b).p < 0.05 for a, b in draws) <= high


def test_nothing_is_made_of_nothing(tmp_path):
    """A method that saw nothing, one that saw something in one capture alone, precisions of no
    repeats."""
    nothing, lonely = np.full((6, 36, 36), np.nan), np.full((6, 36, 36), np.nan)
    lonely[0, :6, :6] = 1.0
    a = replace(result(tmp_path / "a", speckle(0)), files={"repeats": frame(REPEATS)})
    for name, errors_mm, words in (
        ("n", nothing, "no figures to compare"),
        ("l", lonely, "too few captures for a test"),
    ):
        for names in (NAMES, tuple("GHIKLM")):
            d = line(compare_results(a, result(tmp_path / (name + names[0]), errors_mm, names)))
            assert (
                np.isnan([d.p_corrected, d.low, d.high]).all()
                and d.better == ""
                and words in d.sentence
            )
    assert compare_results(a, a).differences.metric.tolist() == ["mae_mm", "observed_percent"]
    assert np.isnan(f_test([], [np.arange(5.0)]).difference)
    assert np.isnan(f_test([np.zeros(5)], [np.arange(5.0)]).p)


def test_what_else_differs_is_named(tmp_path):
    a = result(tmp_path, speckle(0), inputs={"B": "a" * 64, "F": "b" * 64})
    config = {"B": {"step_m": 0.002}, "F": {"step_m": 0.002}, "U": {"step_m": 0.001}}
    b = replace(
        a,
        config='name = "flat"\n[[method]]\nid = "3fsk"\nprecision = true\n',
        about=a.about.model_copy(
            update={
                "versions": {"handbench": "2"},
                "machine": {"gemm_gflops": 50.0},
                "inputs": {"B": "c" * 64, "F": "b" * 64},
                "methods": (a.about.methods[0].model_copy(update={"config": config}),),
            }
        ),
    )
    compared = compare_results(a, b)
    assert list(compared.changes.itertuples(index=False, name=None)) == [
        ("configuration", "method.3fsk.precision", "", "True"),
        ("settings", "3fsk.step_m", "0.001", "0.002 / 0.001"),
        ("version", "handbench", "1", "2"),
        ("machine", "gemm_gflops", "100.0", "50.0"),
        ("input", "B", "a" * 12, "c" * 12),
    ]
    assert compared.times.sentence[0] == (
        "3-FSK: B takes 1.00 times as long as A (0.5 s at 100 GFLOP/s, 0.5 s at 50 GFLOP/s)"
    )
    assert "config.toml" in set(compare_results(a, replace(b, config="[broken")).changes.key)


def test_refuses_what_does_not_compare(tmp_path):
    a = result(tmp_path, speckle(0))

    def other(**facts: object) -> results.Result:
        return replace(a, about=a.about.model_copy(update=facts))

    with pytest.raises(
        HandbenchError, match="protocols 'paper 2' and 'paper 3', whose figures do not compare"
    ):
        compare_results(a, other(protocol={"id": "paper", "version": 3}))
    metrics = dict(a.about.metrics)
    metrics["mae_mm"] = metrics["mae_mm"].model_copy(update={"definition": "median"})
    with pytest.raises(HandbenchError, match="define mae_mm differently"):
        compare_results(a, other(metrics=metrics))
    with pytest.raises(HandbenchError, match="have no method in common"):
        compare_results(a, other(methods=()))
    with pytest.raises(HandbenchError, match="have no reference in common"):
        compare_results(a, other(captures=()))


def test_comes_as_the_documented_columns(tmp_path):
    a = result(tmp_path / "a", speckle(0))
    write_compared(tmp_path / "out", compare_results(a, a))
    header, *lines = (tmp_path / "out" / "compare.csv").read_text("utf-8").splitlines()
    assert header.split(",") == DIFFERENCES.names and len(lines) == 3
    assert '"schema_version": 1' in (tmp_path / "out" / "compare.json").read_text("utf-8")


@pytest.mark.parametrize("side", ["a", "b"])
@pytest.mark.parametrize(("missing", "alike"), [(0, True), (1, True), (12, False)])
def test_a_hand_is_the_same_where_nearly_the_same_is_seen_of_it(tmp_path, side, missing, alike):
    """In either result rows of the reference may be unknown, a third at most of a few percent."""
    found = {name: result(tmp_path / name, speckle(0)) for name in "ab"}
    fewer_m = np.where(np.arange(36)[:, None] < missing, np.nan, REFERENCE_M)
    for name in NAMES:
        results.write_surface(
            tmp_path / side, name, "truth", results.SurfaceMap(AXIS_M, AXIS_M, fewer_m)
        )
    assert all(_same(found["a"], found["b"], name, "truth") == alike for name in NAMES)


def test_times_stand_beside_each_other_with_their_intervals(tmp_path):
    a, b = result(tmp_path / "a", speckle(0)), result(tmp_path / "b", speckle(0))
    slower = frame(TABLE, [("seconds", "3fsk", 1.5, 1.2, 1.9, "s", None, "truth")])
    [times] = compare_results(a, replace(b, table=slower)).times.itertuples()
    assert list(times)[3:10] == [0.5, 0.4, 0.6, 1.5, 1.2, 1.9, pytest.approx(3.0)]
    [none] = compare_results(a, replace(b, table=slower.iloc[:0])).times.itertuples()
    assert list(none)[3:6] == [0.5, 0.4, 0.6] and np.isnan(list(none)[6]) and "no times" in none[-1]


def test_the_f_test_does_not_mind_which_comes_first():
    """A is as significantly better than B as B is worse than A; at the table's 5 % points of F(20,
    20), 2.464."""
    random = np.random.default_rng(6)
    wide, narrow = (scale * random.normal(size=21) for scale in (1.6e-3, 1e-3))
    assert f_test([wide], [narrow]).p == pytest.approx(f_test([narrow], [wide]).p, rel=1e-12)
    unit = np.tile([-1.0, 1.0, 0.0], 7)
    for a, b in ((1.0, np.sqrt(2.4645)), (np.sqrt(2.4645), 1.0)):
        assert f_test([1e-3 * a * unit], [1e-3 * b * unit]).p == pytest.approx(0.05, rel=2e-3)
