"""The result as Markdown tables."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table

Cell = Callable[[dict[str, Any]], str]


def print_tables(result: dict[str, Any], console: Console | None = None) -> None:
    """Print the rows by section, how cost grows, and the bars."""
    console = console or Console(width=190)
    for section in dict.fromkeys(row["section"] for row in result["rows"]):
        rows = [row for row in result["rows"] if row["section"] == section]
        console.print(_table(section, COLUMNS, rows))
    console.print(_table("growth", GROWTH, result["growth"]))
    console.print(_table("bar", BARS, result["bars"]))
    before, after = (load[0] for load in (result["load"]["before"], result["load"]["after"]))
    console.print(f"load average (1 min): {before:.1f} before, {after:.1f} after; {result['minutes']:.1f} minutes")


def _table(title: str, columns: dict[str, Cell], rows: Iterable[dict[str, Any]]) -> Table:
    """One table; columns that no row fills are left out. The first heading is the title."""
    cells = {heading: [cell(row) for row in rows] for heading, cell in columns.items()}
    cells = {heading: column for heading, column in cells.items() if any(column)}
    table = Table(box=box.MARKDOWN, header_style="")
    for i, heading in enumerate(cells):
        table.add_column(heading or title, justify="right" if i else "left", no_wrap=True)
    for line in zip(*cells.values(), strict=True):
        table.add_row(*line)
    return table


def _number(key: str, form: str = "{:.3g}", scale: float = 1.0) -> Cell:
    def cell(row: dict[str, Any]) -> str:
        return "" if row.get(key) is None else form.format(scale * row[key])

    return cell


def seconds_text(seconds: float) -> str:
    """Three digits, thousands apart."""
    return f"{seconds:,.0f}" if seconds >= 100 else f"{seconds:.3g}"


def _seconds(row: dict[str, Any]) -> str:
    low, high = row["seconds_range"]
    about = "≈ " if row["extrapolated"] else ""
    spread = f" ± {50 * (high - low) / row['seconds']:.0f} %" if high > low else ""
    return f"{about}{seconds_text(row['seconds'])}{spread}"


def _met(row: dict[str, Any]) -> str:
    return {True: "yes", False: "**no**", None: ""}[row.get("met")]


def _list(key: str) -> Cell:
    return lambda row: ", ".join(f"{value:.3g}" if isinstance(value, float) else f"{value:,}" for value in row[key])


COLUMNS: dict[str, Cell] = {
    "": lambda row: row["method"],
    "seconds": _seconds,
    "plan s": _number("plan_seconds", "{:.2f}"),
    "exact / it": _number("ratio_to_exact", "{:,.3g}"),
    "frames / s": _number("frames_per_second", "{:.1f}"),
    "error": _number("relative_error", "{:.1e}"),
    "on noise": _number("noise_error", "{:.1e}"),
    "met": _met,
    "Δz mm": _number("depth_deviation_mm", "{:.2g}"),
    "whole voxels mm": _number("depth_deviation_voxel_mm", "{:.2g}"),
    "mask px": _number("mask_difference_px", "{:d}", 1),
    "GFLOP/s": _number("gflops", "{:.3g}"),
    "of ceiling": _number("share_of_gemm", "{:.0f} %", 100),
    "peak MB": _number("peak_memory_mb", "{:.0f}"),
    "of the whole": lambda row: f"{row['fraction']:.2g}" if row["extrapolated"] else "",
    "points": _number("points", "{:,d}", 1),
}
GROWTH: dict[str, Cell] = {
    "": lambda row: row["what"],
    "sizes": _list("sizes"),
    "seconds": _list("seconds"),
    "plan s": _list("plan_seconds"),
    "exponent": _number("exponent", "{:.2f}"),
}
BARS: dict[str, Cell] = {
    "": lambda row: row["bar"],
    "expected": lambda row: row["expected"],
    "measured": _number("measured"),
    "met": _met,
}
