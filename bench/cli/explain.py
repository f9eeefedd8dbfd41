"""The table of a scene's effects, for people: estimate, on or off, why, and what each took."""

from __future__ import annotations

from radar.simulation.selection import Choice


def show(rows: tuple[Choice, ...]) -> None:
    """Print the table on stdout, as wide as it needs."""
    from rich import box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    console = Console(highlight=False)
    if not console.is_terminal:  # a pipe or a file has no width to keep to
        console.width = 200
    table = Table(box=box.SIMPLE, pad_edge=False)
    for heading in ("effect", "depth mm", "level dB", "on", "seconds", "why"):
        table.add_column(heading, justify="right" if heading in ("depth mm", "level dB", "seconds") else "left")
    for row in rows:
        seconds = row.cost_s if row.seconds is None else row.seconds
        mark = "~" if row.seconds is None and seconds else ""
        cells = (
            row.effect,
            _number(row.depth_mm, 3),
            _number(row.level_db, 1),
            "on" if row.on else "–",
            mark + _number(seconds, 2),
            row.why,
        )
        table.add_row(*map(Text, cells))
    console.print(table)


def _number(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"
