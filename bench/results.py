"""The result folder: written by the runner, read by the reports.

result.json   protocol, metric definitions, input hashes, versions, machine, captures, methods, facts, failures
table.csv     metric, method, value, low, high, unit, paper, reference
tasks.csv     task, capture, method, stage, seconds, cpu_seconds, peak_memory_mb, cached, plan_seconds, host,
              gemm_gflops
repeats.csv   capture, method, repeat, z_m: the strongest scatterer of each repeat of a precision capture
config.toml   the resolved configuration
errors/       CAPTURE__METHOD__REFERENCE.npz: x_m, y_m, error_m, reference_z_m
depth/        CAPTURE__METHOD.npz (a depth map), CAPTURE__truth.npz, CAPTURE__photogrammetry.npz (x_m, y_m, z_m,
              sigma_m: standard deviation along z, by mesh and registration together; NaN: unknown)
photos/       CAPTURE.jpg, at most 600 pixels wide and high
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Field

from bench.comparison import Comparison, best
from bench.errormap import ErrorMap
from bench.records import Repeat, Row, Task, read_csv, write_csv
from radar.config import Config, parse
from radar.errors import HandbenchError
from radar.files import atomic_path, read_json, read_npz, require_file, require_folder, write_json, write_npz

__all__ = [  # with what the reports need, for they know this module alone
    "REFERENCES", "SCHEMA_VERSION", "About", "CaptureFacts", "ErrorMap", "Failure", "HandbenchError", "MethodFacts",
    "MetricFacts", "Repeat", "Result", "Row", "Surface", "Task", "atomic_path", "checked_name", "depth_path",
    "errors_path", "load", "photo_path", "write_about", "write_config", "write_errors", "write_photo", "write_repeats",
    "write_surface", "write_table", "write_tasks",
]

SCHEMA_VERSION = 1
PHOTO_PX = 600
REFERENCES = ("photogrammetry", "truth")
Reference = Literal["photogrammetry", "truth"]


def checked_name(name: str) -> str:
    """`name` if it can be part of a file name: it neither leaves its folder, nor hides, nor holds our '__'."""
    unfit = not name.isprintable() or name.startswith(".") or any(part in name for part in ("/", "\\", "__"))
    if unfit or not 1 <= len(name) <= 80:
        raise ValueError(f"{name[:80]!r} cannot name a file; use 1 to 80 letters, digits, '-' and single '_'")
    return name


Name = Annotated[str, AfterValidator(checked_name)]


class MetricFacts(Config):
    """A metric as it was defined when the result was made."""

    title: str
    unit: str
    better: Literal["lower", "higher", "zero"]
    definition: str


class CaptureFacts(Config):
    """One capture: scored pixel by pixel against `references`, or repeated for the precision."""

    name: Name
    kind: Literal["accuracy", "precision"] = "accuracy"
    pose: str | None = None
    distance_m: float | None = None
    references: tuple[Reference, ...] = ()


class MethodFacts(Config):
    """One method with its resolved configuration."""

    name: Name
    title: str
    config: dict[str, Any] = Field(default_factory=dict)


class Failure(Config):
    """What did not come about, and why. method: empty where it fails the capture for every method."""

    capture: str
    method: str = ""
    stage: str
    message: str

    @property
    def line(self) -> str:
        """As it is said while a run goes on."""
        return f"{' '.join(filter(None, (self.capture, self.method)))}: {self.stage} failed: {self.message}"


class About(Config):
    """Content of result.json. inputs: file → SHA-256; captures, methods: those that the table stands on; facts: what is
    known of noise and ground truth; failures: what was left out, and why."""

    schema_version: Literal[1] = SCHEMA_VERSION
    name: str
    protocol: dict[str, Any]
    metrics: dict[str, MetricFacts]
    inputs: dict[str, str]
    versions: dict[str, str]
    machine: dict[str, Any]
    captures: tuple[CaptureFacts, ...]
    methods: tuple[MethodFacts, ...]
    facts: dict[str, Any] = Field(default_factory=dict)
    failures: tuple[Failure, ...] = ()


@dataclass(frozen=True)
class Surface:
    """A depth map to draw: z_m [ny, nx] at x_m [nx], y_m [ny], metres; NaN where there is none. sigma_m [ny, nx]: a
    reference's standard deviation along z, by mesh and registration together (None: not told; NaN: unknown)."""

    x_m: np.ndarray
    y_m: np.ndarray
    z_m: np.ndarray
    sigma_m: np.ndarray | None = None


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
        return ErrorMap(**_read_map(path, "error_m", "reference_z_m"))

    def surface(self, capture: str, source: str) -> Surface:
        """The depth map of a method, or of a reference ("truth", "photogrammetry")."""
        return Surface(**_read_map(depth_path(self.folder, capture, source), "z_m"))

    def photo(self, capture: str) -> Path | None:
        """The capture's photograph, if it has one."""
        path = photo_path(self.folder, capture)
        return path if path.is_file() else None


def errors_path(folder: Path, capture: str, method: str, reference: str) -> Path:
    """Where a map of signed errors lies."""
    return _path(folder / "errors", ".npz", capture, method, reference)


def depth_path(folder: Path, capture: str, source: str) -> Path:
    """Where the depth map of a method, or of a reference, lies."""
    return _path(folder / "depth", ".npz", capture, source)


def photo_path(folder: Path, capture: str) -> Path:
    """Where a capture's small photograph lies."""
    return _path(folder / "photos", ".jpg", capture)


def _path(folder: Path, suffix: str, *names: str) -> Path:
    try:
        return folder / ("__".join(map(checked_name, names)) + suffix)
    except ValueError as error:
        raise HandbenchError(f"{folder}: {error}") from None


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
    with atomic_path(folder / "config.toml") as temporary:
        temporary.write_text(toml, encoding="utf-8")


def write_errors(folder: Path, capture: str, method: str, reference: str, errors: ErrorMap) -> None:
    """Write one map of signed errors."""
    write_npz(errors_path(folder, capture, method, reference), **_told(errors))


def write_surface(folder: Path, capture: str, reference: str, surface: Surface) -> None:
    """Write a reference's depth map (a method's is written by `radar`, to `depth_path`)."""
    write_npz(depth_path(folder, capture, reference), **_told(surface))


def _told(maps: Surface | ErrorMap) -> dict[str, np.ndarray]:
    return {name: values for name, values in asdict(maps).items() if values is not None}


def write_photo(folder: Path, capture: str, source: str | Path) -> None:
    """Write a small JPEG of the photograph `source`, upright and without its metadata."""
    from PIL import Image, ImageOps

    source = require_file(source, "a photograph")
    try:
        with Image.open(source) as image:
            small = ImageOps.exif_transpose(image).convert("RGB")
    except (OSError, SyntaxError, Image.DecompressionBombError) as error:
        raise HandbenchError(f"{source}: is not a readable photograph ({error}); expected JPEG or PNG") from error
    small.thumbnail((PHOTO_PX, PHOTO_PX))
    with atomic_path(photo_path(folder, capture)) as temporary:
        Image.fromarray(np.asarray(small)).save(temporary, quality=88)


def load(folder: str | Path) -> Result:
    """Read and check a result folder; a missing, partial or newer one is a HandbenchError."""
    folder = require_folder(folder, "a benchmark's result (result.json)")
    about = _read_about(folder / "result.json")
    config = require_file(folder / "config.toml", "the resolved configuration").read_text("utf-8", "replace")
    repeats = read_csv(folder / "repeats.csv", Repeat) if (folder / "repeats.csv").exists() else ()
    compared = folder / "comparisons.csv"
    comparisons = read_csv(compared, Comparison) if compared.exists() else ()
    rows, tasks = read_csv(folder / "table.csv", Row), read_csv(folder / "tasks.csv", Task)
    result = Result(folder, about, rows, tasks, repeats, config, comparisons)
    _require_complete(result)
    return result


def _read_about(path: Path) -> About:
    content = read_json(path, "a benchmark's result")
    version = content.get("schema_version") if isinstance(content, dict) else None
    if version != SCHEMA_VERSION:
        raise HandbenchError(
            f"{path}: schema_version is {version!r}, this handbench reads {SCHEMA_VERSION}; "
            "run the benchmark again or use the handbench that wrote it"
        )
    return parse(About, content, str(path))


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


def _read_map(path: Path, *names: str) -> dict[str, np.ndarray]:
    arrays = read_npz(path, ("x_m", "y_m", *names))
    shape = (arrays["y_m"].size, arrays["x_m"].size)
    for name, array in arrays.items():
        expected = {"x_m": shape[1:], "y_m": shape[:1]}.get(name, shape)
        if array.shape != expected or array.dtype.kind != "f" or min(shape) < 2:
            raise HandbenchError(
                f"{path}: '{name}' is {array.dtype} {array.shape}; expected real numbers {expected} on a grid of "
                "at least 2 × 2; run the benchmark again"
            )
    return arrays
