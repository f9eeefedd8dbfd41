"""What the pages of measurements share: tables for the documentation, the look of the figures, the files."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import TYPE_CHECKING

from radar.support.files import atomic_path, write_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STYLE = {"font.size": 9, "axes.titlesize": 9, "axes.linewidth": 0.6, "savefig.dpi": 160}


def markdown_table(lines: list[list[str]], words: tuple[int, ...] = (0,)) -> str:
    """A Markdown table from its heading and lines of cells; all columns but those of `words` are aligned as numbers."""
    head, *body = lines
    rule = ["---" if column in words else "--:" for column in range(len(head))]
    return "".join("| " + " | ".join(cells) + " |\n" for cells in (head, rule, *body))


def write_page(file: Path, text: str, lines: list[list[str]], figure: Figure | None = None) -> None:
    """Write `file` with the suffixes .md (text), .csv (lines of cells) and, if there is a figure, .png."""
    file.parent.mkdir(parents=True, exist_ok=True)
    write_text(file.with_suffix(".md"), text)
    with atomic_path(file.with_suffix(".csv")) as temporary, temporary.open("w", newline="", encoding="utf-8") as out:
        csv.writer(out).writerows(lines)
    if figure is not None:
        with atomic_path(file.with_suffix(".png")) as temporary:
            figure.savefig(temporary, format="png")
