"""Number of captures that a comparison of methods needs: variance components of a metric, and power
of the t-tests.

The value of a metric for method m on capture c is y_mc = μ + method + capture + method × capture (+
residual). A paired test cancels the component of the capture. A test between different captures, or
different hands, contains it twice.
"""

from bisect import bisect_left
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import nctdtr, stdtrit

from handbench.bench.evaluation.intervals import FEWEST
from handbench.bench.evaluation.tables import LEVEL
from handbench.support.errors import HandbenchError

LEAST = 3  # captures whose variance is worth an answer at all
MOST = 100_000  # captures; larger numbers become None
ALPHA = 1 - LEVEL
POWER = 0.8  # the chance of showing a difference that there is


class Components(NamedTuple):
    """Standard deviations of a metric's variance components, and the number of captures used.
    capture: differences between captures; interaction: differences that depend on both method and
    capture; residual: differences between repeats of one method on one capture, NaN without repeats
    (the interaction then includes them). A variance estimated as negative becomes 0."""

    capture: float
    interaction: float
    residual: float
    captures: int


def components(figures: np.ndarray) -> Components:
    """Estimate the variance components of a metric by two-way analysis of variance with random
    captures.
    figures: [captures, methods] or [captures, methods, repeats]. Captures that lack a figure are
    left out. Raises HandbenchError for fewer than three captures (LEAST) or fewer than two
    methods."""
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
    """Return the variance components of a metric for result.json: name → standard deviation, and
    the number of captures.
    figures: method → the metric on the same captures [n]. Empty if there are too few captures or
    methods; an unknown residual is left out."""
    try:
        found = components(np.stack(list(figures.values()), axis=1))._asdict()
    except HandbenchError:
        return {}
    return {name: float(value) for name, value in found.items() if np.isfinite(value)}


def paired_power(effect: float, spread: float, n: int, alpha: float = ALPHA) -> float:
    """Compute the power of the two-sided paired t-test with n captures at significance level alpha.
    effect: true mean difference; spread: standard deviation of the captures' differences, in the
    same unit."""
    return _power(effect * np.sqrt(n) / spread, n - 1, alpha) if spread else 1.0


def welch_power(effect: float, spreads: tuple[float, float], n: int, alpha: float = ALPHA) -> float:
    """Compute the power of Welch's two-sided test of two groups of n captures each, at significance
    level alpha.
    effect: true difference of the means; spreads: standard deviation in each group. Uses the
    noncentral t distribution, with the degrees of freedom of the true variances."""
    a, b = (spread**2 / n for spread in spreads)
    return (
        _power(effect / np.sqrt(a + b), (a + b) ** 2 * (n - 1) / (a**2 + b**2), alpha)
        if a + b
        else 1.0
    )


def _power(shift: float, freedom: float, alpha: float) -> float:
    """Return the probability that a noncentral t (noncentrality `shift`) is beyond Student's
    two-sided critical values at level alpha."""
    reach = -stdtrit(freedom, alpha / 2)
    # NaN where it is too small for a number
    below, above = np.nan_to_num(nctdtr(freedom, shift, np.array([-reach, reach])))
    return float(1 - (above - below))


def captures_needed(power_of: Callable[[int], float], power: float) -> int | None:
    """Find the smallest number of captures, from 2 on, with which a test has at least the given
    power. None if it is above 100 000 (MOST).
    power_of: function from a number of captures to the power of the test."""
    few = bisect_left(range(2, MOST + 1), power, key=power_of) + 2
    return few if few <= MOST else None


def hands_needed(difference: float, spreads: Sequence[float], alpha: float = ALPHA) -> int | None:
    """Find the number of captures that show a given difference of means at level alpha with a power
    of 80 % (POWER).

    spreads: one standard deviation, that of the pairs' differences (paired t-test; the result is
    the number of pairs), or one for each of two groups (Welch's test; the result is the size of
    each group). The result is at least five (FEWEST), the smallest sample that is tested. None if
    the difference is 0 or not finite, or if more than 100 000 captures (MOST) are needed.
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
