"""Output of `handbench compare`, the comparison of two results: on the terminal and as files."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from handbench.bench.evaluation.tables import DIFFERENCES, each, write
from handbench.bench.results.compare_results import TIME, Compared
from handbench.reports.tables import latex
from handbench.reports.tables.result_tables import (
    escaped,
    print_table,
    table,
    terminal_table,
    wide_console,
)
from handbench.reports.tables.rounding import NONE, figure, number, p_text
from handbench.support.files import write_json, write_text

CHANGES = 12  # of one kind are shown; compare.json has all
HEADS = ("", "", "A", "B", "B − A", "B / A", "p", "better")
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
    for text in (*_changes(compared), *_findings(compared)):
        console.print(text, markup=False)


def write_compared(compared: Compared, folder: Path) -> None:
    """Write the comparison of two results into a folder as compare.csv (the differences),
    compare.json (everything), compare.md and compare.tex; existing files are replaced."""
    write(folder / "compare.csv", compared.differences, DIFFERENCES)
    write_json(folder / "compare.json", compared.content())
    write_text(folder / "compare.md", markdown(compared))
    write_text(folder / "compare.tex", tex(compared))


def markdown(compared: Compared) -> str:
    """Return the comparison of two results A and B as Markdown: the significant differences in
    words, a table for each metric, and what else differs."""
    parts = [
        "# A and B side by side",
        *map(escaped, _head(compared)),
        _bullets(_findings(compared)),
    ]
    for title, heads, rows in _tables(compared):
        cells = (tuple(map(escaped, row)) for row in rows)
        parts += [f"## {escaped(title)}", table(heads, cells, texts=2)]
    return "\n\n".join((*parts, "## What else differs", _bullets(_changes(compared))))


def _bullets(texts: list[str]) -> str:
    return "\n".join(f"- {escaped(text)}" for text in texts) + "\n"


def tex(compared: Compared) -> str:
    """Return the differences between two results A and B, on average over the captures, as LaTeX
    tables, one for each metric and reference."""
    text = " ".join(_head(compared))
    return "\n".join(
        latex.float_table(
            f"{title}. {text}",
            "ll" + "r" * (len(heads) - 2),
            map(latex.escaped, heads),
            [latex.row(map(latex.escaped, row)) for row in rows if row[0]],
        )
        for title, heads, rows in _tables(compared)
    )


def _tables(compared: Compared) -> Iterator[tuple[str, tuple[str, ...], Rows]]:
    """Yield for each metric and reference a title, the headings, and rows of formatted cells: for
    each method the mean over the captures and then each capture. Columns without text are left
    out."""
    for _, lines in compared.differences.groupby(["metric", "reference"], sort=False):
        first = next(each(lines))
        rows = [HEADS, *map(_row, each(lines))]
        columns = [column for column in zip(*rows, strict=True) if any(column[1:])]
        heads, *rows = zip(*columns, strict=True)
        against = f" against {first.reference}" if first.reference else ""
        yield f"{first.metric_title} ({first.unit}){against}", heads, rows


def _row(line: Any) -> tuple[str, ...]:
    """Return the cells of one line of the table of differences."""
    place = line.capture
    title = ""
    p = ""
    if not place:
        title = line.title
        counts = " and ".join(map(str, dict.fromkeys((line.n_a, line.n_b))))
        place = f"{'median' if line.metric == TIME else 'mean'} of {counts}"
        p = f"not tested ({line.untested})" if line.untested else p_text(line.p_corrected)
    ratio = number(line.b / line.a, 2) if line.metric == TIME else ""
    return (
        title,
        place,
        figure(line.a, line.a_low, line.a_high, line.unit),
        figure(line.b, line.b_low, line.b_high, line.unit),
        figure(line.difference, line.low, line.high, line.unit),
        ratio,
        p,
        line.better,
    )


def _head(compared: Compared) -> list[str]:
    """Return the sentences above the comparison: A and B, which captures are compared, and how
    intervals and p-values are computed."""
    sides = (("A", compared.a), ("B", compared.b))
    names = [f"{side}: {of.folder} ({of.about.name})." for side, of in sides]
    return [*names, compared.basis, NOTE]


def _findings(compared: Compared) -> list[str]:
    """Return a sentence for each significant difference between A and B."""
    differences = compared.differences
    shown = differences.sentence[differences.better != ""].tolist()
    tested = differences.metric_title[differences.p_corrected.notna()].unique()
    return shown or [f"no difference shown in what was tested ({', '.join(tested) or 'nothing'})"]


def _changes(compared: Compared) -> list[str]:
    """Return a line for each fact that differs between A and B, such as a version or an input. Of
    each sort, the first 12 (CHANGES) are listed and the others counted."""
    texts = []
    for what, changes in compared.changes.groupby("what", sort=False):
        first = each(changes[:CHANGES])
        texts += [f"{what} {c.key}: {c.a or NONE} in A, {c.b or NONE} in B" for c in first]
        if len(changes) > CHANGES:
            texts.append(f"{what}: {len(changes) - CHANGES} more, see compare.json")
    return texts or ["nothing else differs"]
