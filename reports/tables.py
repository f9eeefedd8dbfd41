"""The table: ours beside the paper's, for Markdown, LaTeX, CSV, HTML and the terminal."""

from __future__ import annotations

import csv
import html
import io
import math
import re
import statistics
from dataclasses import dataclass

from bench.results import REFERENCES, Result, Row, Task

HEADINGS = {
    "photogrammetry": "Scored against photogrammetry, as the paper does",
    "truth": "Scored against the true surface (the paper's figures are against photogrammetry)",
}
HEADLINE = ("mae_mm", "floor_mm", "max_mm", "completeness_percent", "precision_mm", "seconds")
NONE = "–"


@dataclass(frozen=True)
class Line:
    """One line of a block. title: with the unit, empty where the metric goes on; source: whose figures;
    cells: one a method."""

    metric: str
    title: str
    source: str
    cells: tuple[str, ...]


@dataclass(frozen=True)
class Block:
    """The figures against one reference; methods: the titles of the columns."""

    reference: str
    heading: str
    methods: tuple[str, ...]
    lines: tuple[Line, ...]


def blocks(result: Result) -> list[Block]:
    """One block for each reference that the result was scored against."""
    scored = {row.reference for row in result.rows}
    return [_block(result, reference) for reference in REFERENCES if reference in scored]


def _block(result: Result, reference: str) -> Block:
    lines: list[Line] = []
    for metric, facts in result.about.metrics.items():
        rows = [result.row(metric, method.name, reference) for method in result.about.methods]
        if any(rows):
            lines += _lines(metric, f"{facts.title} ({facts.unit})", rows)
    titles = tuple(method.title for method in result.about.methods)
    return Block(reference, HEADINGS[reference], titles, tuple(lines))


def _lines(metric: str, title: str, rows: list[Row | None]) -> list[Line]:
    lines = [Line(metric, title, "ours", tuple(map(_ours, rows)))]
    published = [row for row in rows if row and row.paper is not None]
    if published:
        lines.append(Line(metric, "", "paper", tuple(map(_paper, rows))))
    if published and published[0].unit != "%":  # a ratio of percentages near 100 says nothing
        lines.append(Line(metric, "", "ours / paper", tuple(_number(ratio(row), 2) for row in rows)))
    return lines


def ratio(row: Row | None) -> float | None:
    """Ours over the paper's; None without either."""
    if row is None or row.value is None or not row.paper:
        return None
    return row.value / row.paper


def _ours(row: Row | None) -> str:
    if row is None or row.value is None:
        return NONE
    decimals = _decimals(row)
    value = _number(row.value, decimals)
    if row.low is None or row.high is None:
        return value
    return f"{value} [{_number(row.low, decimals)}, {_number(row.high, decimals)}]"


def _paper(row: Row | None) -> str:
    return NONE if row is None or row.paper is None else _number(row.paper, 1 if row.unit == "mm" else 2)


def _decimals(row: Row) -> int:
    """Three significant digits; percentages always with two decimals, for they crowd below 100."""
    if row.unit == "%":
        return 2
    return 0 if row.unit == "pixels" else _three_digits(row.value)


def _three_digits(value: float | None) -> int:
    """Decimals that show three significant digits, six at most."""
    return min(max(2 - math.floor(math.log10(abs(value))), 0), 6) if value else 0


def _number(value: float | None, decimals: int) -> str:
    return NONE if value is None else f"{value:.{decimals}f}".replace("-", "−")


def markdown(result: Result) -> str:
    """Every block as a Markdown table."""
    parts = [f"# {_markdown(result.about.name)}\n", f"{_markdown(caption(result))}\n"]
    for block in blocks(result):
        parts.append(f"## {block.heading}\n")
        parts.append(_markdown_line(("metric", "", *block.methods)))
        parts.append("|---|---|" + "--:|" * len(block.methods))
        parts += [_markdown_line((line.title, line.source, *line.cells)) for line in block.lines]
        parts.append("")
    return "\n".join(parts)


def _markdown_line(cells: tuple[str, ...]) -> str:
    return "| " + " | ".join(map(_markdown, cells)) + " |"


def _markdown(text: str) -> str:
    return re.sub(r"([\\`*_\[\]|#~$])", r"\\\1", html.escape(" ".join(text.split()), quote=False))


def caption(result: Result) -> str:
    """What the figures stand on, in one sentence."""
    captures = ", ".join(capture.name for capture in result.scored())
    floor = ""
    if any(row.metric == "floor_mm" for row in result.rows):  # results of earlier versions have none
        floor = (
            "ground-truth floor: the MAE that a perfect radar would show, because the reference errs itself, and where "
            "it would lie in 95 % of all draws of that error; "
        )
    refined = result.about.facts.get("refined_transforms", {})
    warning = "".join(f" The transform of {name} was {reason}." for name, reason in refined.items())
    return (
        f"Pixels pooled over the captures {captures}; in brackets the 95 % confidence interval; {floor}"
        f"time per frame on the machine named in the result.{warning}"
    )


def floor_note(result: Result) -> str:
    """A sentence for the captions of pictures that show an MAE, with a blank before it: the floors that are known and
    not zero, the largest of the methods'. Empty without one."""
    floors = dict.fromkeys(REFERENCES, 0.0)
    for row in result.rows:
        if row.metric == "floor_mm" and row.reference in floors:
            floors[row.reference] = max(floors[row.reference], row.value or 0.0)
    known = ", ".join(f"{_number(v, _three_digits(v))} mm against {reference}" for reference, v in floors.items() if v)
    return f" Ground-truth floor, the MAE of a perfect radar: {known}." if known else ""


def latex(result: Result) -> str:
    """Every block as a LaTeX table; the document needs booktabs and UTF-8."""
    return "\n".join(_latex_block(result, block) for block in blocks(result))


def _latex_block(result: Result, block: Block) -> str:
    body = []
    for line in block.lines:
        if line.title and body:
            body.append(r"\addlinespace")
        body.append(_latex_line((line.title, line.source, *line.cells)))
    return "\n".join([
        r"% needs \usepackage{booktabs}",
        r"\begin{table*}",
        r"\centering",
        rf"\caption{{{_latex(result.about.name)}. {_latex(block.heading)}. {_latex(caption(result))}}}",
        rf"\begin{{tabular}}{{ll{'r' * len(block.methods)}}}",
        r"\toprule",
        _latex_line(("Metric", "", *block.methods)),
        r"\midrule",
        *body,
        r"\bottomrule",
        r"\end{tabular}",
        r"\end{table*}",
        "",
    ])


def _latex_line(cells: tuple[str, ...]) -> str:
    return " & ".join(map(_latex, cells)) + r" \\"


LATEX = {
    "\\": r"\textbackslash{}", "{": r"\{", "}": r"\}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_",
    "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": r"\textless{}", ">": r"\textgreater{}",
    "|": r"\textbar{}", '"': "''", "−": "$-$", "–": "--", "[": "{[}", "]": "{]}",
}


def _latex(text: str) -> str:
    return "".join(LATEX.get(character, character) for character in " ".join(text.split()))


def csv_text(result: Result) -> str:
    """The result's lines with the ratio to the paper and the method's time beside every figure."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(
        ("metric", "method", "value", "low", "high", "unit", "paper", "ratio", "reference", "seconds")
    )
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
            titles.get(method, method) or "every method", stage, len(tasks), sum(task.cached for task in tasks),
            _median([task.seconds for task in tasks]), _median([task.cpu_seconds for task in tasks]),
            _median([task.peak_memory_mb for task in tasks]),
        )
        for (method, stage), tasks in groups.items()
    ]


def _median(values: list[float | None]) -> str:
    known = [value for value in values if value is not None]
    return _number(statistics.median(known), _three_digits(statistics.median(known))) if known else NONE


def show(result: Result) -> None:
    """Print the headline figures on stdout, as wide as they need."""
    from rich.console import Console

    console = Console(highlight=False)
    if not console.is_terminal:  # a pipe or a file has no width to keep to
        console.width = 200
    for block in blocks(result):
        console.print(_terminal(block))
    for failure in result.about.failures:
        console.print(failure.line, markup=False)


def _terminal(block: Block):
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(title=Text(block.heading), title_justify="left", box=box.SIMPLE, pad_edge=False)
    for heading in ("", "", *block.methods):
        table.add_column(Text(heading), justify="right" if heading else "left")
    for line in block.lines:
        if line.metric in HEADLINE:
            table.add_row(*map(Text, (line.title, line.source, *line.cells)))
    return table
