"""Comparison of methods. Equal treatment: on the pixels that all methods observe, with the same
smoothing, because much of an error depends on thresholds and filters. Statistical tests in which
each capture counts as one value: of two methods on the same captures, and of one method on
different captures."""

import warnings
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from handbench.bench.evaluation.depth_errors import ErrorMap
from handbench.bench.evaluation.intervals import (
    FEWEST,
    TAILS,
    counted,
    deviation,
    mean_deviation,
    mean_interval,
)
from handbench.bench.evaluation.metrics import (
    COMMON,
    HEADLINE,
    METRICS,
    TREATMENTS,
    Values,
    figures,
    on_common_pixels,
)
from handbench.bench.evaluation.tables import COMPARISONS, LEVEL, conform, each

FEWEST_PERCENT = 1.0  # of the surface; with fewer a method would decide the others' common pixels
ROUNDING = 1e-9  # of the figures: smaller scatter and smaller differences are roundings


def taking_part(maps: Mapping[str, np.ndarray], reference_z_m: np.ndarray) -> dict[str, np.ndarray]:
    """Select the methods that observe at least 1 % of the surface (FEWEST_PERCENT).
    maps: method → its depths [ny, nx], metres, NaN where there is none, on the pixel grid of the
    reference; reference_z_m [ny, nx]: depths of the surface, metres, NaN where there is none."""
    surface = np.isfinite(reference_z_m)
    fewest = FEWEST_PERCENT / 100 * surface.sum()
    return {m: z_m for m, z_m in maps.items() if (np.isfinite(z_m) & surface).sum() >= fewest}


def treated_figures(maps: Mapping[str, np.ndarray], reference_z_m: np.ndarray) -> dict[str, Values]:
    """Compute the figures of every method on one capture, under one equal treatment (same smoothing
    for all methods): method → metric → value.
    maps: method → its depths [ny, nx], metres, all on the pixel grid of the reference;
    reference_z_m [ny, nx]: depths of the surface, metres. Errors count only on the pixels that all
    methods observe."""
    common = np.isfinite([reference_z_m, *maps.values()]).all(axis=0)
    surface = np.isfinite(reference_z_m).sum()
    y, x = (np.arange(n, dtype=float) for n in common.shape)
    found = {}
    for method, z_m in maps.items():
        error_m = np.where(common, z_m - reference_z_m, np.nan)
        values = figures(ErrorMap(x, y, error_m, reference_z_m), place="common")
        values[COMMON] = 100 * float(common.sum() / surface) if surface else None
        found[method] = values
    return found


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
    gain = (b - a)[np.isfinite(b - a)]
    difference = float(pd.Series(gain).mean())
    interval = mean_interval(gain)
    if interval is None:
        return Difference(difference)
    size = np.nanmax(np.abs([a, b]))
    if deviation(gain) <= ROUNDING * size:
        return _without_scatter(difference, size)
    from scipy import stats  # takes a second

    return Difference(difference, *interval, float(stats.ttest_1samp(gain, 0).pvalue))


def welch_test(a: np.ndarray, b: np.ndarray) -> Difference:
    """Test B − A by Welch's t-test (1947), for two independent sets of captures.
    a [n], b [m]: one figure for each capture of A and of B. NaN are left out. With fewer than five
    captures (FEWEST) in either set, only the difference is returned."""
    a, b = a[np.isfinite(a)], b[np.isfinite(b)]
    difference = float(pd.Series(b).mean() - pd.Series(a).mean())
    if min(len(a), len(b)) < FEWEST:
        return Difference(difference)
    size = np.abs([*a, *b]).max()
    if max(deviation(a), deviation(b)) <= ROUNDING * size:
        return _without_scatter(difference, size)
    from scipy import stats

    with warnings.catch_warnings(action="ignore"):  # SciPy's, if one set does not scatter
        tested = stats.ttest_ind(b, a, equal_var=False)
    return Difference(difference, *map(float, (*tested.confidence_interval(LEVEL), tested.pvalue)))


def _without_scatter(difference: float, size: float) -> Difference:
    """Return a difference that is the same in all captures: certain, unless it is a rounding of
    figures of this size."""
    return Difference(difference, difference, difference, float(abs(difference) <= ROUNDING * size))


def f_test(hands_a: Sequence[np.ndarray], hands_b: Sequence[np.ndarray]) -> Difference:
    """Test the difference of two precisions, mm, by the F test of their variances.
    hands_a, hands_b: for each hand, the depth of its strongest scatterer in every repeat
    [n_repeats], metres. All repeats count as independent, which is cautious if both methods image
    the same echoes. The interval of the difference follows from that of the ratio of the
    precisions, multiplied by A's precision."""
    from scipy.special import fdtr, fdtrc, fdtri

    deviation_a, deviation_b = mean_deviation(hands_a), mean_deviation(hands_b)
    if deviation_a is None or deviation_b is None:
        return Difference(np.nan)
    (a, freedom_a), (b, freedom_b) = deviation_a, deviation_b
    if a == b:
        return Difference(0.0, 0.0, 0.0, 1.0)
    if not a or not b:
        return Difference(b - a)
    ratio = b / a
    freedom = freedom_b, freedom_a
    p = 2 * min(fdtr(*freedom, ratio**2), fdtrc(*freedom, ratio**2))
    low, high = a * (ratio / np.sqrt(fdtri(*freedom, TAILS[::-1])) - 1)
    return Difference(b - a, float(low), float(high), float(min(p, 1)))


def compare(
    figures: Mapping[str, np.ndarray],
    reference: str,
    metric: str = HEADLINE,
    titles: Mapping[str, str] | None = None,
    treatment: str = "",
) -> pd.DataFrame:
    """Test every pair of methods by one metric, of which lower or higher values are better. Returns
    the table COMPARISONS, with one line for each pair.
    figures: method → the metric on each capture [n], for the same captures in the same order.
    reference, treatment: written into the lines; treatment is the name of an equal treatment (same
    smoothing for all methods), or "" for methods with their own settings. titles: method → its name
    in the sentences. p-values are corrected for the number of pairs (Holm). The better method of a
    pair has the better mean on the captures that both have; equal methods keep their order. A pair
    without common captures is left out."""
    facts = METRICS[metric]
    sign = 1 if facts.better == "lower" else -1
    losses = {method: sign * of for method, of in figures.items()}
    lines = []
    for better, worse in combinations(losses, 2):
        gain = losses[worse] - losses[better]
        if np.nansum(gain) < 0:
            better, worse, gain = worse, better, -gain
        gain = gain[np.isfinite(gain)]
        if len(gain):
            test = paired_test(losses[better], losses[worse])
            spread = deviation(gain)
            effect = test.difference / spread if spread else np.nan  # Cohen's dz
            pair = {"better": better, "worse": worse, "effect": effect, "n_captures": len(gain)}
            lines.append(pair | test._asdict())
    table = pd.DataFrame(lines, columns=[*COMPARISONS, "p"])
    table["p_corrected"] = holm_corrected(table.p)
    table = table.assign(metric=metric, unit=facts.unit, reference=reference, treatment=treatment)
    title = facts.title
    if treatment:
        title += f"{on_common_pixels(metric)}, {TREATMENTS[treatment]}"
    names = {method: method for method in figures} | dict(titles or {})
    table["sentence"] = [
        finding(title, line, counted(line.n_captures), names[line.better], names[line.worse])
        for line in each(table)
    ]
    return conform(table, COMPARISONS)


def finding(title: str, line: Any, untested: str, better: str, worse: str) -> str:
    """Return the result of a test in a sentence.
    better, worse: names of what was compared; title: of the metric; line: of a table, with the
    difference ≥ 0, its interval, its unit and the corrected p; untested: why there is no test, if p
    is NaN."""
    size = round(line.difference, 9)
    places = 1 + sum(0 < size < limit for limit in (1, 0.1, 0.01, 1e-3))
    unit = "percentage points" if line.unit == "%" else line.unit
    amount = f"{line.difference:.{places}f} {unit}"
    if not np.isnan(line.low):
        amount += f" [{line.low:.{places}f}, {line.high:.{places}f}]".replace("-", "−")
    if np.isnan(line.p_corrected) and not size:
        return f"no difference between {better} and {worse} in {title}, not tested: {untested}"
    if np.isnan(line.p_corrected):
        return f"{better} is ahead of {worse} by {amount} ({title}), not tested: {untested}"
    if line.p_corrected < 1 - LEVEL:
        return f"{better} is better than {worse} by {amount} ({title})"
    return f"no difference shown between {better} and {worse} in {title}: {amount}"


def holm_corrected(p: Sequence[float] | pd.Series) -> list[float]:
    """Correct p-values for the number of tests (Holm 1979). Returns a list in the same order.
    The k-th smallest of m p-values is multiplied by m − k + 1. A larger p-value never gets a
    smaller result, and no result is above 1. NaN stay NaN and do not count as tests."""
    ordered = pd.Series(p, dtype=float).sort_values(kind="stable")
    factors = ordered.count() - np.arange(len(ordered))
    return (ordered * factors).cummax().clip(upper=1).sort_index().tolist()
