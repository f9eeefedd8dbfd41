"""Framework of the studies: cases are measured one by one, and the records become tables and files.

A study's script has only a function that measures one case, and the columns of its records.
`measured` does the rest: command line, progress, failures of single cases, and three files, named
after the study:

    NAME.csv   the first table, with unrounded values
    NAME.json  command, seed, minutes, load, machine, versions, definitions, all tables, failures
    NAME.md    the tables that the terminal shows, for a page
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
from handbench.support.files import atomic_path, write_json, write_text
from handbench.support.progress import say, track
from handbench.support.store import versions

Record = dict[str, Any]


@dataclass(frozen=True)
class Table:
    """Records that are written and printed as one table.

    columns: definitions of the columns. by: name of a column; a separate table is printed for each
    of its values. shown: False if the table is only written to the files. note: text below the
    table.
    """

    name: str
    columns: Sequence[Column]
    records: Sequence[Record]
    by: str = ""
    shown: bool = True
    note: str = ""

    @property
    def frame(self) -> pd.DataFrame:
        """The records as a DataFrame with the declared columns; missing values are NaN."""
        return pd.DataFrame(self.records, columns=[column.name for column in self.columns])

    def markdown(self) -> str:
        """Return the table as Markdown text, without columns that are empty in all records."""
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
    """A study: cases that are measured one after another, and the tables made of the results.

    name: of its files. measure: function of a case that returns one record (values by column) or
    several. tables: function of all records that returns the tables; the first one becomes the CSV
    file. label: function of a case that returns its name. seed: recorded in the files.
    """

    name: str
    cases: Sequence[Any]
    measure: Callable[[Any], Record | list[Record]]
    tables: Callable[[list[Record]], list[Table]]
    label: Callable[[Any], str] = str
    seed: int | None = None


def parser(module: str, purpose: str) -> argparse.ArgumentParser:
    """Return the parser of the command line of a study's script. module: name of the script below
    `bench.studies`; purpose: shown in its help."""
    return argparse.ArgumentParser(prog=f"python -m {__package__}.{module}", description=purpose)


def measured(parser: argparse.ArgumentParser, study: Callable[..., Study], name: str) -> None:
    """Run a study's script: parse the command line, measure the cases, write the files and print
    the tables.

    parser: with the script's own options, which are passed to `study` after its work folder. name:
    of the default folder for the files, runs/NAME (option -o). A known error or failed cases end
    the program with a one-line message and exit code 2.
    """
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
            print(markdown(tables))
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

    out: a folder, or the path of the JSON file, next to which the CSV file is written. command:
    recorded in the files. A failed case is printed, and the others are still measured.

    Returns the tables, and the error messages of failed cases by label. Raises HandbenchError if no
    case is selected, or if all fail.
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
    """Write the first table as a CSV file, all tables as a JSON file, with the facts of the run and
    the definitions of the columns, and as Markdown, to be read. out: a folder, in which the files
    get the study's name, or the path of the JSON file."""
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
    write_text(stem.with_suffix(".md"), markdown(tables))


def markdown(tables: Sequence[Table]) -> str:
    """Return the tables that are shown and have records as Markdown text."""
    return "\n".join(table.markdown() for table in tables if table.shown and table.records)


def relative_error(found: np.ndarray, exact: np.ndarray) -> float:
    """Compute the relative L2 error of an array: the norm of found − exact, divided by that of
    exact."""
    return float(np.linalg.norm(found.astype(np.complex128) - exact) / np.linalg.norm(exact))
