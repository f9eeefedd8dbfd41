"""The result folder as a whole: written by the runner, read by the reports."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from bench.results.about import About, CaptureFacts, read_about
from bench.results.error_map import ErrorMap
from bench.results.maps import Surface, depth_path, errors_path, photo_path, read_map
from bench.results.records import Comparison, Repeat, Row, Task, best, read_csv, write_csv
from radar.support.errors import HandbenchError
from radar.support.files import require_file, require_folder, write_json, write_text


@dataclass(frozen=True)
class Result:
    """A result folder that has been checked to be complete; maps and photographs are read when asked for."""

    folder: Path
    about: About
    rows: tuple[Row, ...]
    tasks: tuple[Task, ...]
    repeats: tuple[Repeat, ...]
    config: str
    comparisons: tuple[Comparison, ...] = ()

    def row(self, metric: str, method: str, reference: str) -> Row | None:
        """The table's line, or None."""
        key = (metric, method, reference)
        return next((r for r in self.rows if (r.metric, r.method, r.reference) == key), None)

    def best(self, metric: str, reference: str) -> tuple[str, ...]:
        """The methods that nothing is shown to beat; () where nothing was compared."""
        return best(self.comparisons, metric, reference)

    def scored(self) -> tuple[CaptureFacts, ...]:
        """The captures that are scored pixel by pixel."""
        return tuple(c for c in self.about.captures if c.kind == "accuracy")

    def errors(self, capture: str, method: str, reference: str) -> ErrorMap:
        """Signed errors of one depth map."""
        path = errors_path(self.folder, capture, method, reference)
        return ErrorMap(**read_map(path, "error_m", "reference_z_m"))

    def surface(self, capture: str, source: str) -> Surface:
        """The depth map of a method, or of a reference ("truth", "photogrammetry")."""
        return Surface(**read_map(depth_path(self.folder, capture, source), "z_m"))

    def photo(self, capture: str) -> Path | None:
        """The capture's photograph, if it has one."""
        path = photo_path(self.folder, capture)
        return path if path.is_file() else None


def write_about(folder: Path, about: About) -> None:
    """Write result.json. Write it last: a folder with it is meant to be complete."""
    write_json(folder / "result.json", about.model_dump(mode="json"))


def write_table(folder: Path, rows: Iterable[Row]) -> None:
    """Write table.csv."""
    write_csv(folder / "table.csv", Row, rows)


def write_tasks(folder: Path, tasks: Iterable[Task]) -> None:
    """Write tasks.csv."""
    write_csv(folder / "tasks.csv", Task, tasks)


def write_repeats(folder: Path, repeats: Iterable[Repeat]) -> None:
    """Write repeats.csv."""
    write_csv(folder / "repeats.csv", Repeat, repeats)


def write_comparisons(folder: Path, comparisons: Iterable[Comparison]) -> None:
    """Write comparisons.csv."""
    write_csv(folder / "comparisons.csv", Comparison, comparisons)


def write_config(folder: Path, toml: str) -> None:
    """Write the resolved configuration, config.toml."""
    write_text(folder / "config.toml", toml)


def load(folder: str | Path) -> Result:
    """Read and check a result folder; a missing, partial or newer one is a HandbenchError."""
    folder = require_folder(folder, "a benchmark's result (result.json)")
    about = read_about(folder / "result.json")
    config = require_file(folder / "config.toml", "the resolved configuration").read_text("utf-8", "replace")
    repeats = read_csv(folder / "repeats.csv", Repeat) if (folder / "repeats.csv").exists() else ()
    compared = folder / "comparisons.csv"
    comparisons = read_csv(compared, Comparison) if compared.exists() else ()
    rows, tasks = read_csv(folder / "table.csv", Row), read_csv(folder / "tasks.csv", Task)
    result = Result(folder, about, rows, tasks, repeats, config, comparisons)
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
