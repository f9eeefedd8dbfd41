"""Confidence intervals in which each capture counts as one value.

An interval must hold for captures that were not measured. Captures differ: another hand, or the
same hand placed again, has an error that all of its pixels share. So each capture is one value,
however many pixels it has. Figures of captures have skewed distributions, so Student's t is
transformed as by Hall (1992, "On the removal of skewness by transformation", J. R. Stat. Soc. B
54). Fewer than five captures (FEWEST) give no interval. `tests/bench/evaluation/test_statistics.py`
measures how often the intervals contain the true value.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from handbench.bench.evaluation.repeats import deviation, mean_deviation
from handbench.bench.evaluation.tables import LEVEL

FEWEST = 5  # captures: of four, the spread itself is known to 40 %, and t's quantile is above 3
TAILS = ((1 - LEVEL) / 2, (1 + LEVEL) / 2)  # shares of a distribution below an interval's ends
RESAMPLES = 2000
DRAWN_AT_ONCE = 100_000  # values of resamples in memory, however many captures there are
TOO_FEW = "too few captures for a test"


class Interval(NamedTuple):
    """Lower and upper end of a confidence interval, in the unit of the figure."""

    low: float
    high: float


def mean_interval(values: Sequence[float] | np.ndarray) -> Interval | None:
    """Compute the 95 % interval of a figure's mean over captures, from its value on each capture
    [n].
    NaN are left out. Returns None for fewer than five captures (FEWEST).
    Student's T = (m − μ)/s is corrected for the skewness γ (Hall 1992): T + γT²/3 + γ²T³/27 + γ/6n
    follows Student's distribution more closely. The ends of the interval are transformed back."""
    from scipy.special import stdtrit

    known = np.asarray(values, float)
    known = known[np.isfinite(known)]
    n = len(known)
    if n < FEWEST:
        return None
    mean, spread = known.mean(), deviation(known)
    quantiles = stdtrit(n - 1, np.array(TAILS)[::-1]) / np.sqrt(n)
    skew = float((((known - mean) / spread) ** 3).mean() * (n / (n - 1)) ** 1.5) if spread else 0.0
    if abs(skew) > 1e-6:  # below, the transformation is the identity to rounding
        quantiles = 3 / skew * (np.cbrt(1 + skew * (quantiles - skew / (6 * n))) - 1)
    low, high = mean - spread * quantiles
    return Interval(float(low), float(high))


def note(captures: int) -> str:
    """Return a sentence that says on how many captures the intervals are based, or that there are
    too few for intervals."""
    if captures >= FEWEST:
        return f"{captures} captures: the intervals are those of the mean over captures like these"
    counted = f"{captures} capture{'s' * (captures > 1)}"
    return f"{counted}: no intervals, which need at least {FEWEST} captures"


def precision_interval(strongest_z_m: Sequence[np.ndarray]) -> Interval | None:
    """Compute the 95 % interval, mm, of the precision: the standard deviation of depth over
    repeated frames, averaged over the hands.
    strongest_z_m: for each hand, the depth of its strongest scatterer in every repeat [n_repeats],
    metres. It is the χ² interval of a standard deviation, for further repeats of the same hands,
    whose errors are independent. None if a hand has fewer than two usable repeats."""
    from scipy.special import chdtri

    known = mean_deviation(strongest_z_m)
    if known is None:
        return None
    deviation_mm, freedom = known
    below, above = TAILS
    low, high = (
        deviation_mm * (freedom / chdtri(freedom, share_above)) ** 0.5
        for share_above in (below, above)
    )
    return Interval(float(low), float(high))


def median_interval(values: np.ndarray, seed: int = 0) -> Interval | None:
    """Compute the 95 % interval of the median of independent `values` [n] by bootstrap. Returns
    None for fewer than three values."""
    if len(values) < 3:
        return None
    generator, rows = np.random.default_rng(seed), max(DRAWN_AT_ONCE // len(values), 1)
    sizes = [(min(rows, RESAMPLES - first), len(values)) for first in range(0, RESAMPLES, rows)]
    medians = np.concatenate([np.median(generator.choice(values, size), axis=1) for size in sizes])
    return Interval(*map(float, np.quantile(medians, TAILS)))
