"""The precision of a method, and confidence intervals in which each capture counts as one value.

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

from handbench.bench.evaluation.tables import LEVEL

FEWEST = 5  # captures: of four, the spread itself is known to 40 %, and t's quantile is above 3
TAILS = ((1 - LEVEL) / 2, (1 + LEVEL) / 2)  # shares of a distribution below an interval's ends
RESAMPLES = 2000


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
    finite = np.asarray(values, float)
    finite = finite[np.isfinite(finite)]
    n = len(finite)
    if n < FEWEST:
        return None
    from scipy.special import stdtrit  # scipy.stats takes a second, and forty times as long

    mean = finite.mean()
    spread = deviation(finite)
    quantiles = stdtrit(n - 1, TAILS[::-1]) / np.sqrt(n)
    skew = float((((finite - mean) / spread) ** 3).mean() * (n / (n - 1)) ** 1.5) if spread else 0.0
    if abs(skew) > 1e-6:  # below, the transformation is the identity to rounding
        quantiles = 3 / skew * (np.cbrt(1 + skew * (quantiles - skew / (6 * n))) - 1)
    return Interval(*(mean - spread * quantiles).tolist())


def counted(captures: int) -> str:
    """Return a number of captures in words, such as "1 capture"."""
    return f"{captures} capture{'' if captures == 1 else 's'}"


def note(captures: int) -> str:
    """Return a sentence that says on how many captures the intervals are based, or that there are
    too few for intervals."""
    if captures < FEWEST:
        return f"{counted(captures)}: no tests or intervals of errors, which need {FEWEST} captures"
    return f"{counted(captures)}: the intervals are those of the mean over captures like these"


def precision_mm(strongest_z_m: Sequence[np.ndarray]) -> float | None:
    """Compute the precision, mm: the standard deviation over the repeats, averaged over the hands.
    strongest_z_m: for each hand, the depth of its strongest scatterer in every repeat [n_repeats],
    metres. None if a hand has fewer than two usable repeats."""
    spread = mean_deviation(strongest_z_m)
    return spread[0] if spread else None


def relative_precision_percent(strongest_z_m: Sequence[np.ndarray]) -> float | None:
    """Compute the relative precision, 100 (1 − precision / mean depth) %, from the same depths."""
    hands = usable_repeats(strongest_z_m)
    distance_m = np.mean([z.mean() for z in hands]) if hands else 0.0
    if not distance_m:
        return None
    return float(100 * (1 - np.mean([deviation(z) for z in hands]) / distance_m))


def deviation(values: np.ndarray) -> float:
    """Return the standard deviation (n − 1) of `values` [n ≥ 2]; exactly 0 if all values are
    equal."""
    return float(np.std(values, ddof=1)) if np.ptp(values) > 0 else 0.0


def usable_repeats(strongest_z_m: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Remove the repeats in which nothing was imaged (NaN) from the depths of each hand.
    strongest_z_m: for each hand, depths [n_repeats]. Returns an empty list if any hand keeps fewer
    than two, because a mean over fewer hands would be another figure."""
    hands = [z[np.isfinite(z)].astype(np.float64) for z in strongest_z_m]
    return hands if all(len(z) > 1 for z in hands) else []


def mean_deviation(strongest_z_m: Sequence[np.ndarray]) -> tuple[float, float] | None:
    """Return the standard deviation of depth over repeats, mm, averaged over the hands, and its
    degrees of freedom.
    strongest_z_m: for each hand, depths [n_repeats], metres. Degrees of freedom are ν = (Σ s)² / Σ
    (s²/ν_hand) (Welch–Satterthwaite). None if a hand has fewer than two usable repeats."""
    hands = usable_repeats(strongest_z_m)
    if not hands:
        return None
    each_mm = np.array([1e3 * deviation(z) for z in hands])
    freedom = np.array([len(z) - 1 for z in hands])
    if not each_mm.any():
        return 0.0, float(freedom.sum())
    return float(each_mm.mean()), float(each_mm.sum() ** 2 / (each_mm**2 / freedom).sum())


def precision_interval(strongest_z_m: Sequence[np.ndarray]) -> Interval | None:
    """Compute the 95 % interval, mm, of the precision: the standard deviation of depth over
    repeated frames, averaged over the hands.
    strongest_z_m: for each hand, the depth of its strongest scatterer in every repeat [n_repeats],
    metres. It is the χ² interval of a standard deviation, for further repeats of the same hands,
    whose errors are independent. None if a hand has fewer than two usable repeats."""
    from scipy.special import chdtri

    spread = mean_deviation(strongest_z_m)
    if spread is None:
        return None
    deviation_mm, freedom = spread
    ends = deviation_mm * np.sqrt(freedom / chdtri(freedom, TAILS))
    return Interval(*ends.tolist())


def median_interval(values: np.ndarray, seed: int = 0) -> Interval | None:
    """Compute the 95 % interval of the median of independent `values` [n] by bootstrap. Returns
    None for fewer than three values."""
    if len(values) < 3:
        return None
    resamples = np.random.default_rng(seed).choice(values, (RESAMPLES, len(values)))
    return Interval(*np.quantile(np.median(resamples, axis=1), TAILS).tolist())
