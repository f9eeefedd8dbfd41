"""The lines of a result's CSV files."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from dataclasses import MISSING, astuple, dataclass, fields
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from radar.support.errors import HandbenchError
from radar.support.files import atomic_path, require_file

LEVEL = 0.95

Record = TypeVar("Record")


@dataclass(frozen=True)
class Row:
    """One line of table.csv: a figure, its 95 % interval and the paper's figure; None: there is none."""

    metric: str
    method: str
    value: float | None
    low: float | None
    high: float | None
    unit: str
    paper: float | None
    reference: str


@dataclass(frozen=True)
class Task:
    """One line of tasks.csv. method: empty for a stage of no method; cached: the time is an earlier run's;
    plan_seconds: what the first image of a geometry took longer; host, gemm_gflops: where it ran, and that machine's
    rate of float32 matrix products."""

    task: str
    capture: str
    method: str
    stage: str
    seconds: float | None
    cpu_seconds: float | None
    peak_memory_mb: float | None
    cached: bool
    plan_seconds: float | None = None
    host: str = ""
    gemm_gflops: float | None = None


@dataclass(frozen=True)
class Repeat:
    """One line of repeats.csv: depth of the strongest scatterer in one repeat."""

    capture: str
    method: str
    repeat: int
    z_m: float | None


def write_csv(path: Path, record: type[Record], records: Iterable[Record]) -> None:
    """Write `records` with a header line, atomically; None and NaN become an empty cell."""
    with atomic_path(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(field.name for field in fields(record))
        writer.writerows(map(_cells, records))


def _cells(record: Record) -> list[str]:
    return [_cell(value) for value in astuple(record)]


def _cell(value: Any) -> str:
    if value is None or (isinstance(value, float) and not np.isfinite(value)):
        return ""
    return str(int(value)) if isinstance(value, bool) else str(value)


def read_csv(path: Path, record: type[Record]) -> tuple[Record, ...]:
    """Read the lines of a CSV file that `write_csv` wrote; anything else is a HandbenchError. An older file may lack
    the last columns, those that have defaults."""
    names = [field.name for field in fields(record)]
    required = sum(field.default is MISSING for field in fields(record))
    path = require_file(path, f"a CSV file with the columns {', '.join(names)}")
    try:
        with path.open(newline="", encoding="utf-8") as stream:
            header, *lines = list(csv.reader(stream)) or [[]]
        if len(header) < required or header != names[: len(header)]:
            raise ValueError(f"the columns are {', '.join(header)[:200]!r}; expected {', '.join(names)}")
        return tuple(_record(record, len(header), cells) for cells in lines)
    except (ValueError, csv.Error) as error:
        raise HandbenchError(f"{path}: {error}; run the benchmark again") from None


def _record(record: type[Record], columns: int, cells: list[str]) -> Record:
    return record(*(_value(field, cell) for field, cell in zip(fields(record)[:columns], cells, strict=True)))


def _value(field: Any, cell: str) -> Any:
    convert = {"str": str, "int": int, "bool": lambda text: bool(int(text))}.get(field.type, float)
    if convert is float and cell == "":
        return None
    value = convert(cell)
    if convert is float and not np.isfinite(value):
        raise ValueError(f"'{field.name}' is {cell}; expected a finite number or nothing")
    return value


@dataclass(frozen=True)
class Comparison:
    """One line of comparisons.csv: by how much `better` is better than `worse` in a metric, in its unit (≥ 0), with its
    95 % interval; p_corrected after Holm over all pairs of the metric; effect: Cohen's dz, the difference over the
    standard deviation of the paired differences between units (captures from five on, else blocks). None: two units
    that could tell are missing, or (effect) all units agree."""

    metric: str
    better: str
    worse: str
    difference: float | None
    low: float | None
    high: float | None
    unit: str
    p_corrected: float | None
    effect: float | None
    reference: str
    n_captures: int
    n_blocks: int
    sentence: str

    @property
    def shown(self) -> bool:
        """Whether there is a difference, at 5 % for all pairs of the metric together."""
        return self.p_corrected is not None and self.p_corrected < 1 - LEVEL


def best(comparisons: Iterable[Comparison], metric: str, reference: str) -> tuple[str, ...]:
    """The method with the best figure and all that are not shown to be worse, in order of appearance; () where nothing
    was compared: without a test no figure stands out."""
    lines = [c for c in comparisons if (c.metric, c.reference) == (metric, reference)]
    methods = tuple(dict.fromkeys(name for c in lines for name in (c.better, c.worse)))
    beaten = {c.worse for c in lines}
    worse = {c.worse for c in lines if c.better not in beaten and c.shown}
    return tuple(method for method in methods if method not in worse)
