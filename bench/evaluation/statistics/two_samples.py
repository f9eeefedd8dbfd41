"""Tests of whether B's figure is better than A's: on the same captures, on different ones, and of two precisions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.special import fdtr, fdtrc, fdtri

from bench.evaluation.metrics import METRICS, mean_deviation, pool
from bench.evaluation.statistics.intervals import TAILS, Spread, contributions, cut, spread, units_of
from bench.evaluation.statistics.paired import compare, p_value
from bench.results.error_map import ErrorMap


class Tested(NamedTuple):
    """B − A with its 95 % interval and the p of none, not corrected; None: unknown, or too little to test."""

    difference: float | None
    low: float | None = None
    high: float | None = None
    p: float | None = None


def paired(maps_a: Sequence[ErrorMap], maps_b: Sequence[ErrorMap], metric: str) -> Tested:
    """Of the same captures in the same order: what both suffer from cancels, block by block (`comparison.compare`)."""
    line: Any = next(compare({"A": maps_a, "B": maps_b}, "", metric).itertuples(), None)
    if line is None:
        return Tested(None)
    ends = (line.difference, line.low, line.high)
    if (line.better == "A") != (METRICS[metric].better == "lower"):
        ends = tuple(0.0 - end for end in (line.difference, line.high, line.low))
    return Tested(*ends, line.p_corrected)


def unpaired(maps_a: Sequence[ErrorMap], maps_b: Sequence[ErrorMap], metric: str) -> Tested:
    """Of two independent samples (Welch 1947): the variances of the two figures add, and Student's t takes the degrees
    of freedom that give the sum its own variance (Satterthwaite)."""
    a, b = (pool(maps)[metric] for maps in (maps_a, maps_b))
    if a is None or b is None:
        return Tested(None)
    difference = b - a
    spreads = []
    for maps in (maps_a, maps_b):
        blocks = cut(maps)
        units = units_of(blocks.place)
        found = spread(contributions(units, blocks.sums)[metric], units.weights)
        spreads += [found] if found else []
    if len(spreads) < 2:
        return Tested(difference)
    variances = [s.error**2 for s in spreads]
    terms = sum(v**2 / s.freedom for v, s in zip(variances, spreads, strict=True))
    freedom = sum(variances) ** 2 / terms if terms else min(s.freedom for s in spreads)
    together = Spread(sum(variances) ** 0.5, freedom, sum(s.units for s in spreads))
    reach = together.reach()
    return Tested(difference, difference - reach, difference + reach, p_value(abs(difference), together))


def f_test(hands_a: Sequence[np.ndarray], hands_b: Sequence[np.ndarray]) -> Tested:
    """Of two precisions, mm, from each hand's strongest depths [n_repeats] in metres, as if all repeats were
    independent: cautious where both image the same echoes. The interval is that of the ratio, times A's precision."""
    deviation_a, deviation_b = mean_deviation(hands_a), mean_deviation(hands_b)
    if deviation_a is None or deviation_b is None:
        return Tested(None)
    (a, freedom_a), (b, freedom_b) = deviation_a, deviation_b
    if a == b:
        return Tested(0.0, 0.0, 0.0, 1.0)
    if not a or not b:
        return Tested(b - a)
    ratio = b / a
    p = 2 * min(test(freedom_b, freedom_a, ratio**2) for test in (fdtr, fdtrc))
    low, high = (a * (ratio / fdtri(freedom_b, freedom_a, tail) ** 0.5 - 1) for tail in TAILS[::-1])
    return Tested(b - a, float(low), float(high), float(min(p, 1)))
