"""Statistical tests in which each capture counts as one value: of two methods on the same captures,
and of one method on different captures."""

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy import special

from handbench.bench.evaluation.equal_treatment import TREATMENTS, on_common_pixels
from handbench.bench.evaluation.intervals import FEWEST, TAILS, TOO_FEW, mean_interval
from handbench.bench.evaluation.metrics import HEADLINE, METRICS
from handbench.bench.evaluation.repeats import deviation, mean_deviation
from handbench.bench.evaluation.tables import COMPARISONS, LEVEL, conform
from handbench.support.errors import HandbenchError


class Difference(NamedTuple):
    """Result of a test of B against A, which are two methods or two results.
    difference: B − A in the metric's unit; low, high: its 95 % interval; p: p-value of the
    hypothesis that there is no difference, not corrected for further tests. NaN: unknown, or too
    few captures for a test."""

    difference: float
    low: float = np.nan
    high: float = np.nan
    p: float = np.nan


def paired_test(a: np.ndarray, b: np.ndarray) -> Difference:
    """Test B − A by Student's paired t-test.
    a, b [n]: figures of A and B on the same captures, in the same order. Pairing removes the error
    that a capture adds to both. Captures with NaN in either are left out. With fewer than five
    captures (FEWEST), only the difference is returned."""
    known = np.isfinite(a) & np.isfinite(b)
    gained = (b - a)[known]
    if not len(gained):
        return Difference(np.nan)
    difference, spread, n = float(gained.mean()), deviation(gained), len(gained)
    if (interval := mean_interval(gained)) is None:
        return Difference(difference)
    size = np.abs(np.stack([a, b])[:, known]).max()
    if spread <= 1e-12 * size:  # roundings
        return Difference(
            difference, difference, difference, 0.0 if abs(difference) > 1e-9 * size else 1.0
        )
    return Difference(
        difference,
        *interval,
        float(2 * special.stdtr(n - 1, -abs(difference) / spread * np.sqrt(n))),
    )


def welch_test(a: np.ndarray, b: np.ndarray) -> Difference:
    """Test B − A by Welch's t-test (1947), for two independent sets of captures.
    a [n], b [m]: one figure for each capture of A and of B. NaN are left out. With fewer than five
    captures (FEWEST) in either set, only the difference is returned."""
    a, b = (values[np.isfinite(values)] for values in (a, b))
    if not len(a) or not len(b):
        return Difference(np.nan)
    difference = float(b.mean() - a.mean())
    if min(len(a), len(b)) < FEWEST:
        return Difference(difference)
    parts = [deviation(values) ** 2 / len(values) for values in (a, b)]
    if not sum(parts):
        return Difference(difference, difference, difference, float(difference == 0))
    freedom = sum(parts) ** 2 / (parts[0] ** 2 / (len(a) - 1) + parts[1] ** 2 / (len(b) - 1))
    error = np.sqrt(sum(parts))
    reach = float(special.stdtrit(freedom, TAILS[1]) * error)
    p = float(2 * special.stdtr(freedom, -abs(difference) / error))
    return Difference(difference, difference - reach, difference + reach, p)


def f_test(hands_a: Sequence[np.ndarray], hands_b: Sequence[np.ndarray]) -> Difference:
    """Test the difference of two precisions, mm, by the F test of their variances.
    hands_a, hands_b: for each hand, the depth of its strongest scatterer in every repeat
    [n_repeats], metres. All repeats count as independent, which is cautious if both methods image
    the same echoes. The interval of the difference follows from that of the ratio of the
    precisions, multiplied by A's precision."""
    deviation_a, deviation_b = mean_deviation(hands_a), mean_deviation(hands_b)
    if deviation_a is None or deviation_b is None:
        return Difference(np.nan)
    (a, freedom_a), (b, freedom_b) = deviation_a, deviation_b
    if a == b:
        return Difference(0.0, 0.0, 0.0, 1.0)
    if not a or not b:
        return Difference(b - a)
    ratio, freedom = b / a, (freedom_b, freedom_a)
    p = 2 * min(special.fdtr(*freedom, ratio**2), special.fdtrc(*freedom, ratio**2))
    low, high = (a * (ratio / special.fdtri(*freedom, tail) ** 0.5 - 1) for tail in TAILS[::-1])
    return Difference(b - a, float(low), float(high), float(min(p, 1)))


def compare(
    figures: Mapping[str, np.ndarray],
    reference: str,
    metric: str = HEADLINE,
    titles: Mapping[str, str] | None = None,
    treatment: str = "",
) -> pd.DataFrame:
    """Test every pair of methods by one metric. Returns the table COMPARISONS, with one line for
    each pair.
    figures: method → the metric on each capture [n], for the same captures in the same order.
    reference, treatment: written into the lines; treatment is the name of an equal treatment (same
    smoothing for all methods), or "" for methods with their own settings. titles: method → its name
    in the sentences. p-values are corrected for the number of pairs (Holm). Methods without any
    figure are left out.
    Raises HandbenchError for unequal numbers of captures, and for a metric of which neither lower
    nor higher values are better."""
    if len({len(values) for values in figures.values()}) > 1:
        raise HandbenchError(
            f"comparison: {', '.join(figures)} have different numbers of captures; compare "
            "methods on the same captures"
        )
    if METRICS[metric].better == "zero":
        raise HandbenchError(
            f"comparison: '{metric}' cannot be compared, because neither lower nor higher is "
            f"better; use another metric such as {HEADLINE}"
        )
    known = [method for method, values in figures.items() if np.isfinite(values).any()]
    pairs = [_ordered(pair, figures, METRICS[metric].better) for pair in combinations(known, 2)]
    smaller_first = pairs if METRICS[metric].better == "lower" else [pair[::-1] for pair in pairs]
    tests = [paired_test(figures[small], figures[large]) for small, large in smaller_first]
    lines = pd.DataFrame(pairs, columns=["better", "worse"]).assign(
        metric=metric,
        unit=METRICS[metric].unit,
        reference=reference,
        sentence="",
        treatment=treatment,
    )
    for name in ("difference", "low", "high"):
        lines[name] = [getattr(tested, name) for tested in tests]
    lines["p_corrected"] = holm_corrected([t.p for t in tests])
    lines["effect"] = [_effect(figures[better], figures[worse]) for better, worse in pairs]
    lines["n_captures"] = [int(np.isfinite(figures[b] - figures[w]).sum()) for b, w in pairs]
    names = {method: (titles or {}).get(method, method) for method in figures}
    lines["sentence"] = [_sentence(line, names) for line in lines.itertuples()]
    return conform(lines, COMPARISONS)


def _sentence(line: Any, names: Mapping[str, str]) -> str:
    better, worse = names[line.better], names[line.worse]
    title = METRICS[line.metric].title
    if line.treatment:
        title += f"{on_common_pixels(line.metric)}, {TREATMENTS[line.treatment]}"
    none = f"no difference shown between {better} and {worse} in {title}: "
    if np.isnan(line.low):
        ahead = (
            f"{better} is ahead of {worse} by {amount_text(line.difference, line.unit)} "
            f"({title}) on"
        )
        return f"{ahead} {line.n_captures} captures: {TOO_FEW}"
    amounts = amounts_text(line.difference, line.low, line.high, line.unit)
    if line.p_corrected < 1 - LEVEL:
        return f"{better} is better than {worse} by {amounts} ({title})"
    return none + amounts + (" before the correction for all pairs" if line.low > 0 else "")


def amounts_text(difference: float, low: float, high: float, unit: str) -> str:
    """Write a difference ≥ 0 with its interval, such as "0.42 mm [0.31, 0.53]", rounded to its
    significant digits."""
    places = _places(difference)
    return f"{amount_text(difference, unit)} [{low:.{places}f}, {high:.{places}f}]".replace(
        "-", "−"
    )


def amount_text(difference: float, unit: str) -> str:
    """Write a difference with its unit, rounded to its significant digits. The unit "%" becomes
    "percentage points"."""
    shown = "percentage points" if unit == "%" else unit
    return f"{difference:.{_places(difference)}f} {shown}".replace("-", "−")


def _places(difference: float) -> int:
    return next((d for d, size in ((1, 1.0), (2, 0.1)) if round(abs(difference), 9) >= size), 3)


def _ordered(
    pair: tuple[str, str], figures: Mapping[str, np.ndarray], direction: str
) -> tuple[str, str]:
    """Return the pair of methods with the better one first, judged by the mean over the captures
    that both have. Equal methods keep their order.
    direction: "lower" or "higher" values of the metric are better."""
    first, second = pair
    gained = (
        np.nanmean(figures[second] - figures[first])
        if np.isfinite(figures[second] - figures[first]).any()
        else 0
    )
    return (second, first) if (gained < 0 if direction == "lower" else gained > 0) else pair


def _effect(a: np.ndarray, b: np.ndarray) -> float | None:
    """Return Cohen's d_z: |mean| of the differences b − a of the captures, divided by their
    standard deviation; None if that is 0 or unknown."""
    gained = (b - a)[np.isfinite(b - a)]
    spread = deviation(gained) if len(gained) > 1 else 0.0
    return abs(float(gained.mean())) / spread if spread else None


def holm_corrected(p: Sequence[float]) -> list[float]:
    """Correct p-values for the number of tests (Holm 1979). Returns a list in the same order.
    The k-th smallest of m p-values is multiplied by m − k + 1. A larger p-value never gets a
    smaller result, and no result is above 1. NaN stay NaN and do not count as tests."""
    given = np.asarray(p, float)
    found, known = given.copy(), np.flatnonzero(np.isfinite(given))
    order = known[np.argsort(given[known], kind="stable")]
    found[order] = np.minimum(
        np.maximum.accumulate(given[order] * (len(order) - np.arange(len(order)))), 1
    )
    return found.tolist()
