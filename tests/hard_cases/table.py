"""A table of text and numbers, printed as Markdown."""

from typing import NamedTuple


class Table(NamedTuple):
    """text: one sentence on what the rows show."""

    title: str
    text: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str | float | None, ...], ...]

    def markdown(self) -> str:
        """The rows, numbers with three digits."""
        lines = [
            self.columns,
            ["---"] * len(self.columns),
            *([_cell(cell) for cell in row] for row in self.rows),
        ]
        return "".join("| " + " | ".join(line) + " |\n" for line in lines)


def _cell(value: str | float | None) -> str:
    if value is None or value != value:  # NaN alone differs from itself
        return "–"
    return f"{value:.3g}" if isinstance(value, float) else str(value).replace("|", "\\|")
