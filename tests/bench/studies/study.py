"""One study: cases → measure(case) → tables, a figure and a page, with what they stand on.

A study's folder holds what is its own: cases.py (data) and measure.py (a function of one case, the
columns of what it returns, the figure). `run` does the rest: progress, the failures of single
cases, and the files.

STEM.csv         the first table, values as they are
STEM.json        study, command, seed, minutes, load, machine, versions, definitions of columns, every table, failures
STEM.md          the page: the tables as a person reads them, failures, and what the figures stand on
STEM.png, .pdf   the figure, where there is one
"""

import os
import time
import traceback
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from handbench.radar.imaging.device import describe
from handbench.radar.warmup import compile_kernels
from handbench.support.cost import calibrated_machine
from handbench.support.errors import HandbenchError
from handbench.support.files import atomic_path, write_json, write_text
from handbench.support.progress import say, track
from handbench.support.store import versions
from tests.bench.studies.columns import Record, Table

STYLE = {
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.linewidth": 0.6,
    "savefig.dpi": 160,
    "pdf.fonttype": 42,
}
BLUE, VERMILION, GREEN, ORANGE = (
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#E69F00",
)  # of Okabe and Ito's palette
GREY = "0.35"


@dataclass(frozen=True)
class Study:
    """A study. name: of its files; measure: a case's record or records; tables: of all records, the
    first one for the CSV file; figure: of the tables by name; label: a case in words."""

    name: str
    title: str
    cases: Sequence[Any]
    measure: Callable[[Any], Record | list[Record]]
    tables: Callable[[list[Record]], list[Table]]
    figure: Callable[[dict[str, pd.DataFrame]], Figure | None] = lambda frames: None
    label: Callable[[Any], str] = str
    seed: int | None = None
    text: str = ""


@dataclass(frozen=True)
class Found:
    """The outcome of a study. facts: see `stand`; failures: message by case."""

    study: Study
    tables: list[Table]
    facts: dict[str, Any]
    failures: dict[str, str] = field(default_factory=dict)

    @property
    def frames(self) -> dict[str, pd.DataFrame]:
        """The tables by name."""
        return {table.name: table.frame for table in self.tables}

    def markdown(self) -> str:
        """The tables that are shown, and the failures."""
        parts = [table.markdown() for table in self.tables if table.shown and len(table.records)]
        return "\n".join(
            [*parts, *(f"- {case} failed: {message}\n" for case, message in self.failures.items())]
        )


def run(study: Study, out: Path, command: str = "", only: str = "") -> Found:
    """Measure the cases whose label holds `only`, and write the files: `out` is a folder, or the
    JSON file that the others stand beside. Raises HandbenchError where every case fails."""
    start, load = time.perf_counter(), {"before": os.getloadavg()}
    compile_kernels()
    cases = [case for case in study.cases if only in study.label(case)]
    if not cases:
        known = ", ".join(map(study.label, study.cases))
        raise HandbenchError(f"--only: no case of '{study.name}' holds '{only}'; there are {known}")
    measured, failures = carried_out(cases, study.measure, study.label, study.name)
    if not measured:
        raise HandbenchError(f"every case failed; the first: {next(iter(failures.values()))}")
    found = [
        record
        for _, given in measured
        for record in (given if isinstance(given, list) else [given])
    ]
    facts = {"study": study.name, "command": command, "seed": study.seed, **stand()}
    facts |= {
        "minutes": (time.perf_counter() - start) / 60,
        "load": {**load, "after": os.getloadavg()},
    }
    result = Found(study, study.tables(found), facts, failures)
    write(result, out)
    return result


def carried_out(
    cases: Iterable[Any], measure: Callable[[Any], Any], label: Callable[[Any], str], title: str
) -> tuple[list[tuple[Any, Any]], dict[str, str]]:
    """Measure every case.

    Returns (case, result) of those that succeed, and label → message of those that fail. A failure
    is printed, with the traceback of an unknown error, and the other cases go on.
    """
    measured = []
    failures = {}
    for case in track(list(cases), title):
        try:
            measured.append((case, measure(case)))
        except HandbenchError as error:
            failures[label(case)] = str(error)
            say(f"{title}: {label(case)} failed: {error}")
        except Exception as error:
            failures[label(case)] = f"{type(error).__name__}: {error}"
            say(traceback.format_exc())
    return measured, failures


def stand() -> dict[str, Any]:
    """Facts of the machine, its rate of float32 matrix products and its imaging device, and
    versions of libraries."""
    return {
        "machine": {**calibrated_machine(), "imaging_device": describe()},
        "versions": versions(),
    }


def relative_error(found: np.ndarray, exact: np.ndarray) -> float:
    """L2 of the difference over that of the exact values."""
    return float(np.linalg.norm(found.astype(np.complex128) - exact) / np.linalg.norm(exact))


def write(found: Found, out: Path) -> Path:
    """Write the files; returns the page's path."""
    import matplotlib

    stem = out.with_suffix("") if out.suffix == ".json" else out / found.study.name
    first = found.tables[0]
    with atomic_path(stem.with_suffix(".csv")) as temporary:
        first.frame.to_csv(temporary, index=False, lineterminator="\n")
    with matplotlib.rc_context(STYLE):
        figure = found.study.figure(found.frames)
        for suffix, metadata in ((".png", {}), (".pdf", {"CreationDate": None})):
            if figure is not None:
                with atomic_path(stem.with_suffix(suffix)) as temporary:
                    figure.savefig(temporary, metadata=metadata)
    content = {table.name: table.plain() for table in found.tables}
    definitions = {
        column.name: column.meaning for table in found.tables for column in table.columns
    }
    write_json(
        stem.with_suffix(".json"),
        {**found.facts, "definitions": definitions, **content, "failures": found.failures},
    )
    write_text(stem.with_suffix(".md"), page(found, f"{stem.name}.png" if figure else ""))
    return stem.with_suffix(".md")


def page(found: Found, picture: str = "") -> str:
    """The page: what was measured, tables, figure, and what it stands on."""
    study, facts, machine = found.study, found.facts, found.facts["machine"]
    stood = {
        "command": f"`{facts['command']}`" if facts["command"] else None,
        "seed": facts["seed"],
        "time": f"{facts['minutes']:.1f} minutes; load average {facts['load']['before'][0]:.1f} "
        "before",
        "machine": f"{machine['processor']}, {machine['cores']} cores, {machine['memory_gb']:g} GB",
        "system": f"{machine['system']}, Python {machine['python']}",
        "float32 matrix product": f"{machine['gemm_gflops']:g} GFLOP/s",
        "imaging device": machine["imaging_device"],
        "versions": ", ".join(f"{name} {version}" for name, version in facts["versions"].items()),
    }
    lines = "".join(f"- {name}: {value}\n" for name, value in stood.items() if value is not None)
    defined = {
        c.heading: c.meaning for t in found.tables if t.shown for c in t.columns if c.heading
    }
    columns = "".join(f"- *{heading}*: {text}\n" for heading, text in defined.items())
    shown = [f"![{study.title}]({picture})\n"] if picture else []
    parts = [
        f"# {study.title}\n",
        *([study.text + "\n"] if study.text else []),
        found.markdown(),
        *shown,
    ]
    return "\n".join(
        [*parts, *([f"## Columns\n\n{columns}"] if columns else []), f"## Stands on\n\n{lines}"]
    )
