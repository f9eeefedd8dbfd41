"""Ranking of the methods of several results, on the captures that all results have.

Methods are ranked by the share of the surface whose depth is right within 2 mm. It counts holes as
wrong, and unlike figures under equal treatment, it does not depend on the other methods of a run.
"""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from handbench.bench.evaluation.intervals import mean_interval
from handbench.bench.evaluation.paired import compare
from handbench.bench.evaluation.tables import RANKING, ByMethod, by_method, conform
from handbench.bench.results.about import HEADLINE, REFERENCES
from handbench.bench.results.compare_results import require_comparable
from handbench.bench.results.result_folder import Result, shown
from handbench.support.errors import HandbenchError

BY = "complete_2mm_percent"
OVER, EQUAL = "aurc_mm", "window"  # the error over completeness, all maps averaged


def rank_methods(results: Sequence[Result]) -> tuple[pd.DataFrame, str]:
    """Rank the methods of several results on the captures that all results have. Returns the table
    RANKING, best method first, and a sentence on the captures.
    The rank of a method is one more than the number of methods that are significantly better (95 %,
    Holm); 0 if there are too few captures for a test. Raises HandbenchError for results with
    different protocols, or without a common capture with a common reference."""
    for result in results[1:]:
        require_comparable(results[0], result)
    reference, captures = _common(results)
    values: dict[str, np.ndarray] = {}
    lines = []
    for number, result in enumerate(results):
        own, treated = (by_method(result.scores, reference, treatment) for treatment in ("", EQUAL))
        for method in result.about.methods:
            key = f"{number}/{method.name}"
            right, mae_mm = (
                _figures(own, method.name, metric, captures) for metric in (BY, HEADLINE)
            )
            values[key] = right
            equal = result.equal[
                (result.equal.method == method.name) & (result.equal.treatment == EQUAL)
            ]
            share = equal[equal.metric == "aurc_to_percent"].value
            time = result.time(method.name)
            low, high = mean_interval(right) or (np.nan, np.nan)
            line = {
                "key": key,
                "result": str(result.folder),
                "method": method.title,
                BY: right.mean(),
                "low": low,
                "high": high,
                HEADLINE: mae_mm.mean(),
                OVER: _figures(treated, method.name, OVER, captures).mean(),
                "aurc_to_percent": share.iloc[0] if len(share) else np.nan,
                "seconds": np.nan if time is None else time.value,
            }
            lines.append(line)
    compared = compare(values, reference, BY)
    tested = bool(compared.p_corrected.notna().any())
    beaten = compared[shown(compared)].worse.value_counts()
    table = pd.DataFrame(lines).sort_values(BY, ascending=False, kind="stable")
    table["rank"] = [1 + int(beaten.get(key, 0)) if tested else 0 for key in table.key]
    return conform(table, RANKING), _about(results, reference, captures, tested)


def _common(results: Sequence[Result]) -> tuple[str, list[str]]:
    """Choose the reference (a measured mesh, or the true surface) with which all results scored
    some of the same captures, and return its name and the names of these captures. Of several, that
    with the larger surface is taken.
    Raises HandbenchError if there is none."""
    for reference in ("completed", *REFERENCES):
        names = [_captures(result, reference) for result in results]
        if common := [name for name in names[0] if all(name in other for other in names)]:
            return reference, common
    folders = ", ".join(str(result.folder) for result in results)
    raise HandbenchError(
        f"{folders}: these results have no capture in common; run the methods on the same captures"
    )


def _captures(result: Result, reference: str) -> list[str]:
    lines = result.scores[(result.scores.metric == BY) & (result.scores.reference == reference)]
    return list(dict.fromkeys(lines.capture))


def _figures(found: ByMethod, method: str, metric: str, captures: Sequence[str]) -> np.ndarray:
    """Return one metric of a method on each capture [n], NaN where it has none.
    found: method → figures, one line for each capture."""
    known = found.get(method, pd.DataFrame()).reindex(list(captures), columns=[metric])
    return known[metric].to_numpy(float)


def _about(results: Sequence[Result], reference: str, captures: Sequence[str], tested: bool) -> str:
    hashes = {name: {result.about.inputs.get(name, "") for result in results} for name in captures}
    changed = [name for name, found in hashes.items() if len(found) > 1]
    few = ", ".join(changed[:3]) + (", …" if len(changed) > 3 else "")
    parts = [
        f"{len(captures)} capture{'s' * (len(captures) > 1)} that all results have, against "
        f"{reference}.",
        "Sorted by the share of the surface that is right within 2 mm, each method as it is.",
        "The rank is one more than the number of methods that are shown to be better (95 %, Holm)."
        if tested
        else "These are too few captures to test, so there are no ranks.",
        "Errors over completeness, all maps averaged, are comparable only between methods of one "
        "result.",
        *([f"Captures with different content hashes in the results: {few}."] if changed else []),
    ]
    return " ".join(parts)
