"""One study: cases → measure(case) → tables, with what they stand on.

A study's script has what is its own: a function of one case, and the columns of what it returns.
`measured` does the rest: options, progress, the failures of single cases, and the files.

STEM.csv   the first table, values as they are
STEM.json  command, seed, minutes, load, machine, versions, definitions, every table, failures
"""

from __future__ import annotations

import argparse
import os
import shlex
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from handbench.bench.evaluation.tables import Column
from handbench.radar.imaging.device import describe, use_device
from handbench.radar.warmup import compile_kernels
from handbench.support.cost import calibrated_machine
from handbench.support.errors import HandbenchError
from handbench.support.files import atomic_path, write_json
from handbench.support.progress import say, track
from handbench.support.store import versions

Record = dict[str, Any]


@dataclass(frozen=True)
class Table:
    """Records to be written as one table, with their columns.
    by: a column; the terminal shows one table for each of its values. shown: False: only in the
    files, not in the terminal. note: text below the table."""

    name: str
    columns: Sequence[Column]
    records: Sequence[Record]
    by: str = ""
    shown: bool = True
    note: str = ""

    @property
    def frame(self) -> pd.DataFrame:
        """The records as a DataFrame, one column for each declared one; missing values are NaN."""
        return pd.DataFrame(self.records, columns=[column.name for column in self.columns])

    def markdown(self) -> str:
        """Return the table as Markdown text, without the columns that no record fills."""
        groups = dict.fromkeys(record.get(self.by) for record in self.records)
        parts = [self._part([r for r in self.records if r.get(self.by) == g], g) for g in groups]
        return "\n".join([*parts, *filter(None, [self.note])])

    def _part(self, records: Sequence[Record], group: str | None) -> str:
        shown: list[list[str]] = []
        for column in self.columns:
            cells = [column.cell(record.get(column.name)) for record in records]
            if not column.heading or column.name == self.by or not any(cells):
                continue
            heading = column.heading if shown or not group else str(group)
            width, side = (
                max(map(len, (heading, "---", *cells))),
                "<" if column.kind is str else ">",
            )
            rule = "-" * width if side == "<" else "-" * (width - 1) + ":"
            shown.append([f"{cell:{side}{width}}" for cell in (heading, rule, *cells)])
        return "".join("| " + " | ".join(line) + " |\n" for line in zip(*shown, strict=True))


@dataclass(frozen=True)
class Study:
    """A study: cases that are measured one after the other, and the tables that the results make.
    name: of its files. measure: case → record (values by column) or records. tables: all records →
    tables, the first of which becomes the CSV file. label: case → its name in words."""

    name: str
    cases: Sequence[Any]
    measure: Callable[[Any], Record | list[Record]]
    tables: Callable[[list[Record]], list[Table]]
    label: Callable[[Any], str] = str
    seed: int | None = None


def parser(module: str, purpose: str) -> argparse.ArgumentParser:
    """Return the parser of a study's command line. module: the script's name below
    `bench.studies`."""
    return argparse.ArgumentParser(prog=f"python -m {__package__}.{module}", description=purpose)


def measured(parser: argparse.ArgumentParser, study: Callable[..., Study], name: str) -> None:
    """Run a study's script: parse the command line, measure, write the files, print the tables.
    parser: with the script's own options, which are passed to `study` after the folder for its
    work. Files go to the folder of -o (default runs/NAME). A known error, and failed cases, end the
    program with one line and exit code 2."""
    default = Path("runs") / name
    parser.add_argument("-o", "--out", type=Path, default=default, help=f"default {default}")
    holding = "the cases whose name holds TEXT"
    parser.add_argument("--only", default="", metavar="TEXT", help=holding)
    given = vars(parser.parse_args())
    out, only = given.pop("out"), given.pop("only")
    try:
        with use_device(given.get("device")):
            made = study((out.parent if out.suffix == ".json" else out) / "work", **given)
            command = f"{parser.prog} {shlex.join(sys.argv[1:])}".strip()
            tables, failures = run(made, out, command, only)
            for table in tables:
                if table.shown and table.records:
                    print(table.markdown())
        if failures:
            raise HandbenchError(
                f"{len(failures)} of {len(made.cases)} cases failed; the reasons are above and "
                "under 'failures' in the .json file"
            )
    except HandbenchError as error:
        parser.exit(2, f"{parser.prog}: {error}\n")


def run(
    study: Study, out: Path, command: str = "", only: str = ""
) -> tuple[list[Table], dict[str, str]]:
    """Measure the cases whose label contains `only`, and write the study's files.
    out: a folder, or the path of the JSON file, beside which the CSV file then stands. command:
    recorded in the files. A case that fails is printed, and the others go on.

    Returns the tables, and label → message of the failed cases. Raises HandbenchError if no case is
    chosen or every case fails.
    """
    start, load = time.perf_counter(), os.getloadavg()
    compile_kernels()
    cases = [case for case in study.cases if only in study.label(case)]
    if not cases:
        labels = ", ".join(map(study.label, study.cases))
        raise HandbenchError(
            f"--only: no case of '{study.name}' has '{only}' in its name; the cases are: {labels}"
        )
    records: list[Record] = []
    failures = {}
    for case in track(cases, study.name):
        try:
            found = study.measure(case)
            records += found if isinstance(found, list) else [found]
        except Exception as error:
            known = isinstance(error, HandbenchError)
            failures[study.label(case)] = str(error) if known else traceback.format_exc()
            say(f"{study.label(case)} failed: {failures[study.label(case)]}")
    if len(failures) == len(cases):
        raise HandbenchError(
            f"every case failed; the error of the first: {next(iter(failures.values()))}"
        )
    tables = study.tables(records)
    facts = {
        "study": study.name,
        "command": command,
        "seed": study.seed,
        "minutes": (time.perf_counter() - start) / 60,
        "load": {"before": load, "after": os.getloadavg()},
        "machine": {**calibrated_machine(), "imaging_device": describe()},
        "versions": versions(),
    }
    write(study, tables, {**facts, "failures": failures}, out)
    return tables, failures


def write(study: Study, tables: list[Table], facts: Record, out: Path) -> None:
    """Write STEM.csv, the first table, and STEM.json: facts, the columns' meanings, and all
    tables."""
    stem = out.with_suffix("") if out.suffix == ".json" else out / study.name
    with atomic_path(stem.with_suffix(".csv")) as temporary:
        tables[0].frame.to_csv(temporary, index=False, lineterminator="\n")
    definitions = {c.name: c.meaning for table in tables for c in table.columns}
    content = {
        table.name: [
            {c.name: record[c.name] for c in table.columns if c.name in record}
            for record in table.records
        ]
        for table in tables
    }
    write_json(stem.with_suffix(".json"), {**facts, "definitions": definitions, **content})


def relative_error(found: np.ndarray, exact: np.ndarray) -> float:
    """Compute the relative L2 error: the norm of found − exact, divided by the norm of exact."""
    return float(np.linalg.norm(found.astype(np.complex128) - exact) / np.linalg.norm(exact))
