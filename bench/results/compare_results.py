"""Comparison of two results, A and B: their figures and the differences, on average and for each
capture, with confidence intervals and tests.

Every comparison begins with MAE, MAX, completeness, precision and time (FIRST). If both results
have the same captures, each method is compared capture by capture, so that the errors of the
captures cancel. Otherwise A and B are two independent samples (Welch's test). Each capture counts
as one value. Tested are the metrics that the protocol names, and the precision by the F test of the
variances. The p-values of all tests are corrected together (Holm). Times are not tested, because
repeats within a run do not show the difference between two runs.

`handbench compare` writes

compare.json  both results, what was compared, every difference, and provenance
compare.csv   one line per metric, method, reference and capture: `DIFFERENCES` in
              `bench.evaluation.tables`
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import pandas as pd

from handbench.bench.evaluation.combine import STRONGEST
from handbench.bench.evaluation.intervals import FEWEST, counted, note, precision_mm
from handbench.bench.evaluation.metrics import METRICS, chosen
from handbench.bench.evaluation.paired import (
    Difference,
    f_test,
    finding,
    holm_corrected,
    paired_test,
    welch_test,
)
from handbench.bench.evaluation.scoring_protocols import REFERENCES
from handbench.bench.evaluation.tables import CHANGES, DIFFERENCES, LEVEL, conform, frame
from handbench.bench.results.derived import compared_metrics
from handbench.bench.results.result_folder import Result
from handbench.support.config import plain_toml
from handbench.support.errors import HandbenchError

PRECISION = "precision_mm"
TIME = "seconds"
FIRST = chosen("compare")  # tested or not
UNTESTED = {PRECISION: "no scatter of repeats in A or in B", TIME: "one run each"}
OTHER_PIXELS = "each on its own pixels"
KEYS = ["metric", "method", "reference"]
FIGURES = ("a", "a_low", "a_high", "b", "b_low", "b_high")
# of the pixels that either reference has, both must have, to be one hand in one place
SAME_SHARE = 0.9
SAME_M = 5e-4  # and differ by at most this in the median


@dataclass(frozen=True, eq=False)
class Compared:
    """The comparison of two results, A and B.
    basis: sentence on which captures were compared. differences: table with lines for each metric,
    method and reference: first the mean over the captures, then each capture. changes: table of the
    settings, versions and inputs that differ between A and B."""

    a: Result
    b: Result
    basis: str
    differences: pd.DataFrame
    changes: pd.DataFrame

    def content(self) -> dict[str, Any]:
        """Return the comparison as dictionaries and lists, as in compare.json."""
        tables = {"differences": self.differences, "changes": self.changes}
        return {
            "a": str(self.a.folder),
            "b": str(self.b.folder),
            "basis": self.basis,
            **{
                name: of.astype(object).where(of.notna(), None).to_dict("records")
                for name, of in tables.items()
            },
        }


def compare_results(a: Result, b: Result) -> Compared:
    """Compare two results: B's figures minus A's, with confidence intervals and tests, for every
    method that both have.
    Raises HandbenchError for results with different protocols or definitions, or without a common
    method and a common reference."""
    require_comparable(a, b)
    methods = [name for name in a.about.method_titles if name in b.about.method_titles]
    references = [name for name in references_of(a) if name in references_of(b)]
    if not methods or not references:
        raise HandbenchError(
            f"{a.folder}, {b.folder}: the two results have no "
            f"{'reference' if methods else 'method'} in common; expected at least one"
        )
    ours, theirs = (_captures(of, references[0]) for of in (a, b))
    same = [name for name in ours if name in theirs and _same(a, b, name, references[0])]
    figures = pd.merge(_figures(a, "a"), _figures(b, "b"), "outer")
    if same:
        figures = figures[figures.capture.isin(same) | (figures.reference == "")]
    figures["difference"] = figures.b - figures.a
    figures[["n_a", "n_b"]] = figures[["a", "b"]].notna().astype(int)
    groups = dict(iter(figures.groupby(KEYS)))
    tested = compared_metrics(a.about.protocol)
    lines: list[dict[Any, Any]] = []
    for key in product(dict.fromkeys((*FIRST, *tested)), methods, (*references, "")):
        metric, method, reference = key
        if key not in groups:
            continue
        captures = groups[key]
        if reference:
            ends = [_mean(metric, captures[side]) for side in "ab"]
            test, untested = _error_test(captures, bool(same), metric in tested)
        else:
            ends = [_in_table(result, metric, method, references[0]) for result in (a, b)]
            test = Difference(ends[1][0] - ends[0][0])
            if metric == PRECISION:
                test = f_test(_hands(a, method), _hands(b, method))
            untested = UNTESTED[metric]
        mean = dict(zip((*KEYS, *FIGURES), (*key, *ends[0], *ends[1]), strict=True))
        mean |= test._asdict() | dict(captures[["n_a", "n_b"]].sum())
        lines += [mean | {"untested": untested}, *captures.to_dict("records")]
    table = pd.DataFrame(lines, columns=[*DIFFERENCES, "p"])
    table["title"] = table.method.map(a.about.method_titles)
    table["paired"] = bool(same) & (table.reference != "")
    basis = (
        f"The same captures ({', '.join(same)}), pair by pair; {note(len(same))}."
        if same
        else f"Different captures, as two independent samples; A: {note(len(ours))}; "
        f"B: {note(len(theirs))}."
    )
    for side, result, other in (("A", a, b), ("B", b, a)):
        names = [name for name in result.about.method_titles if name not in methods]
        names += [name for name in references_of(result) if name not in references_of(other)]
        names += [name for name in _captures(result, references[0]) if same and name not in same]
        basis += f" Only {side} has {', '.join(names)}." if names else ""
    return Compared(a, b, basis, _with_findings(table), changes(a, b))


def references_of(result: Result) -> list[str]:
    """Return the references that a result has, in their order."""
    return [name for name in REFERENCES if _captures(result, name)]


def _mean(metric: str, figures: pd.Series) -> tuple[float, float, float]:
    """Return the mean of a metric over captures and the ends of its interval."""
    low, high = METRICS[metric].interval(figures.dropna().to_numpy()) or (np.nan, np.nan)
    return float(figures.mean()), low, high


def _in_table(
    result: Result, metric: str, method: str, reference: str
) -> tuple[float, float, float]:
    """Return a figure of the main table and the ends of its interval; NaN if it has none."""
    row = result.row(metric, method, reference)
    return (row.value, row.low, row.high) if row else (np.nan, np.nan, np.nan)


def _hands(result: Result, method: str) -> list[np.ndarray]:
    """Return for each hand the depths of its strongest scatterer in every repeat, metres."""
    repeats = result.repeats[result.repeats.method == method]
    return [z_m.to_numpy() for _, z_m in repeats.groupby("capture", sort=False).z_m]


def _error_test(captures: pd.DataFrame, paired: bool, tested: bool) -> tuple[Difference, str]:
    """Test the difference of a metric between A and B, whose figures on the captures are the
    columns a and b. Returns it and the reason why it may have no p.
    tested: False if the protocol does not compare methods by the metric."""
    test = (paired_test if paired else welch_test)(captures.a.to_numpy(), captures.b.to_numpy())
    usable = captures.difference.count() if paired else min(captures.a.count(), captures.b.count())
    untested = counted(usable) if usable < FEWEST else OTHER_PIXELS
    return (test if tested else test._replace(p=np.nan)), untested


def _with_findings(table: pd.DataFrame) -> pd.DataFrame:
    """Complete the table DIFFERENCES: p-values corrected for all tests (Holm), the better result
    and a sentence for each mean."""
    table["metric_title"] = [METRICS[metric].title for metric in table.metric]
    table["unit"] = [METRICS[metric].unit for metric in table.metric]
    table["untested"] = table.untested.where(table.p.isna()).fillna("")
    table["p_corrected"] = holm_corrected(table.p)
    table["capture"] = table.capture.fillna("")
    table[["better", "sentence"]] = list(map(_finding, table.itertuples()))
    return conform(table, DIFFERENCES)


def _finding(line: Any) -> tuple[str, str]:
    """Return the result that is shown to be better, "A", "B" or "", and the difference in words; ""
    for that of a single capture, and for an unknown one. line: of the table DIFFERENCES."""
    if line.capture or np.isnan(line.difference):
        return "", ""
    lower = METRICS[line.metric].better == "lower"
    order = "BA" if (line.difference < 0) == lower else "AB"
    if line.difference < 0:
        line = line._replace(difference=-line.difference, low=-line.high, high=-line.low)
    title = line.metric_title + (f" against {line.reference}" if line.reference else "")
    sentence = f"{line.title}: {finding(title, line, line.untested, *order)}"
    return order[0] if line.p_corrected < 1 - LEVEL else "", sentence


def _captures(result: Result, reference: str) -> list[str]:
    return [capture.name for capture in result.scored() if reference in capture.references]


def _figures(result: Result, side: str) -> pd.DataFrame:
    """Return the figure of every capture in the column `side`, with the columns metric, method,
    reference and capture; of times the median of the capture's frames."""
    keys = [*KEYS, "capture"]
    scores = result.scores[result.scores.treatment == ""]
    errors = scores[(scores.frame == 0) & (scores.reference != "")].set_index(keys).value
    times = scores[scores.metric == TIME].groupby(keys).value.median()
    repeats = scores[scores.metric == STRONGEST].assign(metric=PRECISION).groupby(keys).value
    precisions = repeats.apply(lambda z_m: precision_mm([z_m.to_numpy()])).astype(float)
    return pd.concat([errors, times, precisions]).rename(side).reset_index()


def require_comparable(a: Result, b: Result) -> None:
    """Raise a HandbenchError if two results were scored by different protocols or with different
    definitions of a metric."""
    ours, theirs = (
        {key: metric.definition for key, metric in of.about.metrics.items()}
        | {"the protocol": [of.about.protocol.get(key) for key in ("id", "version")]}
        for of in (a, b)
    )
    if changed := [key for key in ours if key in theirs and ours[key] != theirs[key]]:
        raise HandbenchError(
            f"{a.folder}, {b.folder}: the two results define {', '.join(changed)} differently, so "
            "their figures cannot be compared; run one of them again"
        )


def _same(a: Result, b: Result, name: str, reference: str) -> bool:
    """Tell whether a capture shows the same hand in the same place in both results: its content has
    the same hash, or the depths of its reference agree."""
    if (digest := a.about.inputs.get(name)) and digest == b.about.inputs.get(name):
        return True
    ours, theirs = a.surface(name, reference), b.surface(name, reference)
    for one, other in ((ours.x_m, theirs.x_m), (ours.y_m, theirs.y_m)):
        if one.shape != other.shape or not np.allclose(one, other, atol=1e-9):
            return False
    known = np.isfinite([ours.z_m, theirs.z_m])
    both = known.all(axis=0)
    if not both.any() or both.sum() < SAME_SHARE * known.any(axis=0).sum():
        return False
    return float(np.median(np.abs(ours.z_m - theirs.z_m)[both])) <= SAME_M


HASH_CHARACTERS = 12  # enough to distinguish two hashes


def changes(a: Result, b: Result) -> pd.DataFrame:
    """List what differs between two results besides their figures, as the table CHANGES:
    configuration, settings of the methods that both have, versions, machine, inputs.
    A line has the values of A and B for one key; a value is empty if that result does not have the
    key."""
    methods = a.about.method_titles.keys() & b.about.method_titles.keys()
    ours, theirs = (_facts(result, methods) for result in (a, b))
    lines = (
        (*key, str(ours.get(key, "")), str(theirs.get(key, "")))
        for key in dict.fromkeys((*ours, *theirs))
        if ours.get(key) != theirs.get(key)
    )
    return frame(CHANGES, lines)


def _facts(result: Result, methods: Iterable[str]) -> dict[tuple[str, str], Any]:
    """Return all that describes a result and its `methods`: (sort, key) → value. The settings of a
    method are those for the first capture."""
    about = result.about
    try:
        config = plain_toml(result.config)
    # a record, not an input: that it cannot be read must not hide the figures
    except (ValueError, RecursionError):
        config = {"config.toml": "not readable as TOML"}
    sorts = {
        "configuration": config,
        "settings": {
            method.name: next(iter(method.config.values()), {})
            for method in about.methods
            if method.name in methods
        },
        "version": about.versions,
        "machine": about.machine,
        "input": {name: digest[:HASH_CHARACTERS] for name, digest in about.inputs.items()},
    }
    return {(sort, key): of for sort, facts in sorts.items() for key, of in _flat(facts).items()}


def _flat(value: Any, key: str = "") -> dict[str, Any]:
    """Flatten nested tables and lists of tables: key with dots → value."""
    if isinstance(value, list) and value and all(isinstance(item, Mapping) for item in value):
        value = {
            next((item[name] for name in ("name", "id", "scene", "path") if name in item), place): (
                item
            )
            for place, item in enumerate(value)
        }
    if not isinstance(value, Mapping):
        return {key: value}
    return {
        path: leaf
        for name, item in value.items()
        for path, leaf in _flat(item, f"{key}.{name}" if key else str(name)).items()
    }
