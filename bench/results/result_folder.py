"""A result folder as one object (`Result`): reading and checking it, and writing its tables and
result.json."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any
from warnings import catch_warnings

import numpy as np
from pydantic import TypeAdapter

from handbench.bench.evaluation.depth_errors import ErrorMap
from handbench.bench.evaluation.intervals import counted
from handbench.bench.evaluation.scoring_protocols import main_table, protocol
from handbench.bench.evaluation.tables import LEVEL, SCORES, TABLE, TASKS, each, read, write
from handbench.bench.results import derived
from handbench.bench.results.about import About, CaptureFacts, metric_facts, read_about
from handbench.bench.results.maps import (
    Frames,
    SurfaceMap,
    depth_path,
    errors_path,
    photo_path,
    read_errors,
    read_frames,
    read_map,
)
from handbench.support.errors import HandbenchError
from handbench.support.files import MOST_CELLS, TOML_BYTES, atomic_path, read_bytes, require_folder

if TYPE_CHECKING:
    import pandas as pd

TABLES = {"table": TABLE, "tasks": TASKS, "scores": SCORES}  # the files NAME.csv
BUSY = 0.25  # cores that other work may take before times are called disturbed


@dataclass(frozen=True, eq=False)
class Result:
    """A complete result folder that has been read. Its maps and photographs are read when they are
    asked for.

    about: content of result.json. table: the main table; tasks: one line for each stage of the run;
    scores: one line for each figure of a capture. config: text of config.toml. The properties
    repeats, comparisons, equal, motion and reliability are tables computed from these.
    `bench.evaluation.tables` declares the columns of all tables.
    """

    folder: Path
    about: About
    table: pd.DataFrame
    tasks: pd.DataFrame
    scores: pd.DataFrame
    config: str

    def __repr__(self) -> str:
        methods = ", ".join(method.name for method in self.about.methods)
        return (
            f"<handbench.Result {self.about.name}: {counted(len(self.about.captures))}; {methods}>"
        )

    @cached_property
    def repeats(self) -> pd.DataFrame:
        """The depth of the strongest scatterer in every repeated frame: capture, method, repeat,
        z_m."""
        return derived.repeats(self.scores)

    @cached_property
    def equal(self) -> pd.DataFrame:
        """The figures of all methods under equal treatment (`derived.equal`)."""
        return derived.equal(self.scores, self.scored())

    @cached_property
    def comparisons(self) -> pd.DataFrame:
        """The tests between all pairs of methods (COMPARISONS)."""
        return derived.comparisons(
            self.scores, self.scored(), self.about.protocol, self.about.method_titles
        )

    @cached_property
    def motion(self) -> pd.DataFrame:
        """The figures of all methods on captures with a known velocity (`derived.motion`)."""
        return derived.motion(self.scores)

    @cached_property
    def reliability(self) -> pd.DataFrame:
        """How often the intervals of σ contain the errors (`derived.reliability`)."""
        return derived.reliability(self)

    def row(self, metric: str, method: str, reference: str) -> Any:
        """Return the line of the main table for a metric, a method and a reference, as a named
        tuple of the columns; None if there is no such line."""
        found = self.table[(self.table.method == method) & (self.table.metric == metric)]
        return next(each(found[found.reference == reference]), None)

    def time(self, method: str) -> Any:
        """Return the line of the main table with a method's time per frame, as a named tuple; None
        if unknown. It is the same for every reference."""
        found = self.table[(self.table.method == method) & (self.table.metric == "seconds")]
        return next(each(found[found.value.notna()]), None)

    def title(self, metric: str) -> str:
        """Return the title of a metric for readers; the name `metric` itself if the result does not
        define it."""
        facts = self.about.metrics.get(metric)
        return facts.title if facts else metric

    def compared(self, metric: str, reference: str, treatment: str = "") -> pd.DataFrame:
        """Return the lines of the table of comparisons for one metric, against one reference.
        treatment: an equal treatment (same smoothing for all methods), or "" for methods with their
        own settings."""
        of = self.comparisons
        return of[(of.metric == metric) & (of.reference == reference) & (of.treatment == treatment)]

    def scored(self) -> tuple[CaptureFacts, ...]:
        """Return the captures whose depths are compared with a reference, pixel by pixel."""
        return tuple(c for c in self.about.captures if "accuracy" in c.measures)

    def repeated(self) -> tuple[CaptureFacts, ...]:
        """Return the captures that measure the precision."""
        return tuple(c for c in self.about.captures if "precision" in c.measures)

    def errors(self, capture: str, method: str, reference: str) -> ErrorMap:
        """Read the signed errors of a method's depth map of one capture against one reference."""
        return read_errors(self.folder, capture, method, reference)

    def surface(self, capture: str, source: str) -> SurfaceMap:
        """Read a depth map of one capture.
        source: a method, or a reference such as "truth" or "photogrammetry"."""
        return SurfaceMap(**read_map(depth_path(self.folder, capture, source), "z_m"))

    def frames(self, capture: str, method: str) -> Frames | None:
        """Read the depths and velocities of all frames of a capture by one method; None if the
        capture has a single frame, or the method no velocities."""
        return read_frames(self.folder, capture, method)

    def busy(self) -> bool:
        """Tell whether other work on the machine disturbed the times of a method: whether it took
        0.25 cores (BUSY) or more in the mean."""
        tasks = self.tasks[(self.tasks.method != "") & self.tasks.others_cores.notna()]
        sums = tasks.assign(taken_s=tasks.others_cores * tasks.seconds).groupby("method")
        return bool((sums.taken_s.sum() / sums.seconds.sum() >= BUSY).any())

    def photo(self, capture: str) -> Path | None:
        """Return the path of the capture's photograph; None if it has none."""
        path = photo_path(self.folder, capture)
        return path if path.is_file() else None


def shown(comparisons: pd.DataFrame) -> pd.Series:
    """Return a flag for each line of comparisons: whether the difference is significant at 5 %,
    with its p-value corrected for all pairs of methods."""
    return comparisons.p_corrected < 1 - LEVEL


def best(comparisons: pd.DataFrame) -> list[str]:
    """Return the method with the best figure and all methods that are not significantly worse.
    comparisons: lines of the table COMPARISONS by one metric (`Result.compared`). Methods are in
    order of appearance. Empty if nothing was tested, so that no figure is highlighted."""
    lines = comparisons[comparisons.p_corrected.notna()]
    ahead = ~lines.better.isin(lines.worse)
    worse = set(lines.worse[ahead & shown(lines)])
    names = dict.fromkeys(lines[["better", "worse"]].to_numpy().flat)
    return [name for name in names if name not in worse]


def write_about(folder: Path, about: About) -> None:
    """Write result.json. It must be written last, because it marks the folder as complete. Values
    that are not finite become null."""
    with atomic_path(folder / "result.json") as temporary, temporary.open("wb") as file:
        # text would take thrice as much memory
        file.writelines((TypeAdapter(About).dump_json(about, indent=2), b"\n"))


def write_tables(folder: Path, **tables: pd.DataFrame) -> None:
    """Write tables of a result, given by their names in `TABLES`, as NAME.csv."""
    for name, table in tables.items():
        write(folder / f"{name}.csv", table, TABLES[name])


def load(folder: str | Path) -> Result:
    """Read and check a result folder. Raises HandbenchError if it is missing or incomplete."""
    folder = require_folder(folder, "a benchmark's result (result.json)")
    about = read_about(folder / "result.json")
    config = read_bytes(folder / "config.toml", "the resolved configuration", TOML_BYTES).decode(
        "utf-8", "replace"
    )
    tables = {name: read(folder / f"{name}.csv", schema) for name, schema in TABLES.items()}
    _require_figures(folder / "scores.csv", tables["scores"])
    result = Result(folder, about, **tables, config=config)
    _require_agreement(result)
    _require_complete(result)
    return result


def _require_agreement(result: Result) -> None:
    """Raise a HandbenchError unless result.json, scores.csv and table.csv have the same methods,
    metrics and captures, the figures of the table, where their metrics are defined as today, follow
    from the scores, and config.toml has its end."""
    about, table = result.about, result.table
    methods, captures = set(about.method_titles), {capture.name for capture in about.captures}
    scores = result.scores[result.scores.method.isin(methods)]
    agree = set(table.method) == methods and set(table.metric) <= set(about.metrics)
    if agree and set(scores.capture) <= captures and result.config.endswith("\n"):
        today = [key for key, facts in metric_facts().items() if about.metrics.get(key) == facts]
        of = protocol(str(about.protocol.get("id")))
        # figures of some captures are missing
        with suppress(ValueError, LookupError), catch_warnings(action="ignore"):
            ours, theirs = (
                lines[lines.metric.isin(today)].set_index(["metric", "method", "reference"]).value
                for lines in (table, main_table(scores, of, 0, False))
            )
            if ours.shape == theirs.shape and np.allclose(ours, theirs[ours.index], equal_nan=True):
                return
    raise HandbenchError(
        f"{result.folder}: config.toml is cut, or scores.csv, table.csv and result.json have other "
        "captures, methods, metrics or figures than each other; run the benchmark again"
    )


def _require_figures(path: Path, scores: pd.DataFrame) -> None:
    """Raise a HandbenchError if the scores have two lines for one figure, or so many captures,
    methods and metrics that arranging them by method would fill the memory."""
    if scores.duplicated(list(SCORES)[:-1]).any():
        raise HandbenchError(f"{path}: has two lines for the same figure; run the benchmark again")
    captures, methods, metrics = (
        scores[column].nunique() for column in ("capture", "method", "metric")
    )
    if captures * methods * metrics > MOST_CELLS:
        raise HandbenchError(
            f"{path}: has {captures} captures, {methods} methods and {metrics} metrics, which "
            f"make more than {MOST_CELLS} figures; run the benchmark again"
        )


def map_files(result: Result) -> dict[Path, str]:
    """Return the files of the depth maps and error maps of a result, each with the name of an array
    that it must have."""
    methods, files = result.about.method_titles, dict[Path, str]()
    for capture in result.scored():
        for source in (*capture.references, *methods):
            files[depth_path(result.folder, capture.name, source)] = "z_m"
        for pair in product(methods, capture.references):
            files[errors_path(result.folder, capture.name, *pair)] = "error_m"
    return files


def _require_complete(result: Result) -> None:
    paths = map_files(result)
    missing = [path for path in paths if not path.is_file()]
    if missing:
        raise HandbenchError(
            f"{missing[0]}: is missing (with {len(missing)} of {len(paths)} maps), so the result "
            "is not complete; run the benchmark again, which continues it"
        )
