"""A table of text and numbers, printed as Markdown."""

from collections.abc import Iterable


def markdown(columns: tuple[str, ...], rows: Iterable[tuple[str | float, ...]]) -> str:
    """The rows, numbers with three digits."""
    cells = [columns, ["---"] * len(columns), *(map(_cell, row) for row in rows)]
    return "".join("| " + " | ".join(line) + " |\n" for line in cells)


def _cell(value: str | float) -> str:
    return f"{value:.3g}" if isinstance(value, float) else value.replace("|", "\\|")
