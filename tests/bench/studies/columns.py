"""Tables of measurements: records of plain values, columns that define them, both as Markdown."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd

from handbench.bench.evaluation.tables import Column

Record = dict[str, Any]


@dataclass(frozen=True)
class Table:
    """Records with the columns that they are written by; by: a column whose values get a table
    each; shown: on the page, and not in the files alone; note: what stands below."""

    name: str
    columns: Sequence[Column]
    records: Sequence[Record]
    by: str = ""
    shown: bool = True
    note: str = ""

    @property
    def frame(self) -> pd.DataFrame:
        """The records by their columns, missing values NaN."""
        return pd.DataFrame(self.records, columns=[column.name for column in self.columns])

    def plain(self) -> list[Record]:
        """The records by their columns, as far as each has them, for JSON."""
        return [
            {c.name: record[c.name] for c in self.columns if c.name in record}
            for record in self.records
        ]

    def markdown(self) -> str:
        """The table for a page and for a terminal: columns that no record fills are left out."""
        groups = dict.fromkeys(record.get(self.by) for record in self.records)
        parts = [
            self._part([r for r in self.records if r.get(self.by) == group], str(group or ""))
            for group in groups
        ]
        return "\n".join([*parts, *([self.note] if self.note else [])])

    def _part(self, records: Sequence[Record], group: str) -> str:
        shown = {
            c: [c.cell(record.get(c.name)) for record in records] for c in self.columns if c.heading
        }
        shown = {
            column: cells
            for column, cells in shown.items()
            if column.name != self.by and any(cells)
        }
        headings = [column.heading for column in shown]
        headings[:1] = [group] if group else headings[:1]
        texts = [column.kind is str for column in shown]
        return markdown_table(dict(zip(headings, shown.values(), strict=True)), texts)


def markdown_table(columns: Mapping[str, Sequence[str]], texts: Sequence[bool]) -> str:
    """Columns of cells as Markdown, padded for a terminal; `texts` are aligned to the left, numbers
    to the right."""
    padded = []
    for (heading, cells), text in zip(columns.items(), texts, strict=True):
        width = max(map(len, (heading, "---", *cells)))
        rule = "-" * width if text else "-" * (width - 1) + ":"
        padded.append([f"{cell:{'<' if text else '>'}{width}}" for cell in (heading, rule, *cells)])
    return "".join("| " + " | ".join(line) + " |\n" for line in zip(*padded, strict=True))
