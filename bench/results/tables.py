"""The tables of result folders: each one's columns, declared once, and their CSV files as pandas DataFrames.

A figure that is not known is NaN in a DataFrame and an empty cell in a file. Text is never missing: it may be empty.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from radar.support.errors import HandbenchError
from radar.support.files import atomic_path, require_file

LEVEL = 0.95  # of every confidence interval
DTYPES = {str: "str", float: "float64", int: "int64", bool: "bool"}
EXPECTED = {float: "a finite number or nothing", int: "a whole number", bool: "0 or 1", str: "text"}
OLDER = {str: "", int: 0, bool: False}  # what a column that an older file lacks is filled with


@dataclass(frozen=True)
class Column:
    """One column. unit: of its numbers, where it is the same in every line; optional: older files may lack it; counts:
    lines with this in their column `unit` hold whole numbers."""

    name: str
    kind: type
    meaning: str
    unit: str = ""
    optional: bool = False
    counts: str = ""


@dataclass(frozen=True)
class Schema:
    """The columns of one table, in order."""

    columns: tuple[Column, ...]

    @property
    def names(self) -> list[str]:
        """Their names."""
        return [column.name for column in self.columns]


TABLE = Schema(  # table.csv: one figure a line
    (
        Column("metric", str, "id of the metric"),
        Column("method", str, "id of the method"),
        Column("value", float, "the figure, in `unit`", counts="pixels"),
        Column("low", float, "lower end of its 95 % interval"),
        Column("high", float, "upper end"),
        Column("unit", str, "the metric's unit"),
        Column("paper", float, "the paper's figure"),
        Column("reference", str, "what it was scored against: photogrammetry or truth"),
    )
)
TASKS = Schema(  # tasks.csv: one stage of one capture a line
    (
        Column("task", str, "name of the task"),
        Column("capture", str, "the capture"),
        Column("method", str, "id of the method; empty for a stage of no method"),
        Column("stage", str, "the stage"),
        Column("seconds", float, "wall-clock time", "s"),
        Column("cpu_seconds", float, "time of all cores", "s"),
        Column("peak_memory_mb", float, "largest memory", "MB"),
        Column("cached", bool, "the time is an earlier run's"),
        Column("plan_seconds", float, "what the first image of a geometry took longer", "s", optional=True),
        Column("host", str, "the machine that did it", optional=True),
        Column("gemm_gflops", float, "that machine's rate of float32 matrix products", "GFLOP/s", optional=True),
    )
)
REPEATS = Schema(  # repeats.csv: one repeat of a precision capture a line
    (
        Column("capture", str, "the capture"),
        Column("method", str, "id of the method"),
        Column("repeat", int, "number of the repeat, from 0"),
        Column("z_m", float, "depth of the strongest scatterer", "m"),
    )
)
COMPARISONS = Schema(  # comparisons.csv: one pair of methods by one metric a line
    (
        Column("metric", str, "id of the metric"),
        Column("better", str, "id of the method with the better figure"),
        Column("worse", str, "id of the other"),
        Column("difference", float, "by how much `better` is better, in `unit`, ≥ 0"),
        Column("low", float, "lower end of its 95 % interval"),
        Column("high", float, "upper end"),
        Column("unit", str, "the metric's unit"),
        Column("p_corrected", float, "p of no difference, after Holm over all pairs of the metric; none: not testable"),
        Column("effect", float, "Cohen's dz: the difference over the standard deviation of the units' differences"),
        Column("reference", str, "what both were scored against"),
        Column("n_captures", int, "captures"),
        Column("n_blocks", int, "blocks of pixels"),
        Column("sentence", str, "the finding in words"),
    )
)
DIFFERENCES = Schema(  # compare.csv: a figure of A and of B by method, metric and reference
    (
        Column("method", str, "id of the method"),
        Column("title", str, "the method's title"),
        Column("metric", str, "id of the metric"),
        Column("metric_title", str, "as it is printed"),
        Column("unit", str, "the metric's unit"),
        Column("reference", str, "what both were scored against; empty for the precision"),
        Column("a", float, "A's figure"),
        Column("a_low", float, "lower end of its 95 % interval"),
        Column("a_high", float, "upper end"),
        Column("b", float, "B's figure"),
        Column("b_low", float, "lower end of its 95 % interval"),
        Column("b_high", float, "upper end"),
        Column("difference", float, "B − A"),
        Column("low", float, "lower end of its 95 % interval"),
        Column("high", float, "upper end"),
        Column("p_corrected", float, "p of no difference, after Holm over all lines; none: not testable"),
        Column("paired", bool, "both stand on the same captures"),
        Column("n_a", int, "captures of A"),
        Column("n_b", int, "captures of B"),
        Column("better", str, "A or B where a difference is shown at 5 % for all lines together"),
        Column("sentence", str, "the finding in words"),
    )
)
TIMES = Schema(  # in compare.json: each method's time per frame
    (
        Column("method", str, "id of the method"),
        Column("title", str, "the method's title"),
        Column("a", float, "A's median", "s"),
        Column("a_low", float, "lower end of its 95 % interval", "s"),
        Column("a_high", float, "upper end", "s"),
        Column("b", float, "B's median", "s"),
        Column("b_low", float, "lower end of its 95 % interval", "s"),
        Column("b_high", float, "upper end", "s"),
        Column("ratio", float, "B's over A's"),
        Column("sentence", str, "in words"),
    )
)
CHANGES = Schema(  # in compare.json: what two results do not share
    (
        Column("what", str, "configuration, settings, version, machine or input"),
        Column("key", str, "its name"),
        Column("a", str, "in A; empty: not there"),
        Column("b", str, "in B"),
    )
)
SETTINGS = Schema(  # tradeoff.csv: one setting of one section a line
    (
        Column("section", str, "the stage"),
        Column("name", str, "name of the setting"),
        Column("title", str, "as it is printed"),
        Column("knobs", str, "the setting, JSON"),
        Column("metric", str, "id of the metric"),
        Column("error", float, "its metric, in `unit`; smaller is better"),
        Column("low", float, "lower end of its 95 % interval"),
        Column("high", float, "upper end"),
        Column("unit", str, "the metric's unit"),
        Column("seconds", float, "median over the interleaved repeats", "s"),
        Column("seconds_low", float, "their smallest", "s"),
        Column("seconds_high", float, "their largest", "s"),
        Column("ratio", float, "seconds over those of the section's reference setting, of the same run"),
        Column("acquisition_s", float, "of a frame: tones × step time", "s"),
        Column("plan_s", float, "once a geometry", "s"),
        Column("imaging_s", float, "of a frame: the images", "s"),
        Column("extraction_s", float, "of a frame: depths from images", "s"),
        Column("operations", float, "complex multiplications and additions, by count"),
        Column("peak_memory_mb", float, "largest memory", "MB"),
        Column("on_front", bool, "no other setting dominates it"),
        Column("dominated_by", str, "a setting as fast, accurate and complete, and better in one; empty on the front"),
        Column("on_method_front", bool, "no setting of the same method dominates it", optional=True),
        Column("seen_percent", float, "share of the surface that it saw; none: all alike", "%", optional=True),
    )
)
CASES = Schema(  # stability.csv: one hard case a line
    (
        Column("case", str, "name of the case"),
        Column("group", str, "the part of the product"),
        Column("quantity", str, "what could blow up"),
        Column("reference", str, "what it is compared with"),
        Column("unit", str, "unit of bound and measured"),
        Column("bound", float, "the largest that holds"),
        Column("measured", float, "the worst of the sweep"),
        Column("verdict", str, "holds, refused (by an error in words), flagged (wrong, and marked as such) or fails"),
        Column("at", str, "where in the sweep the worst was seen"),
        Column("reason", str, "the bound's reason"),
        Column("seconds", float, "what the case took", "s"),
    )
)


def frame(schema: Schema, rows: Iterable[Mapping[str, Any]] | Iterable[Sequence[Any]] = ()) -> pd.DataFrame:
    """A table from its lines: mappings by column, or values in the order of the columns. None: not known."""
    return conform(pd.DataFrame(list(rows), columns=schema.names), schema)


def conform(table: pd.DataFrame, schema: Schema) -> pd.DataFrame:
    """The table with the columns and dtypes of its schema; what an optional column lacks is filled."""
    typed = {}
    for column in schema.columns:
        values = table[column.name].astype(object)
        if column.kind is not float and values.isna().any():
            if not column.optional:
                raise ValueError(f"'{column.name}' has lines without a value")
            values = values.mask(values.isna(), OLDER[column.kind])
        typed[column.name] = values.astype(DTYPES[column.kind])
    return pd.DataFrame(typed, columns=schema.names).reset_index(drop=True)


def records(table: pd.DataFrame) -> list[dict[str, Any]]:
    """The lines of a table as plain values; what is not known is None."""
    return table.astype(object).where(table.notna(), None).to_dict("records")


def read(path: Path, schema: Schema) -> pd.DataFrame:
    """Read a CSV file that `write` wrote. Other columns, and the first cell that is not of its kind, with its line, are
    a HandbenchError. An older file may lack the last columns, those that are optional."""
    path = require_file(path, f"a CSV file with the columns {', '.join(schema.names)}")
    options = {"header": None, "dtype": str, "keep_default_na": False, "skip_blank_lines": False, "encoding": "utf-8"}
    try:
        cells = pd.read_csv(path, engine="python", **options)  # which alone tells a short line from empty cells
        header, cells = cells.iloc[0].tolist(), cells[1:]
        required = sum(not column.optional for column in schema.columns)
        if len(header) < required or header != schema.names[: len(header)]:
            found = ", ".join(map(str, header))[:200]
            raise ValueError(f"the columns are {found!r}; expected {', '.join(schema.names)}")
        if (short := cells.isna().any(axis=1)).any():
            place = int(short.argmax())
            raise ValueError(f"line {_line(cells, place)}: has too few cells; expected {len(header)}")
        given = {c.name: _values(c, cells, i) for i, c in enumerate(schema.columns[: len(header)])}
        return conform(pd.DataFrame(given, columns=schema.names), schema)
    except (ValueError, LookupError) as error:  # LookupError: the first line is empty
        raise HandbenchError(f"{path}: {' '.join(str(error).split())}; run the benchmark again") from None


def write(path: Path, table: pd.DataFrame, schema: Schema) -> None:
    """Write a table with a header line, atomically; what is not finite becomes an empty cell."""
    if list(table.columns) != schema.names:
        raise HandbenchError(f"{path}: the table has the columns {list(table.columns)}; expected {schema.names}")
    cells = conform(table, schema)
    for column in schema.columns:
        values = cells[column.name]
        if column.kind is bool:
            cells[column.name] = values.astype(int)
        elif column.kind is float:
            values = values.where(np.isfinite(values))
            whole = values.notna() & (cells.unit == column.counts) if column.counts else values.isna() & False
            cells[column.name] = values.astype(object).mask(whole, values[whole].astype(int).astype(object))
    with atomic_path(path) as temporary:
        cells.to_csv(temporary, index=False, lineterminator="\n", encoding="utf-8")


def _values(column: Column, cells: pd.DataFrame, number: int) -> list[Any]:
    """The values of the cells in column `number`."""
    values = []
    for place, cell in enumerate(cells[number]):
        try:
            values.append(_value(column.kind, cell))
        except (ValueError, OverflowError):
            raise ValueError(
                f"line {_line(cells, place)}: '{column.name}' is {cell[:60]!r}; expected {EXPECTED[column.kind]}"
            ) from None
    return values


def _value(kind: type, cell: str) -> Any:
    if kind is str:
        return cell
    if kind is float:
        value = float(cell or "nan")
        if cell and not math.isfinite(value):
            raise ValueError
        return value
    return kind(np.int64(int(cell)))


def _line(cells: pd.DataFrame, place: int) -> int:
    """The file's line of the table's `place`-th: after the header, and after those that hold line breaks."""
    return 2 + place + sum(str(cell).count("\n") for cell in cells[:place].to_numpy().flat)
