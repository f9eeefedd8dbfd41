"""Hard cases of the figures, their intervals and tests: small spreads about large depths, 10⁸
samples, equal values, NaN, nothing, p-values that underflow, ties, figures of any size.
"""

from dataclasses import replace
from itertools import combinations, product
from math import sqrt

import numpy as np
from flint import arb

from handbench.bench.evaluation.depth_errors import ErrorMap, deviation_map, error_map
from handbench.bench.evaluation.intervals import mean_interval, median_interval, precision_interval
from handbench.bench.evaluation.metrics import HEADLINE, METRICS, figures
from handbench.bench.evaluation.paired import compare, f_test, holm_corrected, paired_test
from handbench.bench.evaluation.repeats import precision_mm, strongest_scatterer_z_m
from handbench.bench.evaluation.tables import each
from handbench.bench.results.result_folder import shown
from tests.hard_cases.cases import Seen, U, hard_case
from tests.references.balls import balls, deviation, off, two_sided

EPS = np.finfo(float).eps
DEPTH_M, PIXEL_M = 0.3, 1e-3
SIDE = 300
REPEATS = (2, 3, 100, 10_000)
COUNTED = (
    "n_observed",
    "observed_percent",
    "false_alarm_percent",
)  # shares of nothing observed that are known


def pairwise_roundings(count: int) -> int:
    """Most roundings of one term in NumPy's sum of so many: 15 in one of 8 partial sums of at most
    128 terms, 3 of these together, and one each time that two halves are added."""
    return 15 + 3 + max(int(np.ceil(np.log2(count / 128))), 0)


def number(figure: float | None) -> float:
    """The figure; NaN, which no bound allows, where none is given."""
    return np.nan if figure is None else figure


def a_map(error_m: np.ndarray) -> ErrorMap:
    """Errors [ny, nx] on a reference at DEPTH_M."""
    y_m, x_m = (PIXEL_M * np.arange(n) for n in error_m.shape)
    return ErrorMap(x_m, y_m, error_m, np.full(error_m.shape, DEPTH_M))


@hard_case(
    "precision of 1 mm to 0 about 0.3 m",
    kind="rigorous",
    # Of the depth, of the mean's quotient and of what is left of it, half an ε each; that of the
    # mean's sum is the same in all depths and enters squared.
    bound=3 / 2,
    unit="roundings of 0.3 m",
    quantity="error of the standard deviation",
    reference="the deviation of the same depths, in balls",
)
def test_precision_about_depth() -> Seen:
    """The depth, its mean and what is left of it are rounded, half an ε each."""
    for spread_m, n in product((1e-3, 1e-6, 1e-9, 1e-12, 0.0), (2, 10, 100_000)):
        z_m = DEPTH_M + spread_m * np.where(np.arange(n) % 2, 1.0, -1.0)
        off_m = 1e-3 * off(number(precision_mm([z_m])), 1000 * deviation(z_m, lost=1))
        yield f"{1e6 * spread_m:g} µm, {n} repeats", float(off_m) / (EPS * DEPTH_M)


@hard_case(
    "pooled deviation of 1 mm to 0 about 0.3 m",
    kind="rigorous",
    bound=1.5 * (pairwise_roundings(SIDE**2) + 1),
    unit="roundings of (0.3 m)²",
    quantity="error of the variance",
    reference="the variance of the same errors, in balls",
)
def test_pooled_deviation() -> Seen:
    """Mean square less squared mean, in NumPy's pairwise sums, 18 + log₂(n/128) roundings each:
    1 µm is known to 0.03 %, 10 nm is not."""
    noise = np.random.default_rng(0).standard_normal((SIDE, SIDE))
    for spread_m in (1e-3, 1e-5, 1e-6, 1e-7, 1e-8, 0.0):
        error_m = DEPTH_M + spread_m * noise
        found = balls(number(figures(a_map(error_m))["deviation_mm"])) / 1000
        off_m2 = off(0.0, found**2 - deviation(error_m.ravel()) ** 2)
        yield f"{1e6 * spread_m:g} µm", float(off_m2 / (EPS * DEPTH_M**2))


def _relative(figure: float | None, exact: arb) -> float:
    """Error of a figure, as a share of it."""
    return float(off(number(figure), exact)) / abs(float(exact))


@hard_case(
    "all values equal",
    kind="derived",
    bound=EPS,
    unit="1",
    quantity="spread, and 1 − p of a difference",
    reference="0",
)
def test_all_equal() -> Seen:
    """One rounding of a depth in metres; no p from roundings."""
    for z_m in (0.1, 0.3, 0.7, 1 / 3):
        hands = [np.full(n, z_m) for n in (2, 3, 7)]
        yield f"precision at {z_m:g} m", number(precision_mm(hands))
        yield f"its interval at {z_m:g} m", max(precision_interval(hands) or [np.nan])
        yield f"two methods at {z_m:g} m", 1 - number(f_test(hands, [np.full(3, 0.7 * z_m)]).p)
        repeats = deviation_map(np.arange(2), np.arange(2), np.full((3, 2, 2), z_m))
        yield f"map at {z_m:g} m", 1e-3 * number(figures(repeats)["max_mm"])
    low, high = median_interval(np.full(5, 0.3)) or (np.nan, np.nan)
    yield "median", high - low
    mae_mm = np.full(5, number(figures(a_map(np.full((60, 60), 1e-3)))["mae_mm"]))
    [line] = each(compare({"a": mae_mm, "b": mae_mm}, ""))
    yield "two equal methods", 1 - line.p_corrected


@hard_case(
    "methods that differ by rounding alone",
    kind="derived",
    bound=0.0,
    unit="pairs",
    quantity="differences that are shown",
    reference="none",
)
def test_rounding_alone() -> Seen:
    """|z − z_ref| of z_ref ± e are one number, rounded twice."""
    x_m = 2.5e-3 * np.arange(36)
    slope_m = DEPTH_M + 0.1 * x_m[:, None] + 0 * x_m
    for captures, error_m in product((1, 5, 8), np.linspace(1e-4, 5e-3, 12)):
        a, b = (figures(error_map(x_m, x_m, slope_m + s * error_m, slope_m)) for s in (1, -1))
        lines = [
            compare(
                {name: np.full(captures, of[key]) for name, of in (("a", a), ("b", b))}, "", key
            )
            for key in (HEADLINE, "rmse_mm")
        ]
        yield (
            f"{captures} captures, {1e3 * error_m:.3g} mm",
            sum(shown(line).sum() for line in lines),
        )


@hard_case(
    "p-values down to 0",
    kind="measured",
    # t takes 13 roundings: 5 of the mean, 5 of the deviation, a root, a product and a quotient; p
    # falls as t⁻⁴ at most. 6.9e-15: what Cephes states of its incomplete beta function.
    bound=4 * 13 * U + 6.9e-15,
    unit="1",
    quantity="relative error of p",
    reference="the incomplete beta function of the same differences, in balls",
)
def test_tiny_p() -> Seen:
    """13 roundings of t, four times as large in p, which falls as t⁻⁴ at most, and 6.9e-15 of
    the incomplete beta function, the most that Cephes' documentation saw of its own; SciPy's
    states none; t from 10⁻⁹ to 10⁸."""
    apart = np.array([-1.0, -0.5, 0.0, 0.5, 1.0]) / np.sqrt(5 / 8)  # deviation 1
    for t in (*np.logspace(-9, 3, 37), 37.0, 1e5, 1e8):
        gained = balls(b := t / sqrt(5) + apart)
        exact, found = (
            two_sided(gained.mean() / deviation(b, lost=1) * arb(5).sqrt(), 4),
            paired_test(np.zeros(5), b).p,
        )
        yield f"t = {t:g}", _relative(found, exact) if 0 <= found <= 1 else np.inf
    yield "no spread, a difference", paired_test(np.zeros(5), np.full(5, 1e-3)).p
    yield "no difference", 1 - paired_test(np.ones(5), np.ones(5)).p


@hard_case(
    "Holm's correction with ties",
    kind="derived",
    bound=0.0,
    unit="1",
    quantity="largest difference of a corrected p",
    reference="closed testing: the largest Bonferroni p of all sets that hold it",
)
def test_ties() -> Seen:
    """Both are products of the same two numbers."""

    def closed(p: list[float]) -> list[float]:
        sets = [s for size in range(1, len(p) + 1) for s in combinations(range(len(p)), size)]
        return [
            max(min(len(s) * min(p[k] for k in s), 1.0) for s in sets if i in s)
            for i in range(len(p))
        ]

    rng = np.random.default_rng(0)
    chosen = np.array([0.0, 5e-324, 1e-300, 0.01, 0.0125, 0.05, 0.5, 1.0])
    for p in ([], [0.0], [1.0] * 6, [0.01] * 6, *(list(rng.choice(chosen, 6)) for _ in range(40))):
        yield (
            str(p),
            max(
                (abs(a - b) for a, b in zip(holm_corrected(p), closed(p), strict=True)), default=0.0
            ),
        )


@hard_case(
    "figures of any size",
    kind="measured",
    bound=64.0,
    unit="ε",
    quantity="relative error of the interval's ends",
    reference="the interval of the figures, scaled",
)
def test_any_size() -> Seen:
    """A scale goes through mean, deviation and skewness, some roundings each; cubes of 10⁻¹⁵⁰
    would underflow."""
    values = np.array([1.0, 4.0, 2.5, 3.5, 9.0])
    for size in (1e-150, 1e-100, 1e-60, 1.0, 1e60, 1e100, 1e150):
        ends = np.divide(mean_interval(size * values), size)
        yield f"{size:g}", np.abs(ends / mean_interval(values) - 1).max() / EPS
    for gone in (np.nan, np.inf):
        yield f"{gone}", 0.0 if mean_interval([*values[:4], gone]) is None else np.inf


@hard_case(
    "NaN and infinite values",
    kind="rigorous",
    bound=1.5 * (pairwise_roundings(SIDE**2) + 1),
    unit="ε",
    quantity="relative error of MAE, RMSE, median and precision",
    reference="the finite values alone, in balls",
)
def test_not_finite() -> Seen:
    """Pairwise sums, and the square root's half; nothing that is not finite may enter."""
    rng, x_m = np.random.default_rng(0), PIXEL_M * np.arange(SIDE)
    for broken, share in product((np.nan, np.inf, -np.inf), (0.01, 0.5, 0.999)):
        z_m, z_ref_m = (
            DEPTH_M + 1e-3 * rng.standard_normal((SIDE, SIDE)),
            np.full((SIDE, SIDE), DEPTH_M),
        )
        z_m[rng.random(z_m.shape) < share] = broken
        z_ref_m[rng.random(z_m.shape) < share / 2] = broken
        error = (z_m - DEPTH_M)[np.isfinite(z_m) & np.isfinite(z_ref_m)]
        found = figures(error_map(x_m, x_m, z_m, z_ref_m))
        exact = balls(error)
        wanted = {
            "mae_mm": 1000 * np.abs(exact).mean(),
            "rmse_mm": 1000 * np.sqrt((exact**2).mean()),
            "median_mm": arb(1000 * float(np.median(np.abs(error)))),
        }
        for key, value in wanted.items():
            yield f"{share:.1%} {broken}, {key}", _relative(found[key], value) / EPS
    for broken, strongest_m in ((np.nan, 0.5), (np.inf, 0.4), (-np.inf, 0.5)):
        mixed = np.array([0.3, broken, 0.301, broken, 0.303])
        both = [number(precision_mm([z_m])) for z_m in (mixed, mixed[::2])]
        yield f"precision with {broken}", abs(both[0] / both[1] - 1) / EPS
        found_m = strongest_scatterer_z_m(
            np.array([[[0.3, 0.4, 0.5]]]), np.array([[[1.0, broken, 2.0]]])
        )
        yield f"strongest with {broken}", 0.0 if found_m[0] == strongest_m else np.inf


@hard_case(
    "empty maps",
    kind="derived",
    bound=0.0,
    unit="figures",
    quantity="figures that are given all the same",
    reference="none",
)
def test_empty() -> Seen:
    """Nothing is observed: no figure has anything to stand on."""
    shape, x_m = (40, 40), PIXEL_M * np.arange(40)
    holes, no_pixel, no_row = (a_map(np.full(size, np.nan)) for size in (shape, (0, 0), (0, 5)))
    unobserved = error_map(
        x_m, x_m, np.full(shape, np.inf), np.full(shape, DEPTH_M), met=np.ones(shape, bool)
    )
    for m in (no_pixel, no_row, holes, unobserved):
        # Of a surface that nobody observed the completeness is 0, and the F-score.
        known = replace(m, sigma_m=np.full(m.error_m.shape, 1e-3))
        given: list[object] = [
            v
            for k, v in figures(known).items()
            if k not in COUNTED and (v or not k.startswith(("f_", "complete_")))
        ]
        unknown = np.full(6, np.nan)
        given += [METRICS[key].interval(unknown) for key in METRICS]
        given += each(compare({"a": unknown, "b": unknown}, ""))
        yield f"a map of {m.error_m.shape}", float(sum(figure is not None for figure in given))
