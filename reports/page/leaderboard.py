"""A leaderboard: the methods of a result, own and submitted, by their error over completeness under equal treatment,
with what they cost in time.

The rank of a method is one more than the number of methods that are shown to be better, so that those between which
nothing is shown share one. Seconds times the machine's rate of matrix products count work in place of time, for
machines differ; the rate was measured where the method ran.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from handbench.bench.results import HEADLINE, Result, Setting, Tradeoff, load, load_tradeoff
from handbench.bench.results.about import TREATMENTS, MethodFacts
from handbench.bench.results.result_folder import shown
from handbench.bench.results.tables import each
from handbench.reports.page import html, rendering
from handbench.reports.page.sections import Grid
from handbench.reports.tables.blocks import NONE, figure, number, three_digits
from handbench.reports.tables.result_tables import bold, escaped, table
from handbench.support.errors import HandbenchError
from handbench.support.files import write_text

BY, ALIKE = "aurc_mm", "window"  # ranked by this figure, all averaged alike: who has smoothed already gains nothing
SEEN = "complete_2mm_percent"
BOX = np.log10([[1e-3, 1e2], [0.1, 100.0]])  # of a front: seconds, millimetres


@dataclass(frozen=True)
class Entry:
    """A method's line. rank: 1 + the methods shown to be better, 0 where nothing could be tested; by, unsmoothed,
    common: texts of figures under equal treatment; work: seconds × GFLOP/s; reached_s: seconds to the error asked for;
    front: `hypervolume`."""

    method: str
    title: str
    inputs: str
    rank: int
    value: float
    by: str
    unsmoothed: str
    common: str
    complete_percent: float
    seconds: float
    work: float
    reached_s: float
    front: float


def build(folder: str | Path, out: str | Path, sweep: str | Path | None, at_mm: float) -> Path:
    """Write leaderboard.md, index.html and report/ to `out`; sweep: a trade-off, whose settings tell the methods'
    fronts and the time in which each is as accurate as `at_mm`. Returns the path of index.html."""
    result, out = load(folder), Path(out)
    found = entries(result, load_tradeoff(sweep) if sweep else None, at_mm)
    if not found:
        raise HandbenchError(f"{folder}: no methods were treated equally; expected two or more")
    rendering.begin(out)
    html.build(folder, out / "report", sweep)
    grid, said = as_grid(found, result.title(HEADLINE), at_mm, sweep is not None), about(result, found)
    cells = [tuple(map(escaped, row)) for row in grid.rows]
    first = [tuple(map(bold, row)) if entry.rank == 1 else row for entry, row in zip(found, cells, strict=True)]
    heading = f"# {escaped(result.about.name)}: leaderboard\n\n{escaped(said)}\n\n"
    write_text(out / "leaderboard.md", heading + table(grid.headings, first, grid.texts))
    write_text(out / "index.html", rendering.render("leaderboard.html", name=result.about.name, said=said, grid=grid))
    return out / "index.html"


def entries(result: Result, trade: Tradeoff | None, at_mm: float) -> list[Entry]:
    """Every method that was treated equally, the best first."""
    lines = result.equal[(result.equal.metric == BY) & (result.equal.treatment == ALIKE)]
    against = lines.reference.iloc[0] if len(lines) else ""
    compared = result.compared(ALIKE)
    compared = compared[(compared.metric == BY) & (compared.reference == against)]
    tested = bool(compared.p_corrected.notna().any())
    found = []
    for facts in result.about.methods:
        line = _equal(result, BY, ALIKE, facts.name)
        if line is None:
            continue
        time, complete = result.time(facts.name), result.row(SEEN, facts.name, against)
        seconds = float(time.value) if time is not None else np.nan
        settings = [s for s in trade.section("imaging") if s.method == facts.name] if trade else []
        worse = compared[(compared.worse == facts.name) & shown(compared)]
        machine, inputs = _submitted(facts)
        found.append(
            Entry(
                facts.name,
                facts.title,
                inputs,
                1 + len(worse) if tested else 0,
                float(line.value),
                figure(line.value, line.low, line.high, line.unit),
                _text(_equal(result, BY, "none", facts.name)),
                _text(_equal(result, HEADLINE, ALIKE, facts.name)),
                float(complete.value) if complete is not None else np.nan,
                seconds,
                seconds * (machine if machine else result.about.machine.get("gemm_gflops", np.nan)),
                min((s.seconds for s in settings if s.seconds and (s.error or np.inf) <= at_mm), default=np.nan),
                hypervolume(settings),
            )
        )
    return sorted(found, key=lambda entry: entry.value)


def hypervolume(settings: list[Setting]) -> float:
    """Share of BOX, logarithmic time × logarithmic error, that some setting is better than; NaN without settings."""
    points = [(s.seconds, s.error) for s in settings if s.seconds and s.error]
    if not points:
        return np.nan
    low, high = BOX.T
    unit = np.clip((np.log10(np.array(points)) - low) / (high - low), 0, 1)
    unit = unit[np.argsort(unit[:, 0], kind="stable")]
    until = np.append(unit[1:, 0], 1.0)
    return float(((until - unit[:, 0]) * (1 - np.minimum.accumulate(unit[:, 1]))).sum())


def about(result: Result, found: list[Entry]) -> str:
    """Words on the captures and figures that the table stands on."""
    captures, machine = len(result.scored()), result.about.machine
    tested = "" if any(entry.rank for entry in found) else " These are too few captures to test, so none has a rank."
    return (
        f"{captures} captures. Sorted by the error of each method's most trusted pixels, averaged over the shares of "
        f"the surface that they make up, {TREATMENTS[ALIKE]}; the rank is one more than the number of methods that are "
        f"shown to be better (95 %, Holm).{tested} Work: seconds × the rate of float32 matrix products where it ran "
        f"(own methods: {machine.get('processor', '?')}, {number(machine.get('gemm_gflops'), 0)} GFLOP/s)."
    )


def as_grid(found: list[Entry], headline: str, at_mm: float, swept: bool) -> Grid:
    """The entries as a table; headline: a metric's title."""
    over = "error over completeness"
    headings = ["rank", "method", "made of", f"{over}, averaged alike (mm)", f"{over}, unsmoothed (mm)"]
    headings += [f"{headline} on common pixels (mm)", "right within 2 mm (%)", "time (s)", "work (GFLOP)"]
    if swept:
        headings += [f"time to {at_mm:g} mm (s)", "front"]
    rows = []
    for e in found:
        cells = [str(e.rank or NONE), e.title, e.inputs, e.by, e.unsmoothed, e.common, number(e.complete_percent, 2)]
        work = f"{e.work:.1g}" if np.isfinite(e.work) else NONE  # the rate is measured beside whatever else runs
        rest = [number(value, three_digits(value)) for value in ((e.reached_s, e.front) if swept else ())]
        rows.append((*cells, number(e.seconds, three_digits(e.seconds)), work, *rest))
    return Grid("Methods, the best first", tuple(headings), tuple(rows), texts=3)


def _submitted(facts: MethodFacts) -> tuple[float, str]:
    """A submission's GFLOP/s and what it was made of; of an own method 0 and "ours"."""
    told: Any = next(iter(facts.config.values()), {})
    if not isinstance(told, dict) or "inputs" not in told or "benchmark" not in told:
        return 0.0, "ours"
    rate = told.get("machine", {}).get("gemm_gflops", np.nan)
    timed = ", time of the whole command" if told.get("timing") == "command" else ""
    inputs = f"{', '.join(map(str, told['inputs']))} (submitted{timed})"
    return float(rate) if isinstance(rate, int | float) else np.nan, inputs


def _equal(result: Result, metric: str, treatment: str, method: str) -> Any:
    """The line of equal.csv, or None."""
    lines = result.equal
    return next(each(lines[(lines.metric == metric) & (lines.treatment == treatment) & (lines.method == method)]), None)


def _text(line: Any) -> str:
    return NONE if line is None else figure(line.value, line.low, line.high, line.unit)
