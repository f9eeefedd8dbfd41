"""Tables as pandas DataFrames, with declared columns, and their reading and writing as CSV.

The columns are declared in tables.toml. An unknown figure is NaN in a DataFrame and an empty cell
in a file. Text is never missing, but may be empty.
"""

from __future__ import annotations

import csv
import io
import math
import sys
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from handbench.support.errors import HandbenchError
from handbench.support.files import atomic_path, read_text
from handbench.support.limits import MOST_CELLS, MOST_COLUMNS, RESULT_BYTES

if TYPE_CHECKING:
    import pandas as pd

LEVEL = 0.95  # of every confidence interval
KINDS: dict[str, type] = {"text": str, "real": float, "whole": int, "flag": bool}
ByMethod = dict[str, "pd.DataFrame"]
DTYPES: dict[type, Any] = {str: "str", float: "float64", int: "int64", bool: "bool"}
EXPECTED = {float: "a finite number or nothing", int: "a whole number", bool: "0 or 1", str: "text"}


@dataclass(frozen=True)
class Column:
    """One column of a table: its name, type of values (kind) and meaning.
    unit: that of its numbers, if the same in every line. counts: numbers are written as whole ones
    in lines whose column `unit` has this value.
    """

    name: str
    kind: type
    meaning: str
    unit: str = ""
    counts: str = ""


@dataclass(frozen=True)
class Schema:
    """The declared columns of one table, in order."""

    columns: tuple[Column, ...]

    @property
    def names(self) -> list[str]:
        """The names of the columns, in order."""
        return [column.name for column in self.columns]


def _declared() -> dict[str, Schema]:
    """Read the columns of all tables from tables.toml: table → Schema."""
    known = tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8"))
    return {
        table: Schema(tuple(_column(*entry) for entry in columns.items()))
        for table, columns in known.items()
    }


def _column(name: str, facts: dict[str, Any]) -> Column:
    kind, meaning = next((kind, facts.pop(word)) for word, kind in KINDS.items() if word in facts)
    return Column(name, kind, meaning, **facts)


SCHEMAS = _declared()
TABLE, TASKS, SCORES, REPEATS = (SCHEMAS[name] for name in ("table", "tasks", "scores", "repeats"))
COMPARISONS = SCHEMAS["comparisons"]
EQUAL, MOTION = SCHEMAS["equal"], SCHEMAS["motion"]
DIFFERENCES, CHANGES = SCHEMAS["differences"], SCHEMAS["changes"]
RELIABILITY = SCHEMAS["reliability"]


def frame(
    schema: Schema, rows: Iterable[Mapping[str, Any]] | Iterable[Sequence[Any]] = ()
) -> pd.DataFrame:
    """Make a DataFrame with the columns and types of a schema.
    rows: one entry for each line, either column → value, or the values in the order of the columns.
    None: unknown."""
    import pandas as pd

    return conform(pd.DataFrame(list(rows), columns=schema.names), schema)


def conform(table: pd.DataFrame, schema: Schema) -> pd.DataFrame:
    """Return the table with the columns and types that its schema declares.
    Raises ValueError for unknown values, except in columns of real numbers, which hold NaN."""
    import pandas as pd

    typed = {}
    for column in schema.columns:
        values = table[column.name]
        if column.kind is not float and values.hasnans:
            raise ValueError(f"the column '{column.name}' has empty cells")
        typed[column.name] = (
            values if values.dtype == DTYPES[column.kind] else values.astype(DTYPES[column.kind])
        )
    return pd.DataFrame(typed, columns=schema.names).reset_index(drop=True)


def by_method(scores: pd.DataFrame, reference: str, treatment: str = "") -> ByMethod:
    """Arrange the scores against one reference: method → DataFrame with one line for each capture
    and one column for each metric.
    scores: the table of scores, with one line for each figure. treatment: an equal treatment (same
    smoothing for all methods), or "" for methods with their own settings. Only the first frame of
    each capture is used. Captures and metrics keep the order of the scores; NaN where there is no
    value."""
    lines = scores[
        (scores.reference == reference) & (scores.treatment == treatment) & (scores.frame == 0)
    ]
    captures, metrics = (list(dict.fromkeys(lines[column])) for column in ("capture", "metric"))
    return {
        str(method): of.pivot(index="capture", columns="metric", values="value").reindex(
            captures, columns=metrics
        )
        for method, of in lines.groupby("method", sort=False)
    }


def each(table: pd.DataFrame) -> Iterator[Any]:
    """Return an iterator over the lines of a table, each as a named tuple with the table's
    columns."""
    return iter(table.itertuples(index=False, name="Line"))


def records(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Return the lines of a table as dictionaries, column → value, with None for unknown values."""
    lines: list[Any] = table.astype(object).where(table.notna(), None).to_dict("records")
    return lines


def read(path: Path, schema: Schema) -> pd.DataFrame:
    """Read a table from a CSV file that handbench wrote.
    Raises HandbenchError for a file with other columns, and for a cell that is not of its column's
    type, naming the line."""
    import pandas as pd

    try:
        text = read_text(
            path, f"a CSV file with the columns {', '.join(schema.names)}", RESULT_BYTES
        )
        if (cells := sum(map(text.count, ",\n"))) > MOST_CELLS:
            raise ValueError(f"it has about {cells} cells, more than {MOST_CELLS}")
        if (wide := text.partition("\n")[0].count(",")) > MOST_COLUMNS:
            raise ValueError(f"its first line has about {wide} columns, more than {MOST_COLUMNS}")
        lines = csv.reader(io.StringIO(text))
        header = next(lines, [])
        if header != schema.names:
            raise ValueError(
                f"the columns are {', '.join(header)[:200]!r}; expected {', '.join(schema.names)}"
            )
        rows, number = list[list[Any]](), lines.line_num + 1
        for cells_of_line in lines:
            rows.append(_values(schema.columns, cells_of_line, number))
            number = lines.line_num + 1
        return conform(pd.DataFrame(rows, columns=header), schema)
    except (ValueError, csv.Error) as error:
        raise HandbenchError(
            f"{path}: {' '.join(str(error).split())}; run the benchmark again"
        ) from None


def write(path: Path, table: pd.DataFrame, schema: Schema) -> None:
    """Write a table to a CSV file with a header line, atomically. Values that are not finite become
    empty cells.
    Raises HandbenchError if the columns are not those of the schema."""
    if list(table.columns) != schema.names:
        raise HandbenchError(
            f"{path}: the table has the columns {list(table.columns)}; expected {schema.names}"
        )
    cells = conform(table, schema)
    for column in schema.columns:
        values = cells[column.name]
        if column.kind is bool:
            cells[column.name] = values.astype(int)
        elif column.kind is float:
            values = values.where(np.isfinite(values))
            whole = (
                values.notna() & (cells.unit == column.counts)
                if column.counts
                else values.isna() & False
            )
            cells[column.name] = values.astype(object).mask(
                whole, values[whole].astype(int).astype(object)
            )
    with atomic_path(path) as temporary:
        cells.to_csv(temporary, index=False, lineterminator="\n", encoding="utf-8")


def _values(columns: Sequence[Column], cells: Sequence[str], number: int) -> list[Any]:
    """Convert the text of a line's cells to the types of their columns. Raises ValueError for text
    of another type.
    number: number of the line in its file, for the message."""
    if len(cells) != len(columns):
        raise ValueError(f"line {number} has {len(cells)} columns; expected {len(columns)}")
    values = []
    for column, cell in zip(columns, cells, strict=True):
        try:
            values.append(sys.intern(cell) if column.kind is str else _value(column.kind, cell))
        except (ValueError, OverflowError):
            raise ValueError(
                f"in line {number}, '{column.name}' is {cell[:60]!r}; expected "
                f"{EXPECTED[column.kind]}"
            ) from None
    return values


def _value(kind: type, cell: str) -> Any:
    if kind is not float:
        return kind(np.int64(int(cell)))
    value = float(cell or "nan")
    if cell and not math.isfinite(value):
        raise ValueError
    return value
