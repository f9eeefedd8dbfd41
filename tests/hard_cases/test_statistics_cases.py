"""Hard cases of the figures, their intervals and tests: small spreads about large depths,
equal values, NaN, nothing, p-values that underflow, ties, figures of any size."""

from dataclasses import replace
from itertools import combinations
from math import sqrt

import numpy as np
import pytest
from flint import arb

from handbench.bench.evaluation.depth_errors import (
    ErrorMap,
    deviation_map,
    error_map,
    strongest_scatterer_z_m,
)
from handbench.bench.evaluation.intervals import (
    mean_interval,
    median_interval,
    precision_interval,
    precision_mm,
)
from handbench.bench.evaluation.metrics import HEADLINE, METRICS, figures
from handbench.bench.evaluation.paired import compare, f_test, holm_corrected, paired_test
from handbench.bench.evaluation.tables import each
from handbench.bench.results.result_folder import shown
from tests.references.balls import U, balls, deviation, off, two_sided

EPS = np.finfo(float).eps
DEPTH_M, PIXEL_M = 0.3, 1e-3
SIDE = 300
# Most roundings of one term in NumPy's pairwise sum of SIDE² terms: 15 in one of 8 partial sums of
# at most 128 terms, 3 of these together, and one each time that two halves are added.
PAIRWISE = 15 + 3 + np.ceil(np.log2(SIDE**2 / 128))


def a_map(error_m):
    """Errors [ny, nx] on a reference at DEPTH_M."""
    y_m, x_m = (PIXEL_M * np.arange(n) for n in error_m.shape)
    return ErrorMap(x_m, y_m, error_m, np.full(error_m.shape, DEPTH_M))


def relative(figure, exact):
    """Error of a figure, as a share of what it is in balls."""
    return off(figure, exact) / abs(float(exact))


@pytest.mark.parametrize("count", [2, 10, 100_000])
@pytest.mark.parametrize("spread_m", [1e-3, 1e-6, 1e-9, 1e-12, 0.0])
def test_precision_about_a_depth(spread_m, count, within):
    """The depth, the mean's quotient and what is left of it are rounded, half an ε each; the
    rounding of the mean's sum is the same in all depths and enters squared."""
    z_m = DEPTH_M + spread_m * np.where(np.arange(count) % 2, 1.0, -1.0)
    error_mm = off(precision_mm([z_m]), 1000 * deviation(z_m, lost=1))
    within(1e-3 * error_mm / (EPS * DEPTH_M), 3 / 2, "ε of 0.3 m")


@pytest.mark.parametrize("spread_m", [1e-3, 1e-5, 1e-6, 1e-7, 1e-8, 0.0])
def test_pooled_deviation_about_a_depth(spread_m, within):
    """Mean square less squared mean, in NumPy's pairwise sums: 1 µm is known to 0.03 %, 10 nm is
    not."""
    error_m = DEPTH_M + spread_m * np.random.default_rng(0).standard_normal((SIDE, SIDE))
    given_m = balls(figures(a_map(error_m))["deviation_mm"]) / 1000
    off_m2 = off(0.0, given_m**2 - deviation(error_m.ravel()) ** 2)
    within(off_m2 / (EPS * DEPTH_M**2), 1.5 * (PAIRWISE + 1), "ε of (0.3 m)²")


@pytest.mark.parametrize("z_m", [0.1, 0.3, 0.7, 1 / 3])
def test_equal_values_have_no_spread_and_no_difference(z_m, within):
    """One rounding of a depth in metres; no p from roundings."""
    hands = [np.full(n, z_m) for n in (2, 3, 7)]
    within(precision_mm(hands), EPS, "mm", "precision")
    within(max(precision_interval(hands)), EPS, "mm", "its interval")
    within(1 - f_test(hands, [np.full(3, 0.7 * z_m)]).p, EPS, "of p", "two methods")
    repeats = deviation_map(np.arange(2), np.arange(2), np.full((3, 2, 2), z_m))
    within(repeats.error_m.max(), EPS, "m", "map")
    within(np.ptp(median_interval(np.full(5, z_m))), EPS, "m", "median")
    mae_mm = np.full(5, figures(a_map(np.full((60, 60), z_m)))["mae_mm"])
    [line] = each(compare({"a": mae_mm, "b": mae_mm}, ""))
    within(1 - line.p_corrected, EPS, "of p", "two equal methods")


@pytest.mark.parametrize("error_m", np.linspace(1e-4, 5e-3, 12))
def test_methods_that_differ_by_rounding_alone_show_no_difference(error_m, within):
    """|z − z_ref| of z_ref ± e are one number, rounded twice."""
    x_m = 2.5e-3 * np.arange(36)
    slope_m = DEPTH_M + 0.1 * x_m[:, None] + 0 * x_m
    a, b = (figures(error_map(x_m, x_m, slope_m + s * error_m, slope_m)) for s in (1, -1))
    for captures in (1, 5, 8):
        for key in (HEADLINE, "rmse_mm"):
            values = {"a": np.full(captures, a[key]), "b": np.full(captures, b[key])}
            differences = shown(compare(values, "", key)).sum()
            within(differences, 0, "differences", f"{captures} captures")


@pytest.mark.parametrize("t", [*np.logspace(-9, 3, 37), 37.0, 1e5, 1e8])
def test_p_values_down_to_0(t, within):
    """13 roundings of t (5 of the mean, 5 of the deviation, a root, a product and a quotient), four
    times as large in p, which falls as t⁻⁴ at most, and 6.9e-15 of the incomplete beta function,
    the most that Cephes' documentation saw of its own (measured); SciPy's states none."""
    b = t / sqrt(5) + np.array([-1.0, -0.5, 0.0, 0.5, 1.0]) / np.sqrt(5 / 8)  # deviation 1
    gained = balls(b)
    exact = two_sided(gained.mean() / deviation(b, lost=1) * arb(5).sqrt(), 4)
    p = paired_test(np.zeros(5), b).p
    assert 0 <= p <= 1
    within(relative(p, exact), 4 * 13 * U + 6.9e-15, "of p")


P = np.random.default_rng(0).choice([0.0, 5e-324, 1e-300, 0.01, 0.0125, 0.05, 0.5, 1.0], (40, 6))


@pytest.mark.parametrize("p", [[], [0.0], [1.0] * 6, [0.01] * 6, *P.tolist()], ids=str)
def test_holm_s_correction_with_ties_is_closed_testing(p, within):
    """The largest Bonferroni p of all sets that hold a hypothesis: products of the same two
    numbers."""
    sets = [s for size in range(len(p)) for s in combinations(range(len(p)), size + 1)]
    closed = [
        max(min(len(s) * min(p[k] for k in s), 1.0) for s in sets if i in s) for i in range(len(p))
    ]
    within(np.abs(np.subtract(holm_corrected(p), closed)).max(initial=0.0), 0, "of p")


@pytest.mark.parametrize("size", [1e-150, 1e-100, 1e-60, 1.0, 1e60, 1e100, 1e150])
def test_intervals_of_figures_of_any_size(size, within):
    """A scale goes through mean, deviation and skewness, some roundings each (64 ε: measured);
    cubes of 10⁻¹⁵⁰ would underflow."""
    values = np.array([1.0, 4.0, 2.5, 3.5, 9.0])
    ends = np.divide(mean_interval(size * values), size)
    within(np.abs(ends / mean_interval(values) - 1).max() / EPS, 64, "ε")


@pytest.mark.parametrize("broken", [np.nan, np.inf, -np.inf])
def test_values_that_are_not_finite_do_not_enter(broken, within):
    """Pairwise sums, and the square root's half."""
    bound = 1.5 * (PAIRWISE + 1)
    rng, x_m = np.random.default_rng(0), PIXEL_M * np.arange(SIDE)
    for share in (0.01, 0.5, 0.999):
        z_m = DEPTH_M + 1e-3 * rng.standard_normal((SIDE, SIDE))
        z_ref_m = np.full((SIDE, SIDE), DEPTH_M)
        z_m[rng.random(z_m.shape) < share] = broken
        z_ref_m[rng.random(z_m.shape) < share / 2] = broken
        error_m = (z_m - DEPTH_M)[np.isfinite(z_m) & np.isfinite(z_ref_m)]
        given, exact = figures(error_map(x_m, x_m, z_m, z_ref_m)), balls(error_m)
        wanted = {
            "mae_mm": 1000 * np.abs(exact).mean(),
            "rmse_mm": 1000 * np.sqrt((exact**2).mean()),
            "median_mm": arb(1000 * float(np.median(np.abs(error_m)))),
        }
        for key, value in wanted.items():
            within(relative(given[key], value) / EPS, bound, "ε", f"{share:.1%} broken, {key}")
    mixed = np.array([0.3, broken, 0.301, broken, 0.303])
    within(
        abs(precision_mm([mixed]) / precision_mm([mixed[::2]]) - 1) / EPS, bound, "ε", "precision"
    )
    assert mean_interval([1.0, 4.0, 2.5, 3.5, abs(broken)]) is None
    amplitude = np.array([[[1.0, broken, 2.0]]])
    strongest_m = 0.4 if broken == np.inf else 0.5
    assert strongest_scatterer_z_m(np.array([[[0.3, 0.4, 0.5]]]), amplitude)[0] == strongest_m


SHAPE = (40, 40)
EMPTY = {
    "no pixel": a_map(np.empty((0, 0))),
    "no row": a_map(np.empty((0, 5))),
    "holes": a_map(np.full(SHAPE, np.nan)),
    "unobserved": error_map(
        *[PIXEL_M * np.arange(40)] * 2,
        np.full(SHAPE, np.inf),
        np.full(SHAPE, DEPTH_M),
        met=np.ones(SHAPE, bool),
    ),
}
ZEROS = ("n_observed", "observed_percent", "false_alarm_percent", "f_", "complete_")


@pytest.mark.parametrize("name", EMPTY)
def test_an_empty_map_has_no_figure(name, within):
    """But shares of nothing: of a surface that nobody observed the completeness is 0, and the
    F-score."""
    empty = EMPTY[name]
    given = figures(replace(empty, sigma_m=np.full(empty.error_m.shape, 1e-3)))
    assert not any(value for key, value in given.items() if key.startswith(ZEROS))
    unknown = np.full(6, np.nan)
    drawn = [value for key, value in given.items() if not key.startswith(ZEROS)]
    drawn += [METRICS[key].interval(unknown) for key in METRICS]
    drawn += each(compare({"a": unknown, "b": unknown}, ""))
    within(sum(figure is not None for figure in drawn), 0, "figures")
