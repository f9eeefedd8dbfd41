"""The report of several results: a ranking of their methods, and the report of each result."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from handbench.bench.results import RANKING, Result, each, write_table
from handbench.reports.page import html, rendering
from handbench.reports.page.sections import Grid
from handbench.reports.tables.blocks import NONE, figure, number, rounded
from handbench.reports.tables.result_tables import bold, escaped, table
from handbench.support.files import write_text

HEADINGS = (
    *("rank", "method", "result", "right within 2 mm (%)", "MAE (mm)"),
    *("error over completeness, averaged (mm)", "up to (% of the surface)", "time (s)"),
)


def build(results: Sequence[Result], ranking: pd.DataFrame, about: str, out: Path) -> Path:
    """Write a report of several results to `out`: leaderboard.md, leaderboard.csv and index.html
    with the ranking of all methods, and the report of each result in report-1, report-2, … Returns
    the path of index.html.

    ranking: the methods, best first, with the columns of the table RANKING; about: text that
    explains the ranking.
    """
    rendering.begin(out)
    reports = {}
    for count, result in enumerate(results, 1):
        reports[str(result.folder)] = f"report-{count}/index.html"
        html.build(result.folder, out / f"report-{count}")
    lines = list(each(ranking))
    rows = [_cells(line) for line in lines]
    grid = Grid("Methods, the best first", HEADINGS, tuple(rows), texts=3)
    cells = [tuple(map(escaped, row)) for row in rows]
    first = [
        tuple(map(bold, row)) if line.rank == 1 else row
        for line, row in zip(lines, cells, strict=True)
    ]
    write_text(
        out / "leaderboard.md",
        f"# Leaderboard\n\n{escaped(about)}\n\n{table(HEADINGS, first, texts=3)}",
    )
    write_table(out / "leaderboard.csv", ranking, RANKING)
    page = rendering.render("leaderboard.html", about=about, grid=grid, reports=reports)
    write_text(out / "index.html", page)
    return out / "index.html"


def _cells(line: Any) -> tuple[str, ...]:
    return (
        str(line.rank or NONE),
        line.method,
        line.result,
        figure(line.complete_2mm_percent, line.low, line.high, "%"),
        rounded(line.mae_mm),
        rounded(line.aurc_mm),
        number(line.aurc_to_percent, 1),
        rounded(line.seconds),
    )
