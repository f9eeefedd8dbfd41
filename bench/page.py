"""What the pages of measurements share: tables for the documentation, the look of the figures."""

from __future__ import annotations

STYLE = {"font.size": 9, "axes.titlesize": 9, "axes.linewidth": 0.6, "savefig.dpi": 160}


def markdown_table(lines: list[list[str]], words: tuple[int, ...] = (0,)) -> str:
    """A Markdown table from its heading and lines of cells; all columns but those of `words` are aligned as numbers."""
    head, *body = lines
    rule = ["---" if column in words else "--:" for column in range(len(head))]
    return "".join("| " + " | ".join(cells) + " |\n" for cells in (head, rule, *body))
