"""Which method is better: differences of pooled figures on the same captures, tested pair by pair."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd
from scipy.special import stdtr

from bench.evaluation.metrics import HEADLINE, METRICS, RATIOS, figures
from bench.evaluation.statistics.intervals import Blocks, Spread, contributions, cut, spread, units_of
from bench.results.error_map import ErrorMap
from bench.results.tables import COMPARISONS, LEVEL, conform
from radar.support.errors import HandbenchError


def compare(
    maps: Mapping[str, Sequence[ErrorMap]],
    reference: str,
    metric: str = HEADLINE,
    titles: Mapping[str, str] | None = None,
) -> pd.DataFrame:
    """Every pair of methods by one metric, as `COMPARISONS`. maps: method → its error maps of the same
    captures in the same order.

    Each method's figure is the table's, over its own observed pixels. A block (or capture) is left out for both at
    once: what both suffer from cancels. p: Student's t of the difference. Methods without a figure are left out.
    Raises HandbenchError for different captures and for metrics that are not ratios of sums or have no direction.
    """
    if len({len(m) for m in maps.values()}) > 1:
        raise HandbenchError(f"comparison: {', '.join(maps)} have unequal numbers of captures; expected the same ones")
    return compare_sums({method: block_sums(m) for method, m in maps.items()}, reference, metric, titles)


def block_sums(maps: Iterable[ErrorMap]) -> Blocks:
    """`statistics.cut` without the single pixels, which no comparison needs: little, however many maps."""
    return cut(maps, pixels=False)


def compare_sums(
    blocks: Mapping[str, Blocks], reference: str, metric: str, titles: Mapping[str, str] | None = None
) -> pd.DataFrame:
    """As `compare`, from each method's `block_sums`."""
    if metric not in RATIOS or METRICS[metric].better == "zero":
        raise HandbenchError(f"comparison: '{metric}' cannot be compared; expected a mean or a share, as {HEADLINE}")
    place = np.unique(np.concatenate([np.empty((0, 3), int), *(b.place for b in blocks.values())]), axis=0)
    units = units_of(place)
    sums = {method: b.at(place) for method, b in blocks.items()}
    values = {m: float(figures({k: v.sum() for k, v in s.items()})[metric]) for m, s in sums.items()}
    known = [method for method in blocks if np.isfinite(values[method])]
    parts = {method: contributions(units, sums[method])[metric] for method in known}
    pairs = [_ordered(pair, values, METRICS[metric].better) for pair in combinations(known, 2)]
    differences = [abs(values[worse] - values[better]) for better, worse in pairs]
    spreads = [spread(parts[worse] - parts[better], units.weights) for better, worse in pairs]
    corrected = holm([p_value(difference, s) for difference, s in zip(differences, spreads, strict=True)])
    lines = pd.DataFrame(pairs, columns=["better", "worse"]).assign(
        metric=metric, unit=METRICS[metric].unit, reference=reference, sentence="", difference=differences
    )
    reach = np.array([s.reach() if s else np.nan for s in spreads])
    lines["low"], lines["high"] = lines.difference - reach, lines.difference + reach
    lines["p_corrected"] = [p if s else np.nan for p, s in zip(corrected, spreads, strict=True)]
    lines["effect"] = [_effect(difference, s) for difference, s in zip(differences, spreads, strict=True)]
    lines["n_captures"], lines["n_blocks"] = len(np.unique(place[:, 0])), len(place)
    names = {method: (titles or {}).get(method, method) for method in blocks}
    lines["sentence"] = [_sentence(line, names) for line in lines.itertuples()]
    return conform(lines, COMPARISONS)


def _sentence(line: Any, names: Mapping[str, str]) -> str:
    better, worse, title = names[line.better], names[line.worse], METRICS[line.metric].title
    none = f"no difference shown between {better} and {worse} in {title}: "
    if np.isnan(line.low):
        return f"{none}too few blocks to test"
    amounts = amounts_text(line.difference, line.low, line.high, line.unit)
    if line.p_corrected < 1 - LEVEL:
        return f"{better} is better than {worse} by {amounts} ({title})"
    return none + amounts + (" before the correction for all pairs" if line.low > 0 else "")


def amounts_text(difference: float, low: float, high: float, unit: str) -> str:
    """A difference ≥ 0 with its interval in words, to the digits that are worth telling."""
    places = next((d for d, size in ((1, 1.0), (2, 0.1)) if round(difference, 9) >= size), 3)
    unit = "percentage points" if unit == "%" else unit
    return f"{difference:.{places}f} {unit} [{low:.{places}f}, {high:.{places}f}]".replace("-", "−")


def _ordered(pair: tuple[str, str], values: Mapping[str, float], direction: str) -> tuple[str, str]:
    """The better method first; the earlier one where they are equal."""
    first, second = pair
    ahead = values[second] < values[first] if direction == "lower" else values[second] > values[first]
    return (second, first) if ahead else pair


def p_value(difference: float, s: Spread | None) -> float:
    """Two-sided p of no difference; 1 where there is nothing to test it with."""
    if s is None or difference == 0:
        return 1.0
    if s.error == 0:
        return 0.0
    return float(2 * stdtr(s.freedom, -difference / s.error))


def _effect(difference: float, s: Spread | None) -> float | None:
    return difference / (s.error * np.sqrt(s.units)) if s and s.error else None


def holm(p: Sequence[float]) -> list[float]:
    """p-values corrected for as many tests (Holm 1979): the k-th smallest of m times m − k + 1, never falling, at most
    1."""
    order = np.argsort(p, kind="stable")
    factors = len(p) - np.arange(len(p))
    corrected = np.empty(len(p))
    corrected[order] = np.minimum(np.maximum.accumulate(np.asarray(p, float)[order] * factors), 1)
    return corrected.tolist()
