"""The tables of a result as Markdown, CSV and on the terminal (LaTeX: `reports.tables.latex`)."""

from __future__ import annotations

import csv
import io
import statistics
from dataclasses import dataclass
from typing import TYPE_CHECKING

from bench.results import Result, Setting, Task, Tradeoff
from reports.tables.blocks import NONE, Line, best_note, blocks, caption, figure, number, p_text, ratio, three_digits
from reports.tables.markdown import bold, escaped, table

if TYPE_CHECKING:
    from rich.table import Table

HEADLINE = ("mae_mm", "floor_mm", "max_mm", "completeness_percent", "precision_mm", "seconds")


def markdown(result: Result) -> str:
    """Every block as a Markdown table."""
    found = blocks(result)
    parts = [f"# {escaped(result.about.name)}\n", f"{escaped(caption(result) + best_note(found))}\n"]
    for block in found:
        parts.append(f"## {block.heading}\n")
        headings = ("metric", "", *map(escaped, block.methods))
        parts.append(table(headings, (_markdown_cells(line) for line in block.lines), texts=2))
    return "\n".join(parts)


def _markdown_cells(line: Line) -> tuple[str, ...]:
    best = line.best or (False,) * len(line.cells)
    cells = (bold(escaped(cell)) if star else escaped(cell) for cell, star in zip(line.cells, best, strict=True))
    return (escaped(line.title), escaped(line.source), *cells)


def comparisons_markdown(result: Result) -> str:
    """Every tested difference: in words, with its p and size. Empty where nothing was compared."""
    if not result.comparisons:
        return ""
    lines = (
        (escaped(c.sentence), c.reference, p_text(c.p_corrected), number(c.effect, 2), str(c.n_captures))
        for c in result.comparisons
    )
    return (
        f"# {escaped(result.about.name)}: which method is better\n\n"
        "In brackets the 95 % confidence interval; p corrected for all pairs of a metric (Holm); effect: the "
        "difference over the standard deviation of the paired differences.\n\n"
        + table(("", "against", "p", "effect", "captures"), lines, texts=2)
    )


def tradeoff_markdown(tradeoff: Tradeoff) -> str:
    """What each setting costs and buys, a table a section; bold: the front, which no other setting beats."""
    parts = [
        f"# {escaped(tradeoff.facts.name)}: accuracy against time\n",
        "Bold: no other setting is as fast, "
        "accurate and complete. In brackets the 95 % confidence interval, of times the range of the repeats.\n",
    ]
    for section in tradeoff.facts.sections:
        parts.append(f"## {escaped(section.title)}\n")
        parts.append(f"{escaped(section.metric)}: {escaped(section.definition)}; seconds: {escaped(section.seconds)}\n")
        error = f"{escaped(section.metric)} ({escaped(section.unit)})"
        settings = tradeoff.section(section.name)
        seen = ["seen (%)"] if any(s.seen_percent is not None for s in settings) else []
        headings = ("setting", error, *seen, "time (s)", "× reference")
        parts.append(table(headings, (_setting(s, bool(seen)) for s in settings)))
    return "\n".join(parts)


def _setting(s: Setting, with_seen: bool) -> tuple[str, ...]:
    title = bold(escaped(s.title)) if s.on_front else escaped(s.title)
    error, seconds = figure(s.error, s.low, s.high, s.unit), figure(s.seconds, s.seconds_low, s.seconds_high, "s")
    seen = [number(s.seen_percent, 2)] if with_seen else []
    return title, escaped(error), *seen, escaped(seconds), number(s.ratio, three_digits(s.ratio))


def csv_text(result: Result) -> str:
    """The result's lines with the ratio to the paper and the method's time beside every figure."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(("metric", "method", "value", "low", "high", "unit", "paper", "ratio", "reference", "seconds"))
    for row in result.rows:
        time = result.row("seconds", row.method, row.reference)
        seconds = time.value if time else None
        cells = (row.metric, row.method, row.value, row.low, row.high, row.unit, row.paper, ratio(row))
        writer.writerow("" if cell is None else cell for cell in (*cells, row.reference, seconds))
    return stream.getvalue()


@dataclass(frozen=True)
class Stage:
    """One line of the time table: medians over the tasks of a method's stage, ready to read."""

    method: str
    stage: str
    tasks: int
    cached: int
    seconds: str
    cpu_seconds: str
    peak_memory_mb: str


def stages(result: Result) -> list[Stage]:
    """The tasks of each method and stage, in the order in which they first ran."""
    titles = {method.name: method.title for method in result.about.methods}
    groups: dict[tuple[str, str], list[Task]] = {}
    for task in result.tasks:
        groups.setdefault((task.method, task.stage), []).append(task)
    return [
        Stage(
            titles.get(method, method) or "every method",
            stage,
            len(tasks),
            sum(task.cached for task in tasks),
            _median([task.seconds for task in tasks]),
            _median([task.cpu_seconds for task in tasks]),
            _median([task.peak_memory_mb for task in tasks]),
        )
        for (method, stage), tasks in groups.items()
    ]


def _median(values: list[float | None]) -> str:
    known = [value for value in values if value is not None]
    return number(statistics.median(known), three_digits(statistics.median(known))) if known else NONE


def show(result: Result) -> None:
    """Print the headline figures on stdout, as wide as they need."""
    console = wide_console()
    for block in blocks(result):
        lines = [line for line in block.lines if line.metric in HEADLINE]
        cells = [(line.title, line.source, *line.cells) for line in lines]
        console.print(terminal_table(block.heading, ("", "", *block.methods), cells))
    for failure in result.about.failures:
        console.print(failure.line, markup=False)


def wide_console():
    """A rich console on stdout; a pipe or a file has no width to keep to."""
    from rich.console import Console

    console = Console(highlight=False)
    if not console.is_terminal:
        console.width = 200
    return console


def terminal_table(heading: str, columns: tuple[str, ...], lines: list[tuple[str, ...]]) -> Table:
    """A rich table; columns without a heading are texts, the others numbers."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    grid = Table(title=Text(heading), title_justify="left", box=box.SIMPLE, pad_edge=False)
    for column in columns:
        grid.add_column(Text(column), justify="right" if column else "left")
    for cells in lines:
        grid.add_row(*map(Text, cells))
    return grid
