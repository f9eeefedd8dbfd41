"""The result folder as a whole: written by the runner, read by the reports."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import TypeAdapter

from handbench.bench.results.about import About, CaptureFacts, read_facts
from handbench.bench.results.error_map import ErrorMap
from handbench.bench.results.maps import Surface, depth_path, errors_path, photo_path, read_map
from handbench.bench.results.tables import LEVEL, SCHEMAS, each, frame, read, write
from handbench.support.errors import HandbenchError
from handbench.support.files import atomic_path, read_bytes, require_folder, write_text
from handbench.support.limits import TOML_BYTES

if TYPE_CHECKING:
    import pandas as pd

# Tables that older folders may lack.
OPTIONAL = ("repeats", "comparisons", "equal", "curves", "captures", "causes", "reliability")
TABLES = {name: SCHEMAS[name] for name in ("table", "tasks", *OPTIONAL)}
BUSY = 0.25  # cores that other work may take before times are called disturbed
UNSETTLED = 0.1  # of a median time: half an interval that is wider is told


@dataclass(frozen=True, eq=False)
class Result:
    """A result folder that has been checked to be complete; maps and photographs are read when asked for. table, tasks,
    repeats, comparisons, equal, curves, captures, causes, reliability: as `bench.results.tables` declares them."""

    folder: Path
    about: About
    table: pd.DataFrame
    tasks: pd.DataFrame
    repeats: pd.DataFrame
    config: str
    comparisons: pd.DataFrame = field(default_factory=lambda: frame(TABLES["comparisons"]))
    equal: pd.DataFrame = field(default_factory=lambda: frame(TABLES["equal"]))
    curves: pd.DataFrame = field(default_factory=lambda: frame(TABLES["curves"]))
    captures: pd.DataFrame = field(default_factory=lambda: frame(TABLES["captures"]))
    causes: pd.DataFrame = field(default_factory=lambda: frame(TABLES["causes"]))
    reliability: pd.DataFrame = field(default_factory=lambda: frame(TABLES["reliability"]))

    def __repr__(self) -> str:
        methods = ", ".join(method.name for method in self.about.methods)
        return f"<handbench.Result {self.about.name}: {len(self.about.captures)} captures; {methods}>"

    def row(self, metric: str, method: str, reference: str) -> Any:
        """The table's line, a named tuple of its columns; None without one."""
        found = self.table[(self.table.method == method) & (self.table.metric == metric)]
        return next(each(found[found.reference == reference]), None)

    def time(self, method: str) -> Any:
        """The line of the method's time per frame, which is the same with every reference; None where none is known."""
        found = self.table[(self.table.method == method) & (self.table.metric == "seconds")]
        return next(each(found[found.value.notna()]), None)

    def title(self, metric: str) -> str:
        """The metric as it is printed."""
        facts = self.about.metrics.get(metric)
        return facts.title if facts else metric

    def best(self, metric: str, reference: str, treatment: str = "") -> tuple[str, ...]:
        """The methods that nothing is shown to beat under one treatment ("": each as it is); () where nothing was
        compared."""
        return best(self.compared(treatment), metric, reference)

    def compared(self, treatment: str = "") -> pd.DataFrame:
        """The comparisons under one treatment."""
        return self.comparisons[self.comparisons.treatment == treatment]

    def scored(self) -> tuple[CaptureFacts, ...]:
        """The captures that are scored pixel by pixel."""
        return tuple(c for c in self.about.captures if "accuracy" in c.measures)

    def repeated(self) -> tuple[CaptureFacts, ...]:
        """The captures that the precision stands on."""
        return tuple(c for c in self.about.captures if "precision" in c.measures)

    def errors(self, capture: str, method: str, reference: str) -> ErrorMap:
        """Signed errors of one depth map."""
        path = errors_path(self.folder, capture, method, reference)
        return ErrorMap(**read_map(path, "error_m", "reference_z_m"))

    def surface(self, capture: str, source: str) -> Surface:
        """The depth map of a method, or of a reference ("truth", "photogrammetry")."""
        return Surface(**read_map(depth_path(self.folder, capture, source), "z_m"))

    def busy(self) -> dict[str, float]:
        """The methods whose frames were timed while other work took BUSY cores or more, on average, and how many."""
        tasks = self.tasks[(self.tasks.method != "") & self.tasks.others_cores.notna()]
        sums = tasks.assign(taken_s=tasks.others_cores * tasks.seconds).groupby("method", sort=False)
        cores = sums.taken_s.sum() / sums.seconds.sum()
        return {str(method): float(taken) for method, taken in cores.items() if taken >= BUSY}

    def unsettled(self) -> dict[str, float]:
        """The methods whose time per frame is not known to UNSETTLED, by how much of it the interval reaches up or
        down."""
        times = self.table[(self.table.metric == "seconds") & (self.table.value > 0)].drop_duplicates("method")
        reach = (times.high - times.low) / (2 * times.value)
        return {method: float(share) for method, share in zip(times.method, reach, strict=True) if share > UNSETTLED}

    def photo(self, capture: str) -> Path | None:
        """The capture's photograph, if it has one."""
        path = photo_path(self.folder, capture)
        return path if path.is_file() else None


def shown(comparisons: pd.DataFrame) -> pd.Series:
    """For each line, whether there is a difference at 5 % for all pairs of the metric together."""
    return comparisons.p_corrected < 1 - LEVEL


def best(comparisons: pd.DataFrame, metric: str, reference: str) -> tuple[str, ...]:
    """The method with the best figure and all that are not shown to be worse, in order of appearance; () where nothing
    was tested: no figure stands out then."""
    lines = comparisons[(comparisons.metric == metric) & (comparisons.reference == reference)]
    lines = lines[lines.p_corrected.notna()]
    ahead = ~lines.better.isin(lines.worse)
    worse = set(lines.worse[ahead & shown(lines)])
    return tuple(name for name in dict.fromkeys(lines[["better", "worse"]].to_numpy().flat) if name not in worse)


def write_about(folder: Path, about: About) -> None:
    """Write result.json. Write it last: a folder with it is meant to be complete. What is not finite becomes null."""
    with atomic_path(folder / "result.json") as temporary, temporary.open("wb") as file:
        file.writelines((TypeAdapter(About).dump_json(about, indent=2), b"\n"))  # text would take thrice as much memory


def write_tables(folder: Path, **tables: pd.DataFrame) -> None:
    """Write tables of `TABLES` as .csv."""
    for name, table in tables.items():
        write(folder / f"{name}.csv", table, TABLES[name])


def write_config(folder: Path, toml: str) -> None:
    """Write the resolved configuration, config.toml."""
    write_text(folder / "config.toml", toml)


def load(folder: str | Path) -> Result:
    """Read and check a result folder; a missing, partial or newer one is a HandbenchError."""
    folder = require_folder(folder, "a benchmark's result (result.json)")
    remedy = "run the benchmark again or use the handbench that wrote it"
    about = read_facts(About, folder / "result.json", "a benchmark's result", remedy)
    config = read_bytes(folder / "config.toml", "the resolved configuration", TOML_BYTES).decode("utf-8", "replace")
    files = {name: folder / f"{name}.csv" for name in TABLES}
    absent = [name for name in OPTIONAL if not files[name].exists()]
    tables = {name: frame(TABLES[name]) if name in absent else read(files[name], TABLES[name]) for name in TABLES}
    result = Result(folder, about, config=config, **tables)
    _require_complete(result)
    return result


def _require_complete(result: Result) -> None:
    paths = []
    for capture in result.scored():
        paths += [depth_path(result.folder, capture.name, reference) for reference in capture.references]
        for method in result.about.methods:
            paths.append(depth_path(result.folder, capture.name, method.name))
            paths += [errors_path(result.folder, capture.name, method.name, r) for r in capture.references]
    missing = [path for path in paths if not path.is_file()]
    if missing:
        raise HandbenchError(
            f"{missing[0]}: is missing ({len(missing)} of {len(paths)} maps are); "
            "the result is partial: run the benchmark again, it resumes"
        )
