"""Confidence intervals that respect what is independent.

A pooled figure θ is split into what each unit adds to it, d = θ − θ without the unit (the jackknife). The units are
whole captures when there are at least CAPTURES_AS_UNITS of them, for captures differ. Fewer say nothing of others: the
units are then blocks of pixels, and the interval speaks of these captures alone. Neighbouring blocks err together, so
the variance of θ is d·W·d, with weights W that fall linearly to zero over LAG_BLOCKS blocks along x and y (Bartlett;
Conley 1999), and its ends are quantiles of Student's t, with the degrees of freedom that give the variance its own
variance (Satterthwaite). `tests/bench/evaluation/test_statistics.py` measures how often such intervals hold the true
value.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import chdtri, stdtrit

from bench.evaluation.metrics import METRICS, QUANTILES, TERMS, Terms, Values, figures, mean_deviation, pool, terms
from bench.results.error_map import ErrorMap
from bench.results.tables import LEVEL

RESAMPLES = 1000  # of a bootstrap
BLOCK_M = 0.015  # three lateral resolutions of the paper's aperture
SPAN = 1 << 20  # more blocks than a row can have
LAG_BLOCKS = 3  # blocks this far apart share neither speckle nor a filter's window
CAPTURES_AS_UNITS = 5
TAILS = ((1 - LEVEL) / 2, (1 + LEVEL) / 2)  # shares of a distribution below an interval's ends
WORST_BLOCKS = 3  # the largest error among the others is the lower end of a maximum's interval


class Interval(NamedTuple):
    """Confidence interval, in the unit of its figure."""

    low: float
    high: float


@dataclass(frozen=True)
class Blocks:
    """Sums of `metrics.terms` over the spatial blocks of several captures. place [n, 3]: capture, row and column of
    each block; sums: name → [n]; absolute_m, block: |error| of each observed pixel and the number of its block."""

    place: np.ndarray
    sums: Terms
    absolute_m: np.ndarray
    block: np.ndarray

    def at(self, place: np.ndarray) -> Terms:
        """The sums at blocks [m, 3] among which all of these are; 0 at the others."""
        _, number = np.unique(np.concatenate([place, self.place]), axis=0, return_inverse=True)
        where = np.argsort(number[: len(place)])[number[len(place) :]]
        return {name: np.bincount(where, values, minlength=len(place)) for name, values in self.sums.items()}


@dataclass(frozen=True)
class Units:
    """Units that are left out one at a time. unit [n_blocks]: the number of each block's unit; weights [n, n]: how far
    two units err together, None: not at all (captures)."""

    unit: np.ndarray
    weights: np.ndarray | None

    def totals(self, values: np.ndarray) -> np.ndarray:
        """Sums [n_units] of the blocks' values."""
        return np.bincount(self.unit, values)


class Spread(NamedTuple):
    """Standard error of a figure, its degrees of freedom, and the number of units that add to the figure."""

    error: float
    freedom: float
    units: int

    def reach(self) -> float:
        """Half the width of the interval."""
        return float(self.error * stdtrit(self.freedom, TAILS[1])) if self.error else 0.0


def pooled_intervals(
    maps: Sequence[ErrorMap], block_m: float = BLOCK_M, estimate: Values | None = None
) -> dict[str, Interval]:
    """Metric → interval of the pooled metrics of `maps` (estimate: their `pool`, where it is at hand); one that has no
    two units to stand on is left out, and so is a share of nothing or of all, which shows no spread.

    Ratios of sums: θ ± t·s by the jackknife (lengths: on the scale of their logarithm). Quantiles: those at the shares
    p ± t·s, s the standard error of the share of pixels below (Woodruff 1952). A maximum: from the largest error
    outside the three worst blocks, which is where the bootstrap's 2.5 % lies, to the largest that was seen, for no
    sample shows a larger one.
    """
    blocks = cut(maps, block_m)
    if not len(blocks.absolute_m):
        return {}
    units = units_of(blocks.place)
    estimate = pool(maps) if estimate is None else estimate
    intervals = {}
    for key, d in contributions(units, blocks.sums).items():
        value = estimate[key]
        bare = METRICS[key].unit == "%" and value in (0, 100)
        if value is not None and not bare and (found := spread(d, units.weights)):
            intervals[key] = _interval(key, value, found.reach())
    for key, share in QUANTILES.items():
        interval, value = _quantile_interval(blocks, units, share), estimate[key]
        if interval is not None and value is not None:
            intervals[key] = Interval(min(interval.low, value), max(interval.high, value))
    largest_mm = np.zeros(len(blocks.place))
    np.maximum.at(largest_mm, blocks.block, 1e3 * blocks.absolute_m)
    largest_mm = np.sort(largest_mm[np.unique(blocks.block)])[::-1]
    if len(largest_mm) > 1 and (largest := estimate["max_mm"]) is not None:
        intervals["max_mm"] = Interval(float(largest_mm[min(WORST_BLOCKS, len(largest_mm) - 1)]), largest)
    return intervals


def note(captures: int) -> str:
    """A sentence on what the intervals over so many captures speak of."""
    if captures >= CAPTURES_AS_UNITS:
        return f"{captures} captures: the intervals speak of captures like these, between which the figures vary"
    few = "1 capture: the intervals speak of this capture"
    few = few if captures == 1 else f"{captures} captures: the intervals speak of these captures"
    return f"{few}, not of others; {CAPTURES_AS_UNITS} or more would tell how captures vary"


def block_numbers(m: ErrorMap, block_m: float = BLOCK_M) -> np.ndarray:
    """The number [ny, nx] of the spatial block in which each pixel lies: SPAN · row + column. Block (0, 0) begins at
    x = y = 0, so that maps on different grids share their blocks."""
    column, row = (np.floor(axis / block_m + 1e-9).astype(np.int64) for axis in (m.x_m, m.y_m))
    return SPAN * row[:, None] + column


def cut(maps: Iterable[ErrorMap], block_m: float = BLOCK_M, pixels: bool = True) -> Blocks:
    """Sum the terms of `maps`, one a capture, over blocks of block_m × block_m; without pixels these are not kept."""
    places, sums, absolute_m, numbers = [np.empty((0, 3), int)], [], [np.empty(0)], [np.empty(0, int)]
    for capture, m in enumerate(maps):
        pixel = terms(m)
        told = (pixel["surface"] > 0) | (pixel["judged"] > 0)
        names, number = np.unique(block_numbers(m, block_m)[told], return_inverse=True)
        column = (names + SPAN // 2) % SPAN - SPAN // 2
        place = np.stack([np.full(len(names), capture), (names - column) // SPAN, column], axis=-1)
        if pixels:
            observed = np.isfinite(m.error_m)[told]
            absolute_m.append(pixel["absolute_m"][told][observed])
            numbers.append(number[observed] + sum(map(len, places)))
        places.append(place)
        sums.append({k: np.bincount(number, values[told], minlength=len(place)) for k, values in pixel.items()})
    together = {name: np.concatenate([np.empty(0), *(s[name] for s in sums)]) for name in TERMS}
    return Blocks(np.concatenate(places), together, np.concatenate(absolute_m), np.concatenate(numbers))


def units_of(place: np.ndarray) -> Units:
    """The units of blocks at place [n, 3]: captures, or with too few of them the blocks themselves."""
    captures, capture = np.unique(place[:, 0], return_inverse=True)
    if len(captures) >= CAPTURES_AS_UNITS:
        return Units(capture, None)
    apart = np.abs(place[:, None] - place)
    near = np.clip(1 - apart[..., 1:] / LAG_BLOCKS, 0, None).prod(axis=-1)
    return Units(np.arange(len(place)), near * (apart[..., 0] == 0))


def contributions(units: Units, sums: Terms) -> dict[str, np.ndarray]:
    """Metric → what each unit [n] adds to it: θ − θ without the unit, times 1 − 1/n (exact for units of one size)."""
    parts = {name: units.totals(values) for name, values in sums.items()}
    totals = {name: values.sum() for name, values in parts.items()}
    whole, without = figures(totals), figures({name: totals[name] - values for name, values in parts.items()})
    with np.errstate(invalid="ignore"):
        return {key: (whole[key] - without[key]) * (1 - 1 / len(without[key])) for key in whole}


def spread(d: np.ndarray, weights: np.ndarray | None) -> Spread | None:
    """Standard error of a figure from its units' contributions d [n]; None without two that are known.

    E d·W·d falls short of the variance, for Σd = 0 takes one degree of freedom away: it is divided by its value for
    independent units of one size. A negative covariance of neighbours is not believed. The degrees of freedom are those
    of such units, or of units with the variances that d shows, d² (and d⁴/3 for their squares), whichever are fewer.
    """
    if not np.isfinite(d).all():
        return None
    adds = d != 0
    n = int(adds.sum())
    if n == 0:
        return Spread(0.0, max(len(d) - 1.0, 1.0), len(d)) if len(d) > 1 else None
    if n == 1:
        return None
    size = np.abs(d).max()
    d = d[adds] / size  # fourth powers are on the way
    alone = d @ d * n / (n - 1)
    if weights is None:
        return Spread(float(size * np.sqrt(alone)), n - 1.0, n)
    w = weights[np.ix_(adds, adds)]
    rows = w.sum(axis=1)
    free = np.trace(w) - rows.sum() / n  # tr PWP, P = 1 − 11ᵀ/n
    freedom = free**2 / ((w**2).sum() - 2 * rows @ rows / n + (rows.sum() / n) ** 2)
    uneven = (d @ d) ** 2 / (d**2 @ w**2 @ d**2 - 2 / 3 * (d**4).sum())
    return Spread(float(size * np.sqrt(max(d @ w @ d * n / free, alone))), float(max(min(freedom, uneven), 1)), n)


def _interval(key: str, value: float, reach: float) -> Interval:
    """value ± reach; of a length, which is skewed and never negative, on the scale of its logarithm; a share of a whole
    ends at the whole."""
    metric = METRICS[key]
    if metric.unit == "mm" and metric.better != "zero" and value > 0:
        factor = float(np.exp(min(reach / value, 700.0)))
        return Interval(value / factor, value * factor)
    if metric.unit == "%":
        return Interval(min(max(value - reach, 0.0), value), min(value + reach, 100.0))
    return Interval(value - reach, value + reach)


def _quantile_interval(blocks: Blocks, units: Units, share: float) -> Interval | None:
    """Interval of a quantile of |error|, mm."""
    edge_m = np.quantile(blocks.absolute_m, share)
    count = np.ones_like(blocks.absolute_m), (blocks.absolute_m <= edge_m).astype(float)
    pixels, below = (units.totals(np.bincount(blocks.block, c, minlength=len(blocks.place))) for c in count)
    if np.count_nonzero(pixels) < 2:
        return None
    found = spread((below - pixels * below.sum() / pixels.sum()) / pixels.sum(), units.weights)
    if found is None:
        return None
    shares = np.clip([share - found.reach(), share + found.reach()], 0, 1)
    return Interval(*map(float, 1e3 * np.quantile(blocks.absolute_m, shares)))


def precision_interval(strongest_z_m: Sequence[np.ndarray], level: float = LEVEL) -> Interval | None:
    """χ² interval, in mm, of `metrics.precision`; None where that is None. ν s²/σ² is χ² with ν degrees of freedom for
    normal errors."""
    found = mean_deviation(strongest_z_m)
    if found is None:
        return None
    deviation_mm, freedom = found
    tails = np.array([(1 - level) / 2, (1 + level) / 2])
    return Interval(*map(float, deviation_mm * np.sqrt(freedom / chdtri(freedom, tails))))


def median_interval(values: np.ndarray, seed: int = 0) -> Interval | None:
    """Bootstrap interval of the median of independent `values` [n]; None for fewer than three."""
    if len(values) < 3:
        return None
    drawn = np.random.default_rng(seed).choice(values, size=(RESAMPLES, len(values)))
    return Interval(*map(float, np.quantile(np.median(drawn, axis=1), TAILS)))
