"""The tables of a study: records of plain values, columns (columns.toml) that say what they hold, both as Markdown."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import pandas as pd

Record = dict[str, Any]
FORMS = {  # ways to write a value that are no format
    "seconds": lambda value: f"{value:,.0f}" if value >= 100 else f"{value:.3g}",
    "list": lambda values: ", ".join(f"{v:.3g}" if isinstance(v, float) else f"{v:,}" for v in values),
    "rounded list": lambda values: ", ".join(f"{v:.0f}" for v in values),
    "band": lambda ends: f"{ends[0]:.2f}–{ends[1]:.2f}",
    "yes or no": lambda value: "yes" if value else "**no**",
}


@dataclass(frozen=True)
class Column:
    """A column, whose name ends in its unit. text: its definition; heading: with the unit that a person reads (none: it
    stands in the files alone), scale: what the value is multiplied by for that, form: how it is written (or FORMS)."""

    text: str
    heading: str = ""
    form: str = "{:.3g}"
    scale: float = 1

    def cell(self, value: Any) -> str:
        """The value as a person reads it; nothing for None and NaN."""
        if value is None or value != value:  # NaN alone differs from itself
            return ""
        if self.form in FORMS:
            return FORMS[self.form](value)
        return value if isinstance(value, str) else self.form.format(self.scale * value)


@cache
def columns(name: str) -> dict[str, Column]:
    """The columns of a table of columns.toml, as engine.rows."""
    study, table = name.split(".")
    known = tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8"))
    return {key: Column(**about) for key, about in known[study][table].items()}


@dataclass(frozen=True)
class Table:
    """Records with the columns that they are written by; by: a column whose values get a table each; shown: on the
    page, and not in the files alone; note: what stands below."""

    name: str
    columns: Mapping[str, Column]
    records: Sequence[Record]
    by: str = ""
    shown: bool = True
    note: str = ""

    @property
    def frame(self) -> pd.DataFrame:
        """The records by their columns, missing values NaN."""
        return pd.DataFrame(self.records, columns=list(self.columns))

    def plain(self) -> list[Record]:
        """The records by their columns, as far as each has them, for JSON."""
        return [{key: record[key] for key in self.columns if key in record} for record in self.records]

    def markdown(self) -> str:
        """The table for a page and for a terminal: columns that no record fills are left out."""
        groups = dict.fromkeys(record.get(self.by) for record in self.records)
        parts = [self._part([r for r in self.records if r.get(self.by) == group], str(group or "")) for group in groups]
        return "\n".join([*parts, *([self.note] if self.note else [])])

    def _part(self, records: Sequence[Record], group: str) -> str:
        lines = {}
        for key, column in self.columns.items():
            cells = [column.cell(record.get(key)) for record in records]
            if column.heading and key != self.by and any(cells):
                text = any(isinstance(record.get(key), str) for record in records)
                lines[column.heading] = (text, cells)
        if group and lines:  # stands in place of the first heading
            lines = {group if i == 0 else heading: line for i, (heading, line) in enumerate(lines.items())}
        return markdown_table({heading: cells for heading, (_, cells) in lines.items()}, [t for t, _ in lines.values()])


def markdown_table(columns: Mapping[str, Sequence[str]], texts: Sequence[bool]) -> str:
    """Columns of cells as Markdown, padded for a terminal; `texts` are aligned to the left, numbers to the right."""
    padded = []
    for (heading, cells), text in zip(columns.items(), texts, strict=True):
        width = max(map(len, (heading, "---", *cells)))
        rule = "-" * width if text else "-" * (width - 1) + ":"
        padded.append([f"{cell:{'<' if text else '>'}{width}}" for cell in (heading, rule, *cells)])
    return "".join("| " + " | ".join(line) + " |\n" for line in zip(*padded, strict=True))
