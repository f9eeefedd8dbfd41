"""Tables of a result as Markdown, as CSV and for the terminal, and sentences on the main
comparisons of methods. (`reports.tables.latex` makes the same tables as LaTeX.)"""

import html
import os
import re
from collections.abc import Collection, Iterable, Sequence
from itertools import groupby, zip_longest
from typing import Any

from rich import box
from rich.cells import cell_len
from rich.console import Console
from rich.table import Table
from rich.text import Text

from handbench.bench.evaluation.metrics import chosen
from handbench.bench.evaluation.tables import LEVEL, each
from handbench.bench.results.about import TREATMENTS
from handbench.bench.results.result_folder import Result
from handbench.reports.tables.blocks import best_note, blocks, caption, ratio
from handbench.reports.tables.rounding import is_known, number, p_text

PAIRS = (
    ("3fsk", "2fsk"),
    ("3fsk", "broadband"),
    ("nfsk-plus", "broadband"),
    ("broadband", "narrowband"),
)


def findings(result: Result) -> list[str]:
    """Return for each of the main pairs of methods (PAIRS) a sentence that says which one is better
    and by how much.
    The error on common pixels is compared under equal treatment, that is with all depth maps
    unsmoothed, or all with the same smoothing. A pair that was not compared has no sentence."""
    return [
        f"{pair}, on the pixels that all see: {common}{few}" for pair, common, few in claims(result)
    ]


def claims(result: Result) -> list[tuple[str, str, str]]:
    """Return what `findings` says of each pair: the methods, which one is better on common pixels,
    and a note if there was no test."""
    return [claim for pair in PAIRS if (claim := _claim(result, *pair))]


def _claim(result: Result, first: str, second: str) -> tuple[str, str, str] | None:
    lines = result.comparisons
    lines = lines[
        (lines.treatment != "")
        & (lines.better.isin((first, second)) & lines.worse.isin((first, second)))
    ]
    if lines.empty:
        return None
    titles = result.about.method_titles
    amounts = {line.treatment: _ahead(line, titles) for line in each(lines)}
    common = [amounts[treatment] for treatment in TREATMENTS if treatment in amounts]
    untested, count = lines.p_corrected.isna().all(), lines.n_captures.iloc[0]
    captures = "1 capture" if count == 1 else f"{count} captures"
    few = f" ({captures}: too few for a test)" if untested else ""
    return f"{titles[first]} and {titles[second]}", _joined(common), few


def _joined(findings: list[tuple[str, str]]) -> str:
    """Join findings, each a pair (which method is ahead, by how much), to one text. A method that
    is ahead in consecutive findings is named once."""
    groups = groupby(findings, key=lambda finding: finding[0])
    return ", ".join(f"{who} {' and '.join(amount for _, amount in of)}" for who, of in groups)


def _ahead(line: Any, titles: dict[str, str]) -> tuple[str, str]:
    places = 1 if line.difference >= 1 else 2
    amount, how = f"{number(line.difference, places)} mm", TREATMENTS[line.treatment]
    if not is_known(line.p_corrected):
        return f"{titles[line.better]} ahead by", f"{amount} {how}"
    if line.p_corrected < 1 - LEVEL:
        ends = f"[{number(line.low, places)}, {number(line.high, places)}]"
        return f"{titles[line.better]} better by", f"{amount} {how} {ends}"
    return "no difference shown", f"{how} ({amount})"


def table(headings: Sequence[str], lines: Iterable[Sequence[str]], texts: int = 1) -> str:
    """Return a Markdown table.
    headings: one for each column; lines: rows of cells, already escaped. The first `texts` columns
    are aligned left, the others right."""
    rule = "|" + "---|" * texts + "--:|" * (len(headings) - texts)
    return "\n".join([_line(headings), rule, *map(_line, lines)]) + "\n"


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def escaped(text: str) -> str:
    """Return `text` on one line for a cell of a Markdown table, escaped so that Markdown and HTML
    show it literally."""
    return re.sub(r"([\\`*_\[\]|#~$])", r"\\\1", html.escape(" ".join(text.split()), quote=False))


def bold(text: str) -> str:
    """Return Markdown text in bold."""
    return f"**{text}**"


def markdown(result: Result) -> str:
    """Return all figures of a result as Markdown: a caption, then one table for each reference
    surface and one for the methods under equal treatment (same smoothing, common pixels). The best
    figures are bold."""
    found = blocks(result)
    parts = [
        f"# {escaped(result.about.name)}\n",
        f"{escaped(caption(result) + best_note(found))}\n",
    ]
    for block in found:
        parts.append(f"## {block.heading}\n")
        headings = ("metric", "", *map(escaped, block.methods))
        lines = []
        for line in block.lines:
            stars = zip_longest(map(escaped, line.cells), line.best)
            lines.append(
                (
                    escaped(line.title),
                    line.source,
                    *(bold(cell) if best else cell for cell, best in stars),
                )
            )
        parts.append(table(headings, lines, texts=2))
    return "\n".join(parts)


def comparisons_markdown(result: Result) -> str:
    """Return the tested differences between methods as Markdown: the main findings as a list, then
    a table of every difference in words with its p-value and effect size. Empty if nothing was
    compared."""
    if result.comparisons.empty:
        return ""
    bullets = "".join(f"- {escaped(finding)}\n" for finding in findings(result))
    lines = (
        (
            escaped(c.sentence),
            c.reference,
            p_text(c.p_corrected),
            number(c.effect, 2),
            str(c.n_captures),
        )
        for c in each(result.comparisons)
    )
    return (
        f"# {escaped(result.about.name)}: which method is better\n\n{bullets}\n"
        "In brackets the 95 % confidence interval; p corrected for all pairs of a metric (Holm); "
        "effect: the "
        "difference over the standard deviation of the paired differences.\n\n"
        + table(("", "against", "p", "effect", "captures"), lines, texts=2)
    )


def csv_text(result: Result) -> str:
    """Return the main table of a result as CSV, with one line for each metric, method and reference
    surface.
    Each line also has the ratio of our figure to the paper's, and the method's seconds per
    frame."""
    times = result.table[result.table.metric == "seconds"].drop_duplicates(["method", "reference"])
    seconds = times.set_index(["method", "reference"]).value
    lines = result.table.assign(ratio=ratio(result.table)).join(
        seconds.rename("seconds"), on=["method", "reference"]
    )
    columns = [
        "metric",
        "method",
        "value",
        "low",
        "high",
        "unit",
        "paper",
        "ratio",
        "reference",
        "seconds",
    ]
    return lines[columns].to_csv(index=False, lineterminator="\n")


def show(result: Result) -> None:
    """Print the main figures of a result on stdout: a table for each reference surface, then the
    main findings and a line for each stage that failed."""
    console, main = wide_console(), chosen("main")
    for block in blocks(result):
        lines = [line for line in block.lines if line.metric in main]
        cells = [(line.title, line.source, *line.cells) for line in lines]
        print_table(terminal_table(block.heading, ("", "", *block.methods), cells))
    for finding in findings(result):
        console.print(finding, markup=False)
    for failure in result.about.failures:
        console.print(failure.line, markup=False)


def wide_console(piped: int = 200) -> Console:
    """Return a rich console on stdout. It is as wide as the terminal or the variable COLUMNS; in a
    pipe or a file without COLUMNS, lines have up to `piped` characters."""
    console = Console(highlight=False)
    if not console.is_terminal and "COLUMNS" not in os.environ:
        console.width = piped
    return console


def print_table(table: Table, piped: int = 200) -> None:
    """Print a table on stdout, in a pipe or a file with lines of up to `piped` characters.
    Cells are broken only between words. If a row does not fit on the terminal even so, the lines
    become longer than the terminal is wide, so that no figure is cut."""
    console = wide_console(piped)
    texts = [[str(cell) for cell in (c.header, *c.cells)] for c in table.columns]
    least, most = (
        [max((cell_len(part) for text in of for part in split(text)), default=0) for of in texts]
        for split in (str.split, str.splitlines)
    )
    unlimited = console.options.update(width=10_000)
    around = console.measure(table, options=unlimited).maximum - sum(most)
    room = console.width - around - sum(least)
    for column, low, high in zip(table.columns, least, most, strict=True):
        column.width = low + min(max(room, 0), high - low)
        room -= column.width - low
    console.width = max(console.width, around + sum(least))
    console.print(table)


def terminal_table(
    heading: str,
    columns: Sequence[str],
    lines: Iterable[Sequence[str]],
    texts: Collection[str] = ("",),
) -> Table:
    """Return a rich table to print on the terminal.
    heading: title, may be empty; columns: headings of the columns; lines: rows of plain cells;
    texts: headings of the columns that are aligned left (default: those without a heading); the
    others are aligned right."""
    grid = Table(
        title=Text(heading) if heading else None,
        title_justify="left",
        box=box.SIMPLE,
        pad_edge=False,
    )
    for column in columns:
        grid.add_column(Text(column), justify="left" if column in texts else "right")
    for cells in lines:
        grid.add_row(*map(Text, cells))
    return grid
