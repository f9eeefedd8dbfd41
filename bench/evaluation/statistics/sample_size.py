"""Captures that a comparison of methods takes: the variance of its figures, and the power of the tests of `paired`.

The figure of method m on capture c is y_mc = μ + method + capture + method × capture (+ residual). A paired test is
free of the capture's part; one between different captures, or different hands, bears it twice.
"""

from bisect import bisect_left
from collections.abc import Callable, Mapping
from functools import partial
from itertools import combinations
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy import optimize, stats

from handbench.bench.evaluation.metrics import deviation
from handbench.bench.evaluation.statistics.intervals import FEWEST, TAILS, Interval
from handbench.bench.results.tables import DESIGN, LEVEL, frame
from handbench.support.errors import HandbenchError

LEAST = 3  # captures whose variance is worth an answer at all
MOST = 100_000  # captures: more are told as none
ALPHA = 1 - LEVEL


class Components(NamedTuple):
    """Standard deviations between captures, of the methods' own on a capture, and between repeats of one method on one
    capture; NaN for these without repeats, which the second then holds too. Negative estimates of a variance are 0."""

    capture: float
    interaction: float
    residual: float
    captures: int


def components(figures: np.ndarray) -> Components:
    """Variance components of figures [captures, methods] or [captures, methods, repeats] by the two-way analysis of
    variance with random captures; captures that lack a figure are left out. Raises HandbenchError for fewer than LEAST
    captures or two methods."""
    cells = figures[..., None] if figures.ndim == 2 else figures
    cells = cells[np.isfinite(cells).all(axis=(1, 2))]
    n, k, r = cells.shape
    if n < LEAST or k < 2:
        raise HandbenchError(
            f"variance components: {n} captures of {k} methods have all figures; expected {LEAST} and 2 or more"
        )
    means = cells.mean(axis=2)
    of_captures, of_methods = means.mean(axis=1, keepdims=True), means.mean(axis=0)
    captures = r * k * of_captures.var(ddof=1)
    interaction = r * ((means - of_captures - of_methods + means.mean()) ** 2).sum() / ((n - 1) * (k - 1))
    residual = ((cells - means[..., None]) ** 2).sum() / (n * k * (r - 1)) if r > 1 else np.nan
    own = (interaction - residual) / r if r > 1 else interaction
    capture, own, residual = np.sqrt(np.maximum([(captures - interaction) / (r * k), own, residual], 0)).tolist()
    return Components(capture, own, residual, n)


def variance_facts(figures: Mapping[str, np.ndarray]) -> dict[str, float]:
    """`components` of method → a metric of the same captures [n], as plain values for a result's facts; nothing where
    there are too few, and no residual where it is not known."""
    try:
        found = components(np.stack(list(figures.values()), axis=1))._asdict()
    except HandbenchError:
        return {}
    return {name: float(value) for name, value in found.items() if np.isfinite(value)}


def paired_power(effect: float, spread: float, n: int, alpha: float = ALPHA) -> float:
    """Power of the two-sided paired t test of n captures, whose differences have this standard deviation."""
    return _power(effect * np.sqrt(n) / spread, n - 1, alpha) if spread else 1.0


def welch_power(effect: float, spreads: tuple[float, float], n: int, alpha: float = ALPHA) -> float:
    """Power of Welch's two-sided test of n captures of each of two methods, with these standard deviations; by the
    noncentral t of the degrees of freedom that the true variances have."""
    a, b = (spread**2 / n for spread in spreads)
    return _power(effect / np.sqrt(a + b), (a + b) ** 2 * (n - 1) / (a**2 + b**2), alpha) if a + b else 1.0


def _power(shift: float, freedom: float, alpha: float) -> float:
    """The share of noncentral t beyond the quantiles of Student's."""
    reach = stats.t.isf(alpha / 2, freedom)
    if shift > reach + 37:  # the noncentral t of larger shifts is NaN
        return 1.0
    return float(stats.nct.sf(reach, freedom, shift) + np.nan_to_num(stats.nct.cdf(-reach, freedom, shift)))


def captures_needed(power_of: Callable[[int], float], power: float) -> int | None:
    """The smallest number of captures, from 2 on, whose power is as large; None above MOST."""
    few = bisect_left(range(2, MOST + 1), power, key=power_of) + 2
    return few if few <= MOST else None


def detectable(spread: float, n: int, power: float, alpha: float = ALPHA) -> float:
    """The smallest effect that the paired test of n captures shows with this power."""
    if not spread:
        return 0.0
    most = (stats.t.isf(alpha / 2, n - 1) + 40) * spread
    return float(optimize.brentq(lambda effect: paired_power(effect, spread, n, alpha) - power, 0.0, most))


def spread_interval(spread: float, n: int) -> Interval:
    """Interval of the standard deviation of which n normal values show `spread`."""
    low, high = (spread * np.sqrt((n - 1) / stats.chi2.ppf(tail, n - 1)) for tail in TAILS[::-1])
    return Interval(float(low), float(high))


def design(figures: Mapping[str, np.ndarray], effect: float, power: float = 0.8) -> pd.DataFrame:
    """Every pair of methods as `DESIGN`: the captures that show an effect with this power. figures: method → a metric
    of the same captures [n]. No answer is below FEWEST, for fewer are not tested. Raises HandbenchError for fewer than
    LEAST captures that all methods have."""
    table = np.stack(list(figures.values()), axis=1)
    table = table[np.isfinite(table).all(axis=1)]
    n = components(table).captures
    pairs = list(combinations(zip(figures, table.T, strict=True), 2))

    def paired(spread: float, alpha: float = ALPHA) -> int | None:
        return _tested(captures_needed(lambda n: paired_power(effect, spread, n, alpha), power))

    lines = []
    for (a, of_a), (b, of_b) in pairs:
        spread, alone = deviation(of_b - of_a), (deviation(of_a), deviation(of_b))
        low, high = map(paired, spread_interval(spread, n))
        apart = captures_needed(partial(welch_power, effect, alone), power)
        lines.append(
            {
                "a": a,
                "b": b,
                "difference": float((of_b - of_a).mean()),
                "spread": spread,
                "needed": paired(spread),
                "needed_low": low,
                "needed_high": high,
                "needed_corrected": paired(spread, ALPHA / len(pairs)),
                "needed_apart": _tested(apart),
                "detectable": detectable(spread, n, power),
                "n_captures": n,
            }
        )
    return frame(DESIGN, lines)


def _tested(captures: int | None) -> int | None:
    """As many captures as are tested at all."""
    return None if captures is None else max(captures, FEWEST)
