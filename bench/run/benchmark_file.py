"""Benchmark files: the work of a run, and the protocol that scores it."""

import shlex
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import AfterValidator, Field, field_validator, model_validator

from handbench.bench.datasets.dataset import AT_EMPTY_FILTERED, captures
from handbench.bench.results.about import MEASURES, Measure, name_problem
from handbench.bench.run.sweep import TradeoffSweep, imaging_settings, known_configs
from handbench.bench.scenes.people import MOST_PEOPLE
from handbench.groundtruth.options import Quality
from handbench.radar.methods.registry import method, methods
from handbench.support.config import Config, Name, checked_name, load, suggest
from handbench.support.errors import HandbenchError
from handbench.support.files import inside, require_folder
from handbench.support.limits import MOST_TABLES

EMBEDDED = Path(__file__).parent / "benchmarks"
FOLDER = Path(__file__).with_name("folder.toml")  # the benchmark of a folder of captures
PLACES = ("{capture}", "{depth}")  # in a command: the folder to read, the file to write
EXAMPLE = "python mine.py {capture} {depth}"


Item = TypeVar("Item")


def _each_once(items: tuple[Item, ...]) -> tuple[Item, ...]:
    if len(set(items)) < len(items):
        raise ValueError("a value is listed twice; list each once")
    return items


Measures = Annotated[tuple[Measure, ...], Field(min_length=1), AfterValidator(_each_once)]
Number = Annotated[int, Field(ge=1, le=MOST_PEOPLE)]
Persons = Annotated[
    tuple[Number, ...], Field(min_length=1, max_length=1000), AfterValidator(_each_once)
]


class Origin(Config):
    """A capture: a scene file to simulate, or a capture folder, relative to the benchmark file.
    photos = false: do not render a scene's photographs."""

    scene: str | None = None
    path: str | None = None
    photos: bool = True

    @model_validator(mode="after")
    def _one_of_both(self) -> "Origin":
        if (self.scene is None) == (self.path is None):
            raise ValueError('give either scene = "FILE.toml" or path = "CAPTURE_FOLDER"')
        return self


class Source(Origin):
    """A capture of the benchmark, and what is measured on it.
    measures: "accuracy", by its first frame against a reference; "precision", by the scatter over
    the benchmark's `repeats` frames, without a reference or photographs. persons: numbers of
    people; the scene becomes one capture per person, with that person's hand and placement."""

    measures: Measures = MEASURES
    persons: Persons | None = None

    @model_validator(mode="after")
    def _persons_of_a_scene(self) -> "Source":
        if self.persons and self.scene is None:
            raise ValueError(
                'persons are given without a scene; give scene = "FILE.toml" instead of path'
            )
        return self

    def each(self) -> "tuple[Source, ...]":
        """Return its captures, one per person; only itself if it names no persons."""
        return tuple(self.model_copy(update={"persons": (one,)}) for one in self.persons or ()) or (
            self,
        )


class DataSet(Config):
    """Captures of a data set: all below a folder, or those of some objects and distances.
    path: the folder, relative to the benchmark file, with captures in ROOT/OBJECT or
    ROOT/OBJECT/DISTANCE. objects, distances: keep only these (empty: all), at most `limit`, in
    order. empty_filtered: use MAROON's frames with the empty room subtracted. measures: "accuracy"
    or "precision" or both, for each capture."""

    path: str
    objects: tuple[str, ...] = ()
    distances: tuple[int, ...] = ()
    limit: int | None = Field(default=None, ge=1)
    empty_filtered: bool = False
    measures: Measures = MEASURES

    def sources(self, base: Path) -> tuple[Source, ...]:
        """Return its captures as entries of a benchmark file that lies in the folder `base`. Raises
        HandbenchError if there are none."""
        root = inside(base, self.path, "dataset.path")
        folders = captures(root, self.objects, self.distances)[: self.limit]
        suffix = AT_EMPTY_FILTERED if self.empty_filtered else ""
        paths = (f"{folder.relative_to(base.resolve()).as_posix()}{suffix}" for folder in folders)
        return tuple(Source(path=path, measures=self.measures) for path in paths)


class GroundTruth(Config):
    """Options of the reconstruction of photographs as meshes."""

    quality: Quality = "draft"


class MethodEntry(Config):
    """A method and the settings that it changes.
    precision = true: measure its precision too. every_nth_antenna: use only every n-th transmitter
    and receiver, in the order of the file.

    A foreign method, which is not part of handbench, has either `maps`, the folder of its depth
    maps CAPTURE.npz, relative to the benchmark file; or `command`, a command line with the
    placeholders {capture} and {depth} that makes one. limit_s, limit_mb: seconds, and megabytes of
    address space (0: no limit), for each capture.
    """

    id: str
    config: dict[str, Any] = Field(default_factory=dict)
    precision: bool = False
    every_nth_antenna: int = Field(default=1, ge=1, le=MOST_TABLES)
    maps: str | None = None
    command: str | None = None
    limit_s: float | None = Field(default=None, gt=0, le=1e7)  # 115 days
    limit_mb: int | None = Field(default=None, ge=0, le=2**30)

    @property
    def foreign(self) -> bool:
        """True for a method that is not part of handbench."""
        return self.maps is not None or self.command is not None

    @model_validator(mode="before")
    @classmethod
    def _no_submission(cls, given: Any) -> Any:
        if isinstance(given, dict) and "submission" in given:
            raise ValueError(
                'the key submission is no longer used; give maps = "FOLDER", with a depth map '
                "CAPTURE.npz for each capture"
            )
        return given

    @model_validator(mode="after")
    def _foreign_as_it_is(self) -> "MethodEntry":
        where = f"method '{self.id}'"
        if self.maps is not None and self.command is not None:
            raise ValueError(f"{where}: has maps and a command; give only one of them")
        if self.command is None and (self.limit_s is not None or self.limit_mb is not None):
            raise ValueError(
                f"{where}: has limit_s or limit_mb but no command; leave these keys out"
            )
        if not self.foreign:
            return self
        checked_name(self.id)
        if self.config or self.precision or self.every_nth_antenna > 1:
            raise ValueError(
                f"{where}: is a method from outside handbench, to which config, precision and "
                "every_nth_antenna do not apply; leave these keys out"
            )
        if self.command is not None:
            if not self.command.isprintable():
                raise ValueError(
                    f"{where}: the command has characters that cannot be printed; remove them"
                )
            try:
                words = shlex.split(self.command)
            except ValueError as error:
                raise ValueError(
                    f"{where}: the command cannot be split into words ({error}); quote it as for "
                    "a shell"
                ) from None
            if missing := [place for place in PLACES if not any(place in word for word in words)]:
                raise ValueError(
                    f"{where}: the command has no {' and no '.join(missing)}; expected a command "
                    f"such as '{EXAMPLE}'"
                )
        return self


class BenchFile(Config):
    """The content of a benchmark file."""

    version: Literal[1]
    name: Name
    seed: int = Field(default=0, ge=0, lt=2**31)
    repeats: int = Field(default=10, ge=2, le=1000, description="frames for the precision")
    frames: int = Field(
        default=1, ge=1, le=1000, description="frames for the accuracy; the figures are the first's"
    )
    phase_noise_rad: float | None = Field(
        default=None, ge=0, description="replaces the noise of every scene"
    )
    protocol: Literal["paper", "maroon", "maroon-eroded"] = "paper"
    reproduces: Literal["paper"] | None = Field(
        default=None, description="the paper whose figures are printed next to ours"
    )
    groundtruth: GroundTruth = GroundTruth()
    calibration: tuple[Origin, ...] = Field(
        default=(), max_length=MOST_TABLES, description="captures of one target, combined"
    )
    dataset: tuple[DataSet, ...] | None = Field(
        default=None, description="their captures join those of `capture`"
    )
    capture: tuple[Source, ...] = Field(default=(), max_length=MOST_TABLES)
    method: tuple[MethodEntry, ...] = Field(min_length=1, max_length=MOST_TABLES)
    tradeoff: TradeoffSweep | None = Field(
        default=None, description="what `handbench tradeoff` sweeps"
    )

    @field_validator("calibration", mode="before")
    @classmethod
    def _one_or_several(cls, given: Any) -> Any:
        return [given] if isinstance(given, dict) else given

    @model_validator(mode="after")
    def _something_to_run(self) -> "BenchFile":
        if not self.capture and not self.dataset:
            raise ValueError("there is nothing to run; add [[capture]] or [[dataset]]")
        return self

    @model_validator(mode="after")
    def _something_to_measure(self) -> "BenchFile":
        measures = [source.measures for source in self.capture] + [
            found.measures for found in self.dataset or ()
        ]
        if not any("accuracy" in measured for measured in measures):
            raise ValueError(
                "no capture measures the accuracy, which the table needs; add a capture that does"
            )
        if ("precision",) in measures and not any(entry.precision for entry in self.method):
            raise ValueError(
                "a capture measures only the precision, but no method has precision = true; add "
                "this to a method"
            )
        return self

    @model_validator(mode="after")
    def _known_methods(self) -> "BenchFile":
        ids = [entry.id for entry in self.method]
        for entry in self.method:
            if ids.count(entry.id) > 1:
                raise ValueError(f"method '{entry.id}' is listed twice; list it once")
        return self

    def frames_of(self, source: Source) -> int:
        """Return the number of a capture's frames that are needed, the larger of those for accuracy
        and for precision."""
        frames = self.frames if "accuracy" in source.measures else 1
        repeated = "precision" in source.measures and any(entry.precision for entry in self.method)
        return max(frames, self.repeats) if repeated else frames


def embedded_benchmarks() -> dict[str, Path]:
    """Find the benchmarks that come with handbench: name → file."""
    return {
        path.stem: path
        for path in sorted(EMBEDDED.glob("*.toml"))
        if "\n[[method]]" in path.read_text("utf-8")
    }


def find_benchmark(name: str) -> Path:
    """Return the path of a benchmark file, given by its path, by the name of one that comes with
    handbench, or by a folder of captures. Raises HandbenchError for an unknown name."""
    path, known = Path(name), embedded_benchmarks()
    if path.suffix == ".toml" or path.is_file():
        return path
    if name in known:
        return known[name]
    if path.is_dir():
        return FOLDER
    raise HandbenchError(
        f"benchmark: '{name}' is neither a file, nor a folder of captures, nor a built-in "
        f"benchmark; {suggest(name, list(known))}"
    )


def load_benchmark(name: str) -> tuple[BenchFile, Path]:
    """Read and check a benchmark file, by path or name, or that of a folder of captures; return it
    and the folder that its paths start from.
    Every method's configuration is checked; data sets and persons are expanded into single
    captures. Raises HandbenchError for anything wrong."""
    path = find_benchmark(name)
    base = Path(name) if path == FOLDER else path.parent
    bench = load(BenchFile, path, "a benchmark description")
    bench = bench.model_copy(
        update={"method": tuple(checked_entry(entry, path) for entry in bench.method)}
    )
    if bench.tradeoff is not None:
        imaging_settings(bench.tradeoff, known_configs(bench.method))
    found = tuple(source for dataset in bench.dataset or () for source in dataset.sources(base))
    sources = (*(one for source in bench.capture for one in source.each()), *found)
    return bench.model_copy(update={"dataset": None, "capture": sources}), base


def require_clear(name: str, where: str, own: str = "") -> str:
    """Return a name of a capture or a method, which has the id `own`. Raises a HandbenchError,
    which begins with `where`, for one that reads as a reference or as another method."""
    if problem := name_problem(name, own):
        raise HandbenchError(f"{where}: {problem}")
    return name


def checked_entry(entry: MethodEntry, path: Path) -> MethodEntry:
    """Return the entry with its configuration checked. Raises HandbenchError for an unknown method,
    a wrong configuration or missing maps."""
    where = f"{path}: method '{entry.id}'"
    require_clear(entry.id, where, entry.id)
    if not entry.foreign:
        method(entry.id).configure(entry.config, where)
    elif entry.id in {known.id for known in methods()}:
        given = "maps" if entry.command is None else "command"
        raise HandbenchError(
            f"{where}: has {given}, but its id is that of a method of handbench; choose another id"
        )
    elif entry.maps is not None:
        require_folder(
            inside(path.parent, entry.maps, f"{where}: maps"),
            "a depth map for each capture, CAPTURE.npz",
        )
    return entry
