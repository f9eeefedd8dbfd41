"""Formatted figures of a result: for each reference surface a block, which is a table with one or
more lines for each metric. Markdown, LaTeX, terminal and HTML tables are made from these blocks."""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import pandas as pd

from handbench.bench.evaluation.metrics import HEADLINE, chosen
from handbench.bench.evaluation.scoring_protocols import REFERENCES
from handbench.bench.results.about import TREATMENTS, on_common_pixels
from handbench.bench.results.derived import few_pixels
from handbench.bench.results.result_folder import Result
from handbench.reports.tables.rounding import _places, figure, is_known, number, paper
from handbench.reports.tables.table import AGAINST, beside_paper, outstanding

HEADINGS = {
    "photogrammetry": "Scored against photogrammetry",
    "completed": "Scored against photogrammetry and, where the mesh has no surface, against the "
    "true one",
    "truth": "Scored against the true surface",
}
OF_PAPER = {  # added where the paper's figures are next to ours
    "photogrammetry": ", as the paper does",
    "truth": " (the paper's figures are against photogrammetry)",
}
EQUAL_HEADING = "Under equal treatment {against}: the figures that say which method is better"
NAMED = 12  # captures; more are counted


@dataclass(frozen=True)
class Line:
    """One line of a table: the figures of one metric from one source.
    title: of the metric, with its unit; "" if the line continues the metric above. source: whose
    figures these are, such as "ours" or "paper". cells: formatted figures, one for each method.
    best: whether each cell is highlighted (empty: none is). unit: of the metric."""

    metric: str
    title: str
    source: str
    cells: tuple[str, ...]
    best: tuple[bool, ...] = ()
    unit: str = ""


@dataclass(frozen=True)
class Block:
    """A table of the figures against one reference surface.
    methods: titles of the columns; lines: one or more for each metric."""

    reference: str
    heading: str
    methods: tuple[str, ...]
    lines: tuple[Line, ...]


def blocks(result: Result) -> list[Block]:
    """Return one table of figures for each reference surface of the result.
    The first is followed by a table under equal treatment (all depth maps without smoothing, or all
    with the same smoothing), if the result has it."""
    scored = set(result.table.reference)
    found = [_block(result, reference) for reference in REFERENCES if reference in scored]
    equal = _equal_block(result)
    if few := few_pixels(result.scores, result.scored()):
        noted = equal or found[:1]
        noted[0] = replace(noted[0], heading=f"{noted[0].heading}; {few}")
        found[:1] = found[:1] if equal else noted
    return [*found[:1], *equal, *found[1:]]


def paper_block(block: Block) -> Block:
    """Return the part of a table with the metrics that the paper reports and the main ones."""
    metrics = {line.metric for line in block.lines if line.source == "paper"} | set(chosen("main"))
    return replace(block, lines=tuple(line for line in block.lines if line.metric in metrics))


def _equal_block(result: Result) -> list[Block]:
    """Return a list with the table of figures under equal treatment (all depth maps without
    smoothing, or all with the same smoothing); empty if the result has none."""
    if result.equal.empty:
        return []
    reference, names = (
        result.equal.reference.iloc[0],
        [method.name for method in result.about.methods],
    )
    lines: list[Line] = []
    for metric in dict.fromkeys(result.equal.metric):
        for treatment, words in TREATMENTS.items():
            table = result.equal[
                (result.equal.metric == metric) & (result.equal.treatment == treatment)
            ]
            rows = table.set_index("method").reindex(names).assign(paper=math.nan)
            if rows.metric.notna().any():
                unit = rows.unit.dropna().iloc[0]
                title = f"{result.title(metric)}{on_common_pixels(metric)} ({unit})"
                stars = outstanding(result, metric, reference, treatment)
                lines += [
                    replace(line, source=words) for line in _lines(metric, title, rows, stars)
                ]
    titles = tuple(method.title for method in result.about.methods)
    return [
        Block(reference, EQUAL_HEADING.format(against=AGAINST[reference]), titles, tuple(lines))
    ]


def _block(result: Result, reference: str) -> Block:
    table = result.table[result.table.reference == reference].drop_duplicates(["metric", "method"])
    names = [method.name for method in result.about.methods]
    lines: list[Line] = []
    for metric, facts in result.about.metrics.items():
        rows = table[table.metric == metric].set_index("method").reindex(names)
        if rows.metric.notna().any():
            lines += _lines(
                metric,
                f"{facts.title} ({facts.unit})",
                rows,
                outstanding(result, metric, reference),
            )
    titles = tuple(method.title for method in result.about.methods)
    heading = HEADINGS[reference] + OF_PAPER.get(reference, "") * beside_paper(result)
    return Block(reference, heading, titles, tuple(lines))


def _lines(metric: str, title: str, rows: pd.DataFrame, stars: frozenset[str]) -> list[Line]:
    """Return the lines of one metric: our figures and, if the paper reports the metric, its figures
    and, unless they are percentages, the ratio of both.
    rows: figures of the metric, indexed by method, NaN where a method has none; stars: methods to
    highlight."""
    unit = rows.unit.dropna().iloc[0]
    best = tuple(name in stars for name in rows.index) if stars else ()
    ours = rows[["value", "low", "high", "unit"]].itertuples(index=False, name=None)
    lines = [Line(metric, title, "ours", tuple(figure(*cells) for cells in ours), best, unit)]
    if rows.paper.notna().any():
        lines.append(
            Line(metric, "", "paper", tuple(paper(value, unit) for value in rows.paper), unit=unit)
        )
        if unit != "%":  # a ratio of percentages near 100 says nothing
            lines.append(
                Line(
                    metric, "", "ours / paper", tuple(number(r, 2) for r in ratio(rows)), unit=unit
                )
            )
    return lines


def ratio(rows: pd.DataFrame) -> pd.Series:
    """Return our figure divided by the paper's, for each row of the result's table; NaN if one of
    them is missing or the paper's is 0."""
    return rows.value / rows.paper.where(rows.paper != 0)


def interval(low: float | None, high: float | None, places: int) -> str:
    """Format an interval as "[low, high]" with `places` decimals; "" if an end is unknown."""
    return (
        f"[{number(low, places)}, {number(high, places)}]"
        if is_known(low) and is_known(high)
        else ""
    )


def rounded(value: float | None) -> str:
    """Format a number with three significant digits, but at most six decimals; a missing number
    is a dash."""
    return number(value, _places(value, 3) if value and is_known(value) else 0)


def caption(result: Result) -> str:
    """Return the text below the tables of figures: which captures were averaged, what the brackets
    mean, and warnings on disturbed times and refined transforms."""
    scored, repeated = result.scored(), result.repeated()
    names = named([capture.name for capture in scored])
    precision = (
        f"precision over the repeats of {named([c.name for c in repeated])}; "
        if repeated not in ((), scored)
        else ""
    )
    refined = result.about.facts.get("refined_transforms", {})
    warning = "".join(f" The transform of {name} was {reason}." for name, reason in refined.items())
    return (
        f"Each figure formed for each capture ({names}) and then averaged, but for the "
        f"pooled ones; {precision}in brackets the 95 % confidence interval; ground-truth floor: "
        f"the {result.title(HEADLINE)} that a perfect radar would show, because the reference "
        "itself has errors; time per frame on the machine named in the result."
        f"{busy_note(result)}{warning}"
    )


def busy_note(result: Result) -> str:
    """Return a warning on times that other work on the machine disturbed. It begins with a blank;
    "" if there are none."""
    busy = result.busy()
    if not busy:
        return ""
    return (
        f" The machine was busy: other work took up to {max(busy.values()):.1f} cores while "
        f"{_titles(result, busy)} were timed; their times are too long."
    )


def _titles(result: Result, names: Collection[str]) -> str:
    return ", ".join(method.title for method in result.about.methods if method.name in names)


def named(names: Sequence[str]) -> str:
    """Return names as a list, or if they are more than 12 (NAMED), their first, last and number."""
    return (
        ", ".join(names)
        if len(names) <= NAMED
        else f"{names[0]} to {names[-1]}, {len(names)} in all"
    )


def best_note(found: list[Block]) -> str:
    """Return a sentence that explains bold figures, beginning with a blank; "" if no figure in the
    tables is bold."""
    if not any(any(line.best) for block in found for line in block.lines):
        return ""
    return (
        " Bold: the best figure and all that are not shown to be worse than it (paired test on "
        "the same captures, 5 % "
        "for all pairs together)."
    )
