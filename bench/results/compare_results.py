"""Comparison of two results, A and B: differences of their figures, with confidence intervals and
tests.

If both results have the same captures, each method is compared capture by capture, so that the
errors of the captures cancel. Otherwise A and B are two independent samples (Welch's test). Each
capture counts as one value. Precisions are compared by the F test of their variances. The p-values
of all lines are corrected together (Holm). Times are listed without a test, because repeats within
a run do not show the difference between two runs.

`handbench compare` writes

compare.json  both results, the captures compared, every difference, times and provenance
compare.csv   one line per method, metric and reference: `DIFFERENCES` in `bench.evaluation.tables`
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from handbench.bench.evaluation.intervals import TOO_FEW, figure_interval, note, precision_interval
from handbench.bench.evaluation.metrics import METRICS, deviation, precision
from handbench.bench.evaluation.paired import (
    Difference,
    amount_text,
    amounts_text,
    f_test,
    holm_corrected,
    paired_test,
    welch_test,
)
from handbench.bench.evaluation.sample_size import ALPHA, LEAST, hands_needed
from handbench.bench.evaluation.tables import (
    DIFFERENCES,
    LEVEL,
    TIMES,
    by_method,
    conform,
    frame,
    records,
    write,
)
from handbench.bench.results.about import REFERENCES, MethodFacts
from handbench.bench.results.derived import compared_metrics
from handbench.bench.results.provenance import changes
from handbench.bench.results.result_folder import Result
from handbench.support.errors import HandbenchError
from handbench.support.files import write_json

COMPARED_VERSION = 1
# of the pixels that either reference has, both must have, to be one hand in one place
SAME_SHARE = 0.9
SAME_M = 5e-4  # and differ by at most this in the median
NONE = (None, None)


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
    basis: for each reference, a sentence on which captures were compared. differences: table with
    one line for each tested metric; times: table with the time of each method; changes: table of
    the settings, versions and inputs that differ between A and B."""

    a: ComparedResult
    b: ComparedResult
    basis: tuple[str, ...]
    differences: pd.DataFrame
    times: pd.DataFrame
    changes: pd.DataFrame


def write_compared(folder: Path, compared: Compared) -> None:
    """Write a comparison into the folder, as compare.csv (the differences) and compare.json
    (everything)."""
    write(folder / "compare.csv", compared.differences, DIFFERENCES)
    lines = {name: records(getattr(compared, name)) for name in ("differences", "times", "changes")}
    about = {"a": asdict(compared.a), "b": asdict(compared.b), "basis": compared.basis}
    write_json(folder / "compare.json", {"schema_version": COMPARED_VERSION, **about, **lines})


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
    Compared are the metrics that the protocol names, the precision, and (without a test) the time.
    Raises HandbenchError for results with different protocols or definitions, or without a common
    method and a common reference."""
    require_comparable(a, b)
    theirs = {method.name for method in b.about.methods}
    methods = [method for method in a.about.methods if method.name in theirs]
    bases = [basis for reference in REFERENCES if (basis := _basis(a, b, reference))]
    if not methods or not bases:
        lack = "method" if not methods else "reference"
        raise HandbenchError(
            f"{a.folder}, {b.folder}: the two results have no {lack} in common; expected at least "
            "one"
        )
    metrics = compared_metrics(a.about.protocol)
    figures = [[by_method(result.scores, basis.reference) for result in (a, b)] for basis in bases]
    lines = []
    for method in methods:
        for basis, found in zip(bases, figures, strict=True):
            samples = (
                of.get(method.name, pd.DataFrame(dtype=float)).reindex(captures, columns=metrics)
                for of, captures in zip(found, (basis.a, basis.b), strict=True)
            )
            lines += _accuracy(method, basis, *samples)
        lines += _precision(a, b, method)
    times = frame(TIMES, [_time(a, b, method) for method in methods])
    sentences = tuple(basis.sentence for basis in bases)
    return Compared(_side(a), _side(b), sentences, _corrected(lines), times, changes(a, b))


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
    left = len(ours) + len(theirs) - 2 * len(shared)
    without = f", without the {left} that only one has" if left else ""
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


def _accuracy(
    method: MethodFacts, basis: CommonCaptures, a: pd.DataFrame, b: pd.DataFrame
) -> list[dict[str, Any]]:
    """Compare one method of A and B by every metric; return one line (column → value) for each
    metric, with p-values not yet corrected.
    basis: the captures that are compared; a, b: figures of A and of B, one line for each capture,
    one column for each metric."""
    lines = []
    for metric in map(str, a):
        samples, test = (
            [a[metric].to_numpy(), b[metric].to_numpy()],
            paired_test if basis.paired else welch_test,
        )
        values = [a[metric].mean(), b[metric].mean()]
        ends = [figure_interval(metric, sample) or NONE for sample in samples]
        line = _line(method, metric, samples, values, ends, test(*samples))
        spreads = _spreads(samples, basis.paired)
        lines.append(
            {**line, "reference": basis.reference, "paired": basis.paired, "spreads": spreads}
        )
    return lines


def _spreads(samples: Sequence[np.ndarray], paired: bool) -> list[float]:
    """Return the standard deviations that determine how many captures a test needs.
    samples: a metric on the captures of A and of B. If they are paired, the result is the deviation
    of the differences; otherwise it is one deviation for A and one for B. Empty with fewer than
    three captures (LEAST)."""
    parts = [samples[1] - samples[0]] if paired else samples
    known = [part[np.isfinite(part)] for part in parts]
    return [deviation(part) for part in known] if min(map(len, known)) >= LEAST else []


def _precision(a: Result, b: Result, method: MethodFacts) -> list[dict[str, Any]]:
    """Compare the precision of one method in A and B; return a list with one line, empty if a
    result has no precision."""
    repeats = (result.repeats[result.repeats.method == method.name] for result in (a, b))
    hands = [
        [depths.to_numpy() for _, depths in of.groupby("capture", sort=False).z_m] for of in repeats
    ]
    intervals = [precision_interval(z) for z in hands]
    if None in intervals:
        return []
    metric = "precision_mm"
    values = [precision(z)[metric] for z in hands]
    return [_line(method, metric, hands, values, intervals, f_test(hands[0], hands[1]))]


def _line(
    method: MethodFacts,
    metric: str,
    samples: Sequence[Any],
    values: Sequence[float | int | None],
    intervals: Sequence[Any],
    tested: Difference,
) -> dict[str, Any]:
    """Make one line (column → value) with the figures of A and B, their intervals and numbers of
    captures, and the test of their difference.
    samples, values, intervals: a pair each, for A and B. The line has no reference and is marked as
    unpaired; the caller may change both."""
    facts = METRICS[metric]
    line: dict[str, Any] = {
        "method": method.name,
        "title": method.title,
        "metric": metric,
        "metric_title": facts.title,
    }
    for side, sample, value, (low, high) in zip("ab", samples, values, intervals, strict=True):
        line |= {side: value, f"{side}_low": low, f"{side}_high": high, f"n_{side}": len(sample)}
    return {**line, "unit": facts.unit, "reference": "", "paired": False, **tested._asdict()}


def _corrected(found: Sequence[dict[str, Any]]) -> pd.DataFrame:
    """Make the table of differences between A and B (DIFFERENCES) from all lines. It adds p-values
    corrected for all tests (Holm), the better result, the number of captures needed, and a
    sentence."""
    lines = pd.DataFrame(found, columns=[*DIFFERENCES.names, "p"]).assign(better="", sentence="")
    lines["p_corrected"] = holm_corrected(lines.p.astype(float).tolist())
    lines = conform(lines, DIFFERENCES)
    fell = (lines.difference < 0) == lines.metric.map(
        lambda metric: METRICS[metric].better == "lower"
    )
    lines["better"] = np.where(lines.p_corrected < 1 - LEVEL, np.where(fell, "B", "A"), "")
    # the hardest step of the correction
    alpha = ALPHA / max(1, int(lines.p_corrected.notna().sum()))
    lines["needed"] = [
        _needed(difference, line.get("spreads"), alpha) if not better else np.nan
        for line, difference, better in zip(
            found, lines.difference.tolist(), lines.better, strict=True
        )
    ]
    lines["sentence"] = [_sentence(line) for line in lines.itertuples()]
    return conform(lines, DIFFERENCES)


def _needed(difference: float, spreads: list[float] | None, alpha: float) -> float:
    """Return the number of captures that would show this difference at level alpha; NaN if unknown
    or too many.
    spreads: one standard deviation, of paired differences, or two, of independent samples."""
    return (hands_needed(difference, spreads, alpha) if spreads else None) or np.nan


def _sentence(line: Any) -> str:
    what = line.metric_title + (f" against {line.reference}" if line.reference else "")
    if np.isnan(line.difference):
        return f"{line.title}: no figures to compare in {what}"
    each = "" if line.paired else " of each"
    hands = (
        f"; needs {line.needed:.0f} hands{each} to show this difference" if line.needed > 0 else ""
    )
    none = f"{line.title}: no difference shown between A and B in {what}: "
    if np.isnan(line.p_corrected):
        return f"{none}{TOO_FEW} (B − A: {amount_text(line.difference, line.unit)}){hands}"
    ends = (line.difference, line.low, line.high)
    amount, low, high = ends if line.difference >= 0 else (-line.difference, -line.high, -line.low)
    amounts = amounts_text(amount, low, high, line.unit)
    if line.better:
        worse = "A" if line.better == "B" else "B"
        return f"{line.title}: {line.better} is better than {worse} by {amounts} ({what})"
    return none + amounts + (" before the correction for all lines" if low > 0 else "") + hands


def _side(result: Result) -> ComparedResult:
    captures = tuple(capture.name for capture in result.scored())
    return ComparedResult(str(result.folder), result.about.name, captures, _gemm(result))


def _gemm(result: Result) -> float | None:
    rate = result.about.machine.get("gemm_gflops")
    return rate if isinstance(rate, int | float) and rate > 0 else None


def _time(a: Result, b: Result, method: MethodFacts) -> tuple[Any, ...]:
    """Make a method's line of the table TIMES: time per frame in A and in B, their ratio, and a
    sentence."""
    rows = [result.time(method.name) for result in (a, b)]
    figures = [
        end for row in rows for end in ((row.value, row.low, row.high) if row else (None, *NONE))
    ]
    if not all(row and row.value for row in rows):
        sentence = f"{method.title}: no times to compare"
        return method.name, method.title, *figures, None, sentence
    ratio = rows[1].value / rows[0].value
    sentences = ", ".join(
        f"{row.value:.3g} s" + (f" at {rate:.0f} GFLOP/s" if (rate := _gemm(result)) else "")
        for row, result in zip(rows, (a, b), strict=True)
    )
    sentence = f"{method.title}: B takes {ratio:.2f} times as long as A ({sentences})"
    return method.name, method.title, *figures, ratio, sentence
