"""Hard cases of intervals and tests: three captures, three repeats, p-values that underflow, ties, any size."""

from __future__ import annotations

from itertools import combinations, product
from math import erfc, log, sqrt

import numpy as np

from bench.evaluation.metrics import TERMS, figures
from bench.evaluation.statistics.intervals import (
    Spread,
    contributions,
    pooled_intervals,
    precision_interval,
    spread,
    units_of,
)
from bench.evaluation.statistics.paired import holm, p_value
from bench.results import HEADLINE
from bench.results.error_map import ErrorMap
from bench.studies.stability.cases import Seen

EPS = np.finfo(float).eps
DEPTH_M, PIXEL_M = 0.3, 1e-3
T2 = 0.95 / sqrt(2 * 0.975 * 0.025)  # 97.5 % of Student's t with two degrees of freedom
BOUNDS = {"three_captures": 2.0**11, "tiny_p": EPS**0.5}


def _three_repeats() -> Seen:
    for level, size_m in product((0.5, 0.95, 0.999999), (1e-6, 1e-3, 1.0)):
        ends = precision_interval([np.array([1.0, 2.0, 4.0]) * size_m], level) or (np.nan, np.nan)
        for end, tail in zip(ends, ((1 - level) / 2, (1 + level) / 2), strict=True):
            wanted = 1e3 * size_m * sqrt(7 / 3) * sqrt(2 / (-2 * log(tail)))
            yield f"level {level}, {1e3 * size_m:g} mm", abs(end / wanted - 1) / EPS


def told(figure: float | None) -> float:
    """The figure; NaN, which no bound allows, where none is given."""
    return np.nan if figure is None else figure


def a_map(error_m: np.ndarray, pixel_m: float = PIXEL_M) -> ErrorMap:
    """Errors [ny, nx] on a reference at DEPTH_M."""
    y_m, x_m = (pixel_m * np.arange(n) for n in error_m.shape)
    return ErrorMap(x_m, y_m, error_m, np.full(error_m.shape, DEPTH_M))


def _three_captures() -> Seen:
    for relative in (1e-9, 1e-6, 1e-3, 0.1, 0.9):
        errors_m = 1e-3 * (1 + relative * np.array([-1.0, 0.25, 0.75]))
        mean, deviation = errors_m.mean(), errors_m.std(ddof=1)
        reach = T2 * deviation / sqrt(3) / mean
        captures = [a_map(np.full((15, 15), error_m)) for error_m in errors_m]  # of a single block each
        low, high = np.log(np.array(pooled_intervals(captures)[HEADLINE]) / (1e3 * mean))
        for end in (high, -low):
            yield f"captures {relative:g} apart", float(abs(end - reach) / EPS / max(1, reach))


def _coverage() -> float:
    rng, trials = np.random.default_rng(0), 4000
    place = np.array([[capture, 0, 0] for capture in range(3)])
    units, missed = units_of(place), 0
    sums = dict.fromkeys(TERMS, np.zeros(3)) | {"observed": np.full(3, 225.0), "surface": np.full(3, 225.0)}
    for absolute_m in np.abs(rng.standard_normal((trials, 3, 225))).sum(axis=2):
        sums["absolute_m"] = absolute_m
        value = float(figures({name: values.sum() for name, values in sums.items()})[HEADLINE])
        reach = spread(contributions(units, sums)[HEADLINE], units.weights).reach() / value
        missed += abs(log(value / (1e3 * sqrt(2 / np.pi)))) > reach
    return abs(100 * missed / trials - 5)


def _student(freedom: int, t: float) -> float:
    """Two-sided p in closed form, without cancellation; of very many degrees of freedom the normal one."""
    if freedom == 1:
        return 2 / np.pi * float(np.arctan2(1, t))
    if freedom == 2:
        root = float(np.hypot(t, sqrt(2)))
        return 2 / root / (root + t)
    if freedom == 4:
        root = float(np.hypot(t, 2))
        gap = 4 / root / (root + t)  # 1 − u, u = t/√(t² + 4); p = 1 − u(3 − u²)/2 = (1 − u)²(2 + u)/2
        return gap**2 * (3 - gap) / 2
    return erfc(t / sqrt(2))


def _tiny_p() -> Seen:
    for freedom in (1, 2, 4, 10**15):
        for t in (1e-300, *np.logspace(-9, 3, 37), 37.0, 39.0, 1e8, 1e77, 1e150, 1e170, 1e300):
            wanted = _student(freedom, t)
            found = p_value(t, Spread(1.0, float(freedom), 5))
            gone = wanted < 1e-150  # its t² may underflow first
            off = 0.0 if gone and 0 <= found < 1e-150 else abs(found - wanted) / max(wanted, 5e-324)
            yield f"t = {t:g}, ν = {freedom}", off if 0 <= found <= 1 else np.inf
    yield "no spread, a difference", p_value(1e-3, Spread(0.0, 4.0, 5))
    yield "no difference", 1 - p_value(0.0, Spread(0.0, 4.0, 5))
    yield "nothing to test with", 1 - p_value(1.0, None)


def _ties() -> Seen:
    def closed(p: list[float]) -> list[float]:
        sets = [s for size in range(1, len(p) + 1) for s in combinations(range(len(p)), size)]
        return [max(min(len(s) * min(p[k] for k in s), 1.0) for s in sets if i in s) for i in range(len(p))]

    rng = np.random.default_rng(0)
    chosen = np.array([0.0, 5e-324, 1e-300, 0.01, 0.0125, 0.05, 0.5, 1.0])
    lists = [[], [0.0], [1.0] * 6, [0.01] * 6, *(list(rng.choice(chosen, 6)) for _ in range(40))]
    return ((str(p), max((abs(a - b) for a, b in zip(holm(p), closed(p), strict=True)), default=0.0)) for p in lists)


def _any_size() -> Seen:
    d = np.array([1.0, -3.0, 0.5, 1.5])
    for name, weights in (("captures", None), ("blocks", np.eye(4) + 0.3 * (1 - np.eye(4)))):
        one = spread(d, weights)
        for size in (1e-300, 1e-170, 1e-100, 1e-60, 1e60, 1e100, 1e170, 1e300):
            found = spread(size * d, weights)
            off = max(abs(found.error / size / one.error - 1), abs(found.freedom / one.freedom - 1))
            yield f"{name}, {size:g}", off / EPS
    for gone in (np.nan, np.inf):
        yield f"{gone}", 0.0 if spread(np.array([1.0, gone]), None) is None else np.inf
