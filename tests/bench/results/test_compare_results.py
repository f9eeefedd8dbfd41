"""Two results side by side: known differences and none, same captures and others, honest intervals,
refusals."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from handbench.bench.results.compare_results import FIRST, Compared, compare_results
from handbench.bench.results.maps import SurfaceMap, write_surface
from tests.bench.results.flat_results import AXIS_M, NAMES, REFERENCE_M, flat_result
from tests.refusals import refuse


def speckle(seed: int) -> np.ndarray:
    """Errors [capture, y, x] of 1 mm that are one over 7.5 mm."""
    return np.kron(np.random.default_rng(seed).normal(size=(6, 12, 12)), np.ones((3, 3)))


def line(compared: Compared, metric: str = "mae_mm") -> Any:
    """The line of a metric's mean over the captures."""
    means = compared.differences[compared.differences.capture == ""]
    [mean] = means[means.metric == metric].itertuples()
    return mean


def test_a_result_does_not_differ_from_itself(tmp_path):
    a = flat_result(tmp_path, speckle(0))
    compared = compare_results(a, a)
    means = compared.differences[compared.differences.capture == ""]
    assert means.metric.tolist() == [*FIRST, "observed_percent"]
    for d in means[means.metric != "seconds"].itertuples():
        assert (d.difference, d.low, d.high, d.better) == (0, 0, 0, "") and d.a == d.b
        assert d.p_corrected == 1 or d.untested
    assert compared.changes.empty
    # the mean and 6 captures of each error and the time, and one hand with repeats
    assert len(compared.differences) == 5 * (1 + 6) + (1 + 1)


def test_known_differences_are_found_with_their_size(tmp_path):
    """|e| and |e| + 1 mm at every pixel of the same captures: nothing is left to doubt (float64:
    1e-9 mm); and B misses a third of every capture, of which more is better."""
    errors_mm = np.abs(speckle(0))
    a, b = flat_result(tmp_path / "a", errors_mm), flat_result(tmp_path / "b", errors_mm + 1)
    d, turned = line(compare_results(a, b)), line(compare_results(b, a))
    assert (d.difference, d.low, d.high) == pytest.approx((1, 1, 1), abs=1e-9)
    assert (d.better, d.paired, d.n_a, d.n_b) == ("A", True, 6, 6) and d.p_corrected < 1e-6
    assert (turned.difference, turned.better) == (pytest.approx(-1, abs=1e-9), "B")
    holed = np.where(np.arange(36)[:, None] < 12, np.nan, errors_mm)
    d = line(compare_results(a, flat_result(tmp_path / "c", holed)), "observed_percent")
    assert d.difference == pytest.approx(-100 / 3, rel=1e-9)
    assert (d.better, d.high < 0) == ("A", True)


@pytest.mark.parametrize(("names", "shift_m"), [(tuple("GHIKLM"), 0.0), (NAMES, 2e-3)])
def test_other_captures_are_two_samples(tmp_path, names, shift_m):
    """Other names, or the same names on a hand that lies 2 mm further away."""
    a = flat_result(tmp_path / "a", speckle(0))
    compared = compare_results(a, flat_result(tmp_path / "b", 3 * speckle(1), names, shift_m))
    d = line(compared)
    assert not d.paired and d.better == "A" and d.low < d.difference < d.high
    captures = compared.differences[compared.differences.metric == "mae_mm"][1:]
    assert captures.a.notna().sum() == captures.b.notna().sum() == 6
    assert set(captures.capture) == {*NAMES, *names}


@pytest.mark.parametrize(
    ("side", "missing", "same"), [("a", 1, True), ("b", 1, True), ("a", 12, False)]
)
def test_a_hand_is_the_same_where_nearly_the_same_is_seen_of_it(tmp_path, side, missing, same):
    """In either result rows of the reference may be unknown, a third at most of a few percent; and
    the captures that both have are compared."""
    count = {"a": 6, "b": 5}
    found = {n: flat_result(tmp_path / n, speckle(0)[-k:], NAMES[-k:]) for n, k in count.items()}
    fewer_m = np.where(np.arange(36)[:, None] < missing, np.nan, REFERENCE_M)
    for name in NAMES[1:]:
        surface = SurfaceMap(AXIS_M, AXIS_M, fewer_m)
        write_surface(tmp_path / side, name, "truth", surface)
    d = line(compare_results(found["a"], found["b"]))
    assert d.paired == same
    if same:
        assert d.difference == 0 and d.n_a == d.n_b == 5


@pytest.mark.parametrize("count", [1, 3])
def test_every_capture_has_its_figures_where_there_is_no_test(tmp_path, count):
    """|e| of 1 mm and more of 2 mm by one millimetre a capture; the mean of A, 1 mm, and of B."""
    flat_mm, names = np.ones((count, 36, 36)), NAMES[:count]
    worse_mm = flat_mm + 1 + np.arange(count)[:, None, None]
    a, b = (flat_result(tmp_path / k, e, names) for k, e in (("a", flat_mm), ("b", worse_mm)))
    compared = compare_results(a, b)
    of_captures = compared.differences[compared.differences.capture != ""].set_index("metric")
    for metric in ("mae_mm", "max_mm"):
        mean, each = line(compared, metric), of_captures.loc[[metric]]
        assert (mean.a, mean.difference) == pytest.approx((1, (count + 1) / 2))
        assert each.capture.tolist() == list(names)
        assert each.difference.tolist() == pytest.approx(list(range(1, count + 1)))
        assert mean.untested and np.isnan(mean.p_corrected) and mean.better == ""


def test_captures_without_figures_are_not_tested(tmp_path):
    a = flat_result(tmp_path / "a", speckle(0))
    one = np.full((6, 36, 36), np.nan)
    one[0] = 1.0
    d = line(compare_results(a, flat_result(tmp_path / "one", one)))
    assert np.isnan([d.p_corrected, d.low, d.high]).all() and d.untested and not d.better


def test_what_else_differs_is_named(tmp_path):
    a = flat_result(tmp_path, speckle(0), inputs={"B": "a" * 64, "F": "b" * 64})
    method = a.about.methods[0].model_copy(update={"config": {"B": {"step_m": 0.002}}})
    about = {
        "versions": {"handbench": "2"},
        "machine": {"gemm_gflops": 50.0},
        "inputs": {"B": "c" * 64, "F": "b" * 64},
        "methods": (method,),
    }
    config = f"{a.config}precision = true\n"
    b = replace(a, about=a.about.model_copy(update=about), config=config)
    assert sorted(compare_results(a, b).changes.itertuples(index=False, name=None)) == [
        ("configuration", "method.3fsk.precision", "", "True"),
        ("input", "B", "a" * 12, "c" * 12),
        ("machine", "gemm_gflops", "", "50.0"),
        ("settings", "3fsk.step_m", "0.001", "0.002"),
        ("version", "handbench", "1", "2"),
    ]


def test_times_are_those_of_the_table_and_not_tested(tmp_path):
    a = flat_result(tmp_path, speckle(0))
    slower = a.table.assign(low=1.2, value=1.5, high=1.9)
    time = line(compare_results(a, replace(a, table=slower)), "seconds")
    ends = time.a, time.a_low, time.a_high, time.b, time.b_low, time.b_high
    assert ends == (0.5, 0.5, 0.5, 1.5, 1.2, 1.9) and time.difference == 1
    assert time.untested and time.better == ""


def test_what_does_not_compare_is_refused(tmp_path):
    a = flat_result(tmp_path, speckle(0))
    median = a.about.metrics["mae_mm"].model_copy(update={"definition": "median"})
    for facts, place in (
        ({"protocol": {"id": "paper", "version": 3}}, "protocol"),
        ({"metrics": a.about.metrics | {"mae_mm": median}}, "mae_mm"),
        ({"methods": ()}, "method"),
        ({"captures": ()}, "reference"),
    ):
        b = replace(a, about=a.about.model_copy(update=facts))
        refuse(lambda b=b: compare_results(a, b), str(tmp_path), place)
