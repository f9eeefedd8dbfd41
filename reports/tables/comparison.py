"""Output of `handbench compare`, the comparison of two results: on the terminal, as Markdown and as
LaTeX."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pandas as pd

from handbench.bench.evaluation.tables import each
from handbench.bench.results.compare_results import Compared
from handbench.reports.tables import latex
from handbench.reports.tables.blocks import NONE, figure, number, p_text
from handbench.reports.tables.result_tables import (
    escaped,
    print_table,
    table,
    terminal_table,
    wide_console,
)
from handbench.support.files import write_text

CHANGES = 12  # of one kind are shown; compare.json has all
SIDES = ("A", "B")
Rows = list[tuple[str, ...]]
NOTE = (
    "In brackets 95 % confidence intervals; p corrected for all tests (Holm); precisions by the "
    "F test, as if all repeats were independent. Errors are tested only if the protocol compares "
    "methods by them: A and B may have them on different pixels. Times are not tested, because "
    "repeats within a run do not show the difference between two runs."
)


def show(compared: Compared) -> None:
    """Print the comparison of two results A and B on stdout: a table for each metric, other changes
    (such as versions or settings), and a sentence for each significant difference."""
    console = wide_console()
    for text in _head(compared):
        console.print(text, markup=False)
    for title, heads, rows in _tables(compared):
        print_table(terminal_table(title, heads, rows))
    for text in (*_changes(compared), *(_shown(compared) or [_nothing(compared)])):
        console.print(text, markup=False)


def write(compared: Compared, folder: Path) -> None:
    """Write the comparison of two results into a folder as compare.md and compare.tex; existing
    files are replaced."""
    write_text(folder / "compare.md", markdown(compared))
    write_text(folder / "compare.tex", tex(compared))


def markdown(compared: Compared) -> str:
    """Return the comparison of two results A and B as Markdown: the significant differences in
    words, a table for each metric, and what else differs."""
    parts = ["# A and B side by side\n", *(f"{escaped(text)}\n" for text in _head(compared))]
    shown = _shown(compared) or [_nothing(compared)]
    parts.append("".join(f"- {escaped(text)}\n" for text in shown))
    for title, heads, rows in _tables(compared):
        cells = (tuple(map(escaped, row)) for row in rows)
        parts += [f"## {escaped(title)}\n", table(heads, cells, texts=2)]
    changes = [f"- {escaped(text)}" for text in _changes(compared)]
    parts += ["## What else differs\n", "\n".join(changes or ["Nothing."]) + "\n"]
    return "\n".join(parts)


def _tables(compared: Compared) -> Iterator[tuple[str, tuple[str, ...], Rows]]:
    """Yield for each metric and reference a title, the headings, and rows of formatted cells: for
    each method the mean over the captures and, if there are several, each capture."""
    for (metric, reference), lines in compared.differences.groupby(
        ["metric", "reference"], sort=False
    ):
        first = next(each(lines))
        against = f" against {reference}" if reference else ""
        title = f"{first.metric_title} ({first.unit}){against}"
        rows = [row for _, of in lines.groupby("method", sort=False) for row in _rows(of)]
        heads = ["", "", "A", "B", "B − A", "p", "better"]
        if metric == "seconds":
            heads = ["", "", *_machines(compared), "B − A", "B / A"]
        filled = [i for i, cells in enumerate(zip(*rows, strict=True)) if any(cells)]
        yield title, tuple(heads[i] for i in filled), [tuple(r[i] for i in filled) for r in rows]


def _rows(lines: pd.DataFrame) -> Rows:
    """Return the rows of one method and metric.
    lines: rows of the table of differences, first the mean, then the captures."""
    mean, *captures = each(lines)
    counts = " and ".join(map(str, dict.fromkeys((mean.n_a, mean.n_b))))
    kind = "median of" if mean.metric == "seconds" else "mean of"
    alone = len(captures) == 1
    place = captures[0].capture if alone else f"{kind} {counts}"
    shown = [(mean, mean.title, place), *((c, "", c.capture) for c in captures if not alone)]
    rows: Rows = []
    for line, title, place in shown:
        figures = (title, place, *_figures(line))
        if line.metric == "seconds":
            rows.append((*figures, number(line.b / line.a, 2)))
        elif line.capture:
            rows.append((*figures, "", ""))
        else:
            rows.append((*figures, _p(line), line.better))
    return rows


def _figures(line: Any) -> list[str]:
    """Return the figures of A and B and their difference as text, each with its interval."""
    ends = ((line.a, line.a_low, line.a_high), (line.b, line.b_low, line.b_high))
    return [figure(*of, line.unit) for of in (*ends, (line.difference, line.low, line.high))]


def _p(line: Any) -> str:
    return f"not tested ({line.untested})" if line.untested else p_text(line.p_corrected)


def tex(compared: Compared) -> str:
    """Return the differences between two results A and B, on average over the captures, as LaTeX
    tables, one for each reference surface. A figure that is significantly better is bold."""
    texts = []
    means = compared.differences[compared.differences.capture == ""]
    for reference, lines in means.groupby("reference", sort=False):
        body = []
        for line in each(lines):
            names = latex.escaped(line.title), latex.title_with_unit(line.metric_title, line.unit)
            *figures, p = map(latex.escaped, (*_figures(line), p_text(line.p_corrected)))
            if line.better in SIDES:
                side = SIDES.index(line.better)
                figures[side] = rf"\textbf{{{figures[side]}}}"
            body.append(latex.row([*names, *figures, p]))
        basis = (
            text
            for text in _basis(compared)
            if reference and text.startswith(f"Against {reference}:")
        )
        text = (
            f"{'; '.join(_sides(compared))}. {' '.join((*basis, NOTE))} Bold: shown to be better."
        )
        texts.append(
            latex.float_table(text, "llrrrr", ("Method", "Metric", "A", "B", "B - A", "p"), body)
        )
    return "\n".join(texts)


def _head(compared: Compared) -> list[str]:
    """Return the sentences above the comparison: names and captures of A and B, which captures are
    compared, and how intervals and p-values are computed."""
    return [*_sides(compared), *_basis(compared), NOTE]


def _shown(compared: Compared) -> list[str]:
    """Return a sentence for each significant difference between A and B."""
    return compared.differences.sentence[compared.differences.better != ""].tolist()


def _nothing(compared: Compared) -> str:
    """Return a sentence for a comparison without a significant difference."""
    tested = compared.differences[compared.differences.p_corrected.notna()].metric_title.unique()
    if not len(tested):
        return "no difference was tested"
    return f"no difference shown between A and B in what was tested ({', '.join(tested)})"


def _sides(compared: Compared) -> list[str]:
    sides = (("A", compared.a), ("B", compared.b))
    return [f"{side}: {of.folder} ({of.name}; {', '.join(of.captures)})" for side, of in sides]


def _basis(compared: Compared) -> list[str]:
    return [f"{text[0].upper()}{text[1:]}." for text in compared.basis]


def _machines(compared: Compared) -> list[str]:
    """Return the headings of A and B in the table of times, each with the machine's rate of matrix
    products in GFLOP/s, by which the times can be judged."""
    rates = (("A", compared.a.gemm_gflops), ("B", compared.b.gemm_gflops))
    return [
        f"{side} (rate unknown)" if rate is None else f"{side} ({rate:.0f} GFLOP/s)"
        for side, rate in rates
    ]


def _changes(compared: Compared) -> list[str]:
    """Return a line for each fact that differs between A and B, such as a version or an input. Of
    each sort, the first 12 (CHANGES) are listed and the others counted."""
    texts = []
    for what, changes in compared.changes.groupby("what", sort=False):
        first = each(changes[:CHANGES])
        texts += [f"{what} {c.key}: {c.a or NONE} in A, {c.b or NONE} in B" for c in first]
        if len(changes) > CHANGES:
            texts.append(f"{what}: {len(changes) - CHANGES} more, see compare.json")
    return texts
