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

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from handbench.bench.evaluation.intervals import FEWEST, note, precision_interval
from handbench.bench.evaluation.metrics import HEADLINE, METRICS, chosen
from handbench.bench.evaluation.paired import (
    Difference,
    amount_text,
    amounts_text,
    f_test,
    holm_corrected,
    paired_test,
    welch_test,
)
from handbench.bench.evaluation.repeats import precision_mm
from handbench.bench.evaluation.scoring_protocols import REFERENCES
from handbench.bench.evaluation.tables import DIFFERENCES, LEVEL, by_method, conform, records, write
from handbench.bench.results.about import MethodFacts
from handbench.bench.results.derived import compared_metrics
from handbench.bench.results.provenance import changes
from handbench.bench.results.result_folder import Result
from handbench.support.errors import HandbenchError
from handbench.support.files import write_json

COMPARED_VERSION = 2
PRECISION, TIME = "precision_mm", "seconds"
FIRST = chosen("compare")  # tested or not, in this order
ERRORS = [metric for metric in FIRST if METRICS[metric].of]
# of the pixels that either reference has, both must have, to be one hand in one place
SAME_SHARE = 0.9
SAME_M = 5e-4  # and differ by at most this in the median
NONE = (None, None)
OTHER_PIXELS = "each on its own pixels"


@dataclass(frozen=True)
class ComparedResult:
    """Facts of one of two compared results, A or B.
    captures: names of those that are compared with a reference; gemm_gflops: the machine's measured
    rate of float32 matrix products, by which times can be judged."""

    folder: str
    name: str
    captures: tuple[str, ...]
    gemm_gflops: float | None


@dataclass(frozen=True, eq=False)
class Compared:
    """The comparison of two results, A and B.
    basis: sentences on which captures, methods and frames were compared. differences: table with
    lines for each metric, method and reference: first the mean over the captures, then each
    capture. changes: table of the settings, versions and inputs that differ between A and B."""

    a: ComparedResult
    b: ComparedResult
    basis: tuple[str, ...]
    differences: pd.DataFrame
    changes: pd.DataFrame

    def content(self) -> dict[str, Any]:
        """Return the comparison as dictionaries and lists, as in compare.json."""
        about = {"a": asdict(self.a), "b": asdict(self.b), "basis": self.basis}
        tables = {"differences": records(self.differences), "changes": records(self.changes)}
        return {"schema_version": COMPARED_VERSION, **about, **tables}


def write_compared(folder: Path, compared: Compared) -> None:
    """Write a comparison into the folder, as compare.csv (the differences) and compare.json
    (everything)."""
    write(folder / "compare.csv", compared.differences, DIFFERENCES)
    write_json(folder / "compare.json", compared.content())


@dataclass(frozen=True)
class CommonCaptures:
    """The captures of A and of B that are compared against one reference.
    paired: a and b are the same captures in the same order; otherwise they are two independent
    samples. sentence: a description for readers."""

    reference: str
    a: tuple[str, ...]
    b: tuple[str, ...]
    paired: bool
    sentence: str


def compare_results(a: Result, b: Result) -> Compared:
    """Compare two results: B's figures minus A's, with confidence intervals and tests, for every
    method that both have.
    Raises HandbenchError for results with different protocols or definitions, or without a common
    method and a common reference."""
    require_comparable(a, b)
    theirs = {method.name for method in b.about.methods}
    methods = [method for method in a.about.methods if method.name in theirs]
    bases = [basis for reference in REFERENCES if (basis := _basis(a, b, reference))]
    if not methods or not bases:
        lack = "reference" if methods else "method"
        raise HandbenchError(
            f"{a.folder}, {b.folder}: the two results have no {lack} in common; expected at least "
            "one"
        )
    tested = compared_metrics(a.about.protocol)
    metrics = list(dict.fromkeys((*ERRORS, *tested)))
    figures = [[by_method(result.scores, basis.reference) for result in (a, b)] for basis in bases]
    lines = []
    for method in methods:
        for basis, found in zip(bases, figures, strict=True):
            samples = (
                of.get(method.name, pd.DataFrame(dtype=float)).reindex(captures, columns=metrics)
                for of, captures in zip(found, (basis.a, basis.b), strict=True)
            )
            lines += _accuracy(method, basis, tested, *samples)
        lines += _precision(a, b, method) + _times(a, b, method)
    rank = {metric: place for place, metric in enumerate((*FIRST, *metrics)[::-1])}
    lines.sort(key=lambda line: -rank[line["metric"]])
    sentences = (*(basis.sentence for basis in bases), *_left_out(a, b), *_frames(a, b))
    return Compared(_side(a), _side(b), sentences, _corrected(lines), changes(a, b))


def require_comparable(a: Result, b: Result) -> None:
    """Raise a HandbenchError if two results were scored by different protocols or with different
    definitions of a metric."""
    ours, theirs = (
        f"{r.about.protocol.get('id')} {r.about.protocol.get('version')}" for r in (a, b)
    )
    if ours != theirs:
        raise HandbenchError(
            f"{a.folder}, {b.folder}: the two results use the scoring protocols '{ours}' and "
            f"'{theirs}', whose figures cannot be compared; run one of them again"
        )
    shared = a.about.metrics.keys() & b.about.metrics.keys()
    changed = sorted(
        m for m in shared if a.about.metrics[m].definition != b.about.metrics[m].definition
    )
    if changed:
        raise HandbenchError(
            f"{a.folder}, {b.folder}: the two results define {', '.join(changed)} differently, so "
            "their figures cannot be compared; run the older one again"
        )


def _basis(a: Result, b: Result, reference: str) -> CommonCaptures | None:
    """Choose the captures to compare against one reference: those that both results have, or, if
    they have none in common, all captures of each.
    Returns None if one of the results has no capture with this reference."""
    ours, theirs = (tuple(c.name for c in r.scored() if reference in c.references) for r in (a, b))
    if not ours or not theirs:
        return None
    shared = tuple(name for name in ours if name in theirs and _same(a, b, name, reference))
    if not shared:
        text = (
            f"against {reference}: different captures ({', '.join(ours)}; {', '.join(theirs)}), "
            "as two independent "
            f"samples; A: {note(len(ours))}; B: {note(len(theirs))}"
        )
        return CommonCaptures(reference, ours, theirs, False, text)
    without = "".join(
        f", without {', '.join(left)} of {side}"
        for side, names in (("A", ours), ("B", theirs))
        if (left := [name for name in names if name not in shared])
    )
    text = (
        f"against {reference}: the same captures ({', '.join(shared)}{without}), pair by "
        f"pair; {note(len(shared))}"
    )
    return CommonCaptures(reference, shared, shared, True, text)


def _same(a: Result, b: Result, name: str, reference: str) -> bool:
    """Tell whether a capture shows the same hand in the same place in both results: its content has
    the same hash, or the depths of its reference agree."""
    if a.about.inputs.get(name) and a.about.inputs.get(name) == b.about.inputs.get(name):
        return True
    ours, theirs = a.surface(name, reference), b.surface(name, reference)
    for one, other in ((ours.x_m, theirs.x_m), (ours.y_m, theirs.y_m)):
        if one.shape != other.shape or not np.allclose(one, other, atol=1e-9):
            return False
    known = np.isfinite(ours.z_m), np.isfinite(theirs.z_m)
    both, either = known[0] & known[1], known[0] | known[1]
    if not both.any() or both.sum() < SAME_SHARE * either.sum():
        return False
    return float(np.median(np.abs(ours.z_m - theirs.z_m)[both])) <= SAME_M


def _captures(count: int) -> str:
    return f"{count} capture" + "s" * (count != 1)


def _left_out(a: Result, b: Result) -> list[str]:
    """Return a sentence for each result with methods or references that the other does not have."""
    found = []
    for side, result, other in (("A", a, b), ("B", b, a)):
        theirs = {method.name for method in other.about.methods}
        methods = [m.title for m in result.about.methods if m.name not in theirs]
        if methods:
            found.append(f"only {side} has {', '.join(methods)}, which cannot be compared")
        ours, known = (
            {name for capture in of.scored() for name in capture.references}
            for of in (result, other)
        )
        if lacks := [name for name in REFERENCES if name in ours - known]:
            found.append(f"only {side} is scored against {', '.join(lacks)}")
    return found


def _frames(a: Result, b: Result) -> list[str]:
    """Return a sentence on the compared frame if a result has the errors of several; otherwise an
    empty list."""
    counts = [of.scores.frame[of.scores.metric == HEADLINE].nunique() for of in (a, b)]
    if max(counts) < 2:
        return []
    return [f"the errors are those of frame 0; A has {counts[0]} and B has {counts[1]} frames"]


def _accuracy(
    method: MethodFacts,
    basis: CommonCaptures,
    tested: Sequence[str],
    a: pd.DataFrame,
    b: pd.DataFrame,
) -> list[dict[str, Any]]:
    """Compare one method of A and B by every metric; return lines (column → value), for each metric
    the mean over the captures and then each capture, with p-values not yet corrected.
    basis: the captures that are compared; tested: metrics with a p-value; a, b: figures of A and of
    B, one line for each capture, one column for each metric."""
    lines = []
    for metric in map(str, a):
        samples = [a[metric].to_numpy(), b[metric].to_numpy()]
        seen = [np.isfinite(sample) for sample in samples]
        usable = int((seen[0] & seen[1]).sum() if basis.paired else min(map(np.sum, seen)))
        difference = (paired_test if basis.paired else welch_test)(*samples)
        facts = {"reference": basis.reference, "paired": basis.paired}
        about = dict(facts)
        if metric not in tested:
            difference = difference._replace(p=np.nan)
        if np.isnan(difference.p):
            about["untested"] = _captures(usable) if usable < FEWEST else OTHER_PIXELS
        values = [a[metric].mean(), b[metric].mean()]
        ends = [METRICS[metric].interval(sample) or NONE for sample in samples]
        lines.append(_line(method, metric, values, [*map(len, samples)], ends, difference) | about)
        ours, theirs = a[metric].to_dict(), b[metric].to_dict()
        each = [(ours, theirs)] if basis.paired else [(ours, {}), ({}, theirs)]
        for pair in each:
            lines += [line | facts for line in _each_capture(method, metric, *pair)]
    return lines


def _precision(a: Result, b: Result, method: MethodFacts) -> list[dict[str, Any]]:
    """Compare the precision of one method in A and B, on average and for each capture; return lines
    like `_accuracy`, none if neither result has repeats."""
    repeats = [result.repeats[result.repeats.method == method.name] for result in (a, b)]
    hands = [
        {str(name): z.to_numpy() for name, z in of.groupby("capture", sort=False).z_m}
        for of in repeats
    ]
    if not any(hands):
        return []
    depths = [list(of.values()) for of in hands]
    values = [precision_mm(z) for z in depths]
    ends = [precision_interval(z) or NONE for z in depths]
    found = f_test(*depths)
    line = _line(method, PRECISION, values, [*map(len, hands)], ends, found)
    if np.isnan(found.p):
        line["untested"] = "no scatter of repeats in A or in B"
    each = ({name: precision_mm([z]) for name, z in of.items()} for of in hands)
    return [line, *_each_capture(method, PRECISION, *each)]


def _times(a: Result, b: Result, method: MethodFacts) -> list[dict[str, Any]]:
    """Compare the time per frame of one method in A and B, the median of all frames and of those of
    each capture; return lines like `_accuracy`, none if neither result has times."""
    rows = [result.time(method.name) for result in (a, b)]
    if not any(rows):
        return []
    values = [row.value if row else None for row in rows]
    ends = [(row.low, row.high) if row else NONE for row in rows]
    scores = [
        of.scores[(of.scores.metric == TIME) & (of.scores.method == method.name)] for of in (a, b)
    ]
    each = [of.groupby("capture", sort=False).value.median().to_dict() for of in scores]
    line = _line(method, TIME, values, [*map(len, each)], ends)
    return [line | {"untested": "one run each"}, *_each_capture(method, TIME, *each)]


def _each_capture(
    method: MethodFacts, metric: str, a: Mapping[Any, Any], b: Mapping[Any, Any]
) -> list[dict[str, Any]]:
    """Return a line (column → value) for each capture with its figures of A and of B, which have no
    test.
    a, b: capture → figure; a capture may be in only one of them."""
    return [
        _line(method, metric, [a.get(name), b.get(name)], [int(name in a), int(name in b)])
        | {"capture": name}
        for name in dict.fromkeys((*a, *b))
    ]


def _line(
    method: MethodFacts,
    metric: str,
    values: Sequence[float | int | None],
    counts: Sequence[int],
    intervals: Sequence[Any] = (NONE, NONE),
    tested: Difference | None = None,
) -> dict[str, Any]:
    """Make one line (column → value) with the figures of A and B, their intervals and numbers of
    captures, and the test of their difference (None: only the difference).
    values, counts, intervals: a pair each, for A and B. The line has no reference and no capture
    and is marked as unpaired; the caller may change these."""
    facts = METRICS[metric]
    line: dict[str, Any] = {
        "method": method.name,
        "title": method.title,
        "metric": metric,
        "metric_title": facts.title,
        "unit": facts.unit,
        "reference": "",
        "capture": "",
        "paired": False,
    }
    of_sides = zip("ab", values, counts, intervals, strict=True)
    for side, value, count, (low, high) in of_sides:
        line |= {side: value, f"{side}_low": low, f"{side}_high": high, f"n_{side}": count}
    if tested is None:
        a, b = values
        tested = Difference(np.nan if a is None or b is None else b - a)
    return line | tested._asdict()


def _corrected(found: Sequence[dict[str, Any]]) -> pd.DataFrame:
    """Make the table of differences between A and B (DIFFERENCES) from all lines. It adds p-values
    corrected for all tests (Holm), the better result, and a sentence."""
    lines = pd.DataFrame(found, columns=[*DIFFERENCES, "p"]).assign(better="", sentence="")
    lines["untested"] = lines.untested.fillna("")
    lines["p_corrected"] = holm_corrected(lines.p.astype(float).tolist())
    lines = conform(lines, DIFFERENCES)
    fell = (lines.difference < 0) == lines.metric.map(
        lambda metric: METRICS[metric].better == "lower"
    )
    lines["better"] = np.where(lines.p_corrected < 1 - LEVEL, np.where(fell, "B", "A"), "")
    lines["sentence"] = [_sentence(line) for line in lines.itertuples()]
    return conform(lines, DIFFERENCES)


def _sentence(line: Any) -> str:
    """Return a difference in words; "" for that of a single capture.
    line: a row of the table DIFFERENCES."""
    if line.capture:
        return ""
    what = line.metric_title + (f" against {line.reference}" if line.reference else "")
    if np.isnan(line.difference):
        return f"{line.title}: no figures to compare in {what}"
    if line.metric == TIME:
        return f"{line.title}: B takes {line.b / line.a:.2f} times as long as A"
    if line.untested:
        amount = amount_text(line.difference, line.unit)
        return f"{line.title}: B − A is {amount} in {what}, not tested ({line.untested})"
    ends = (line.difference, line.low, line.high)
    amount, low, high = ends if line.difference >= 0 else (-line.difference, -line.high, -line.low)
    amounts = amounts_text(amount, low, high, line.unit)
    if line.better:
        worse = "A" if line.better == "B" else "B"
        return f"{line.title}: {line.better} is better than {worse} by {amounts} ({what})"
    before = " before the correction for all lines" if low > 0 else ""
    none = f"{line.title}: no difference shown between A and B in {what}"
    return f"{none}: {amounts}{before}"


def _side(result: Result) -> ComparedResult:
    captures = tuple(capture.name for capture in result.scored())
    return ComparedResult(str(result.folder), result.about.name, captures, _gemm(result))


def _gemm(result: Result) -> float | None:
    rate = result.about.machine.get("gemm_gflops")
    return rate if isinstance(rate, int | float) and rate > 0 else None
