"""Two results side by side: is B better than A, by how much, and how sure is that?

Where both have the same captures, each method's figures are compared pair by pair, as
`bench.evaluation.statistics.paired` compares two methods: what both suffer from cancels. Where they differ, A and B are
two independent samples: the variances of the two figures add, and Student's t takes the degrees of freedom of Welch and
Satterthwaite. Precisions are compared by the F test of their variances. Holm's correction spans all lines. Times are
set beside each other and not tested, for the repeats of one run do not know how two runs differ.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bench.evaluation.metrics import METRICS, RATIOS, pool, precision
from bench.evaluation.statistics.intervals import note, pooled_intervals, precision_interval
from bench.evaluation.statistics.paired import holm
from bench.evaluation.statistics.provenance import changes
from bench.evaluation.statistics.two_samples import f_test, paired, unpaired
from bench.results import REFERENCES, Result, Row, errors_path
from bench.results.compared import Compared, Difference, Side, Time
from bench.results.error_map import ErrorMap
from bench.results.maps import read_map
from bench.results.records import LEVEL
from radar.support.errors import HandbenchError

SAME_SHARE = 0.9  # of the pixels that either reference has, both must have, to be one hand in one place
SAME_M = 5e-4  # and in the median lie so near
NONE = (None, None)
FALLBACK = ("mae_mm", "completeness_percent")  # compared where a result of an earlier version does not say by what


@dataclass(frozen=True)
class Basis:
    """The captures of A and of B that a reference's differences stand on."""

    reference: str
    a: tuple[str, ...]
    b: tuple[str, ...]
    paired: bool
    sentence: str


def compare_results(a: Result, b: Result) -> Compared:
    """Every method that both have, by the protocol's compared metrics, the precision and the time. Results of different
    protocols or definitions, or without a method and a reference in common, are a HandbenchError."""
    _require_alike(a, b)
    theirs = {method.name for method in b.about.methods}
    methods = [method for method in a.about.methods if method.name in theirs]
    bases = [basis for reference in REFERENCES if (basis := _basis(a, b, reference))]
    if not methods or not bases:
        lack = "method" if not methods else "reference"
        raise HandbenchError(f"{a.folder} and {b.folder}: have no {lack} in common; expected at least one")
    metrics = [m for m in a.about.protocol.get("compared", FALLBACK) if m in RATIOS and METRICS[m].better != "zero"]
    lines = []
    for method in methods:
        for basis in bases:
            lines += _accuracy(a, b, method.name, method.title, basis, metrics)
        lines += _precision(a, b, method.name, method.title)
    return Compared(
        _side(a),
        _side(b),
        tuple(basis.sentence for basis in bases),
        tuple(_corrected(lines)),
        tuple(_time(a, b, method.name, method.title) for method in methods),
        tuple(changes(a, b)),
    )


def _require_alike(a: Result, b: Result) -> None:
    ours, theirs = (f"{r.about.protocol.get('id')} {r.about.protocol.get('version')}" for r in (a, b))
    if ours != theirs:
        raise HandbenchError(
            f"{a.folder} and {b.folder}: were scored by the protocols '{ours}' and '{theirs}', whose figures do not "
            "compare; run one of them again"
        )
    shared = a.about.metrics.keys() & b.about.metrics.keys()
    changed = sorted(m for m in shared if a.about.metrics[m].definition != b.about.metrics[m].definition)
    if changed:
        raise HandbenchError(
            f"{a.folder} and {b.folder}: define {', '.join(changed)} differently, so their figures do not compare; "
            "run the older one again"
        )


def _basis(a: Result, b: Result, reference: str) -> Basis | None:
    """The captures that both have, if any; else all of each. None where one has no such reference."""
    ours, theirs = (tuple(c.name for c in r.scored() if reference in c.references) for r in (a, b))
    if not ours or not theirs:
        return None
    shared = tuple(name for name in ours if name in theirs and _same(a, b, name, reference))
    if not shared:
        text = (
            f"against {reference}: different captures ({', '.join(ours)}; {', '.join(theirs)}), as two independent "
            f"samples; A: {note(len(ours))}; B: {note(len(theirs))}"
        )
        return Basis(reference, ours, theirs, False, text)
    left = len(ours) + len(theirs) - 2 * len(shared)
    without = f", without the {left} that only one has" if left else ""
    text = f"against {reference}: the same captures ({', '.join(shared)}{without}), pair by pair; {note(len(shared))}"
    return Basis(reference, shared, shared, True, text)


def _same(a: Result, b: Result, name: str, reference: str) -> bool:
    """Whether both show one hand in one place: the same input, or references that coincide."""
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


def _error_map(result: Result, capture: str, method: str, reference: str) -> ErrorMap:
    path = errors_path(result.folder, capture, method, reference)
    try:
        return ErrorMap(**read_map(path, "error_m", "reference_z_m", "to_reference_m", "to_map_m"))
    except HandbenchError:
        return result.errors(capture, method, reference)  # an earlier version kept no distances


def _accuracy(a: Result, b: Result, method: str, title: str, basis: Basis, metrics: Sequence[str]) -> list[Difference]:
    """One line a metric, the p not yet corrected."""
    maps = [
        [_error_map(result, capture, method, basis.reference) for capture in captures]
        for result, captures in ((a, basis.a), (b, basis.b))
    ]
    values, intervals = [pool(m) for m in maps], [pooled_intervals(m) for m in maps]
    test = paired if basis.paired else unpaired
    return [
        Difference(
            method,
            title,
            metric,
            METRICS[metric].title,
            METRICS[metric].unit,
            basis.reference,
            values[0][metric],
            *intervals[0].get(metric, NONE),
            values[1][metric],
            *intervals[1].get(metric, NONE),
            *test(*maps, metric),
            basis.paired,
            *map(len, maps),
        )
        for metric in metrics
    ]


def _precision(a: Result, b: Result, method: str, title: str) -> list[Difference]:
    """The line of the precision; none where one of them has none."""
    hands = [_hands(result, method) for result in (a, b)]
    values, intervals = ([of(z) for z in hands] for of in (precision, precision_interval))
    if None in intervals:
        return []
    metric = METRICS["precision_mm"]
    return [
        Difference(
            method,
            title,
            metric.key,
            metric.title,
            metric.unit,
            "",
            values[0][metric.key],
            *intervals[0],
            values[1][metric.key],
            *intervals[1],
            *f_test(*hands),
            False,
            *map(len, hands),
        )
    ]


def _hands(result: Result, method: str) -> list[np.ndarray]:
    """Depths of the strongest scatterer [repeats], one array a capture."""
    depths_m: dict[str, list[float | None]] = {}
    for repeat in result.repeats:
        if repeat.method == method:
            depths_m.setdefault(repeat.capture, []).append(repeat.z_m)
    return [np.array(values, dtype=np.float64) for values in depths_m.values()]


def _corrected(lines: Sequence[Difference]) -> list[Difference]:
    """The lines with p corrected over all that were tested, which is better, and a sentence."""
    corrected = iter(holm([line.p_corrected for line in lines if line.p_corrected is not None]))
    return [_told(line, None if line.p_corrected is None else next(corrected)) for line in lines]


def _told(line: Difference, p: float | None) -> Difference:
    better = ""
    if p is not None and p < 1 - LEVEL:
        better = "B" if (line.difference < 0) == (METRICS[line.metric].better == "lower") else "A"
    line = replace(line, p_corrected=p, better=better)
    return replace(line, sentence=_sentence(line))


def _sentence(line: Difference) -> str:
    what = line.metric_title + (f" against {line.reference}" if line.reference else "")
    if line.difference is None:
        return f"{line.title}: no figures to compare in {what}"
    none = f"{line.title}: no difference shown between A and B in {what}: "
    if line.p_corrected is None:
        return none + "too little to test"
    ends = (line.difference, line.low, line.high)
    amount, low, high = ends if line.difference >= 0 else (-line.difference, -line.high, -line.low)
    places = next((d for d, size in ((1, 1.0), (2, 0.1)) if round(amount, 9) >= size), 3)
    unit = "percentage points" if line.unit == "%" else line.unit
    amounts = f"{amount:.{places}f} {unit} [{low:.{places}f}, {high:.{places}f}]".replace("-", "−")
    if line.better:
        worse = "A" if line.better == "B" else "B"
        return f"{line.title}: {line.better} is better than {worse} by {amounts} ({what})"
    return none + amounts + (" before the correction for all lines" if low > 0 else "")


def _side(result: Result) -> Side:
    captures = tuple(capture.name for capture in result.scored())
    return Side(str(result.folder), result.about.name, captures, _gemm(result))


def _gemm(result: Result) -> float | None:
    rate = result.about.machine.get("gemm_gflops")
    return rate if isinstance(rate, int | float) and rate > 0 else None


def _time(a: Result, b: Result, method: str, title: str) -> Time:
    rows = [_seconds(result, method) for result in (a, b)]
    figures = [value for row in rows for value in ((row.value, row.low, row.high) if row else (None, *NONE))]
    if not all(row and row.value for row in rows):
        return Time(method, title, *figures, None, f"{title}: no times to set beside each other")
    ratio = rows[1].value / rows[0].value
    said = (
        f"{value:.3g} s{f' at {rate:.0f} GFLOP/s' if rate else ''}"
        for value, rate in ((rows[0].value, _gemm(a)), (rows[1].value, _gemm(b)))
    )
    return Time(method, title, *figures, ratio, f"{title}: B takes {ratio:.2f} times as long as A ({', '.join(said)})")


def _seconds(result: Result, method: str) -> Row | None:
    """The line of the time, which is the same with every reference."""
    return next(filter(None, (result.row("seconds", method, reference) for reference in REFERENCES)), None)
