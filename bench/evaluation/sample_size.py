"""Number of captures that a comparison of methods needs: variance components of its figures, and
the power of the tests in `paired`.

The figure of method m on capture c is y_mc = μ + method + capture + method × capture (+ residual).
A paired test cancels the capture's component; a test between different captures, or different
hands, contains it twice.
"""

from bisect import bisect_left
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy import stats

from handbench.bench.evaluation.intervals import FEWEST
from handbench.bench.evaluation.tables import LEVEL
from handbench.support.errors import HandbenchError

LEAST = 3  # captures whose variance is worth an answer at all
MOST = 100_000  # captures; larger numbers become None
ALPHA = 1 - LEVEL
POWER = 0.8  # the chance of showing a difference that there is


class Components(NamedTuple):
    """Standard deviations of the variance components of a metric, and the number of captures used.
    capture: between captures; interaction: of method and capture; residual: between repeats of one
    method on one capture, NaN without repeats (the interaction then includes it). Negative
    estimates of a variance become 0."""

    capture: float
    interaction: float
    residual: float
    captures: int


def components(figures: np.ndarray) -> Components:
    """Estimate the variance components of a metric by the two-way analysis of variance, captures
    random.
    figures: [captures, methods] or [captures, methods, repeats]. Captures that lack a figure are
    left out. Raises HandbenchError for fewer than LEAST captures or two methods."""
    cells = figures[..., None] if figures.ndim == 2 else figures
    cells = cells[np.isfinite(cells).all(axis=(1, 2))]
    n, k, r = cells.shape
    if n < LEAST or k < 2:
        raise HandbenchError(
            f"variance components: need at least {LEAST} captures and 2 methods with all figures, "
            f"but there are {n} captures and {k} methods; add captures or methods"
        )
    means = cells.mean(axis=2)
    of_captures, of_methods = means.mean(axis=1, keepdims=True), means.mean(axis=0)
    captures = r * k * of_captures.var(ddof=1)
    interaction = (
        r * ((means - of_captures - of_methods + means.mean()) ** 2).sum() / ((n - 1) * (k - 1))
    )
    residual = ((cells - means[..., None]) ** 2).sum() / (n * k * (r - 1)) if r > 1 else np.nan
    own = (interaction - residual) / r if r > 1 else interaction
    capture, own, residual = np.sqrt(
        np.maximum([(captures - interaction) / (r * k), own, residual], 0)
    ).tolist()
    return Components(capture, own, residual, n)


def variance_facts(figures: Mapping[str, np.ndarray]) -> dict[str, float]:
    """Return the variance components of a metric by name, as plain numbers for result.json.
    figures: method → the metric on the same captures [n]. Empty for too few captures; the residual
    is left out if it is unknown."""
    try:
        found = components(np.stack(list(figures.values()), axis=1))._asdict()
    except HandbenchError:
        return {}
    return {name: float(value) for name, value in found.items() if np.isfinite(value)}


def paired_power(effect: float, spread: float, n: int, alpha: float = ALPHA) -> float:
    """Compute the power of the two-sided paired t-test of n captures at level alpha.
    effect: true mean difference; spread: standard deviation of the captures' differences, in the
    same unit."""
    return _power(effect * np.sqrt(n) / spread, n - 1, alpha) if spread else 1.0


def welch_power(effect: float, spreads: tuple[float, float], n: int, alpha: float = ALPHA) -> float:
    """Compute the power of Welch's two-sided test of two groups of n captures each, at level alpha.
    effect: true difference of the means; spreads: standard deviation in each group. Uses the
    noncentral t with the degrees of freedom of the true variances."""
    a, b = (spread**2 / n for spread in spreads)
    return (
        _power(effect / np.sqrt(a + b), (a + b) ** 2 * (n - 1) / (a**2 + b**2), alpha)
        if a + b
        else 1.0
    )


def _power(shift: float, freedom: float, alpha: float) -> float:
    """Probability that a noncentral t is beyond Student's critical values."""
    reach = stats.t.isf(alpha / 2, freedom)
    if shift > reach + 37:  # the noncentral t of larger shifts is NaN
        return 1.0
    return float(
        stats.nct.sf(reach, freedom, shift) + np.nan_to_num(stats.nct.cdf(-reach, freedom, shift))
    )


def captures_needed(power_of: Callable[[int], float], power: float) -> int | None:
    """Find the smallest number of captures, from 2 on, with at least this power; None above MOST.
    power_of: number of captures → power of the test."""
    few = bisect_left(range(2, MOST + 1), power, key=power_of) + 2
    return few if few <= MOST else None


def hands_needed(difference: float, spreads: Sequence[float], alpha: float = ALPHA) -> int | None:
    """Find the number of captures that show this difference of means at level alpha with a power of
    POWER.

    spreads: one standard deviation, of the differences of pairs (paired t-test; the number is of
    pairs), or two, of each group (Welch's test; the number is of each group). The result is at
    least FEWEST, the smallest sample that is tested. None: there is no difference, or more than
    MOST are needed.
    """
    if not difference or not np.isfinite(difference):
        return None
    if len(spreads) == 1:
        needed = captures_needed(
            lambda n: paired_power(abs(difference), spreads[0], n, alpha), POWER
        )
    else:
        one, other = spreads
        needed = captures_needed(
            lambda n: welch_power(abs(difference), (one, other), n, alpha), POWER
        )
    return None if needed is None else max(needed, FEWEST)
