"""Benchmark files: which captures are imaged by which methods, and the protocol that scores the
depth maps."""

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
    """Where a capture comes from: a scene file to simulate, or an existing capture folder.
    Exactly one of `scene` and `path` is given, relative to the benchmark file. photos = false: do
    not render the photographs of the scene."""

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
    measures: "accuracy" compares the depth map of the first frame with a reference; "precision" is
    the scatter of the depths over the benchmark's `repeats` frames and needs neither reference nor
    photographs. persons: numbers of simulated people; the scene becomes one capture for each
    person, with that person's hand and placement. set: values that replace those of the scene file,
    as {"target": {"motion": {"velocity_m_s": 0.1}}}; suffix: added to the scene's name for this
    capture."""

    measures: Measures = MEASURES
    persons: Persons | None = None
    set: dict[str, Any] = Field(default_factory=dict)
    suffix: Name | None = None

    @model_validator(mode="after")
    def _set_of_a_scene(self) -> "Source":
        if (self.set or self.suffix) and self.scene is None:
            raise ValueError(
                'set or suffix is given without a scene; give scene = "FILE.toml" instead of path'
            )
        if self.set and self.suffix is None:
            raise ValueError(
                'set is given without suffix; give suffix = "NAME", which tells this capture from '
                "others of the scene"
            )
        return self

    @model_validator(mode="after")
    def _persons_of_a_scene(self) -> "Source":
        if self.persons and self.scene is None:
            raise ValueError(
                'persons are given without a scene; give scene = "FILE.toml" instead of path'
            )
        return self

    def each(self) -> "tuple[Source, ...]":
        """Return one Source for each person of `persons`; without persons, a tuple of this Source
        only."""
        return tuple(self.model_copy(update={"persons": (one,)}) for one in self.persons or ()) or (
            self,
        )


class DataSet(Config):
    """Recorded captures in a folder: all of them, or those of some objects and distances.
    path: the folder, relative to the benchmark file; its captures are in ROOT/OBJECT or
    ROOT/OBJECT/DISTANCE. objects, distances: keep only these (empty: all). limit: keep only the
    first captures, at most so many. empty_filtered: use MAROON's frames from which the echoes of
    the empty room were subtracted. measures: "accuracy" or "precision" or both, for every
    capture."""

    path: str
    objects: tuple[str, ...] = ()
    distances: tuple[int, ...] = ()
    limit: int | None = Field(default=None, ge=1)
    empty_filtered: bool = False
    measures: Measures = MEASURES

    def sources(self, base: Path) -> tuple[Source, ...]:
        """Return the data set's captures as entries of a benchmark file.
        base: folder of the benchmark file, to which the paths are relative. Raises HandbenchError
        if no capture is found."""
        root = inside(base, self.path, "dataset.path")
        folders = captures(root, self.objects, self.distances)[: self.limit]
        suffix = AT_EMPTY_FILTERED if self.empty_filtered else ""
        paths = (f"{folder.relative_to(base.resolve()).as_posix()}{suffix}" for folder in folders)
        return tuple(Source(path=path, measures=self.measures) for path in paths)


class GroundTruth(Config):
    """Options of the photogrammetric reconstruction that turns the captures' photographs into
    meshes. Those of a calibration target are always reconstructed at draft quality."""

    quality: Quality = "draft"


class MethodEntry(Config):
    """A method of the benchmark, with the settings that differ from the method's defaults
    (`config`).
    precision = true: measure its precision too. every_nth_antenna: use only every n-th transmitter
    and every n-th receiver, in the order of the echo file.

    A foreign method, which is not part of handbench, has one of two fields. `maps` is a folder with
    a depth map CAPTURE.npz for each capture, relative to the benchmark file. `command` is a command
    line that makes the depth map; its placeholders {capture} and {depth} stand for the folder to
    read and the file to write. limit_s: longest duration of the command for each capture, s.
    """

    id: str
    config: dict[str, Any] = Field(default_factory=dict)
    precision: bool = False
    every_nth_antenna: int = Field(default=1, ge=1, le=MOST_TABLES)
    maps: str | None = None
    command: str | None = None
    limit_s: float | None = Field(default=None, gt=0, le=1e7)  # 115 days

    @property
    def foreign(self) -> bool:
        """Whether the method is not part of handbench, but given by depth maps or by a command."""
        return self.maps is not None or self.command is not None

    @model_validator(mode="after")
    def _foreign_as_it_is(self) -> "MethodEntry":
        where = f"method '{self.id}'"
        if self.maps is not None and self.command is not None:
            raise ValueError(f"{where}: has maps and a command; give only one of them")
        if self.command is None and self.limit_s is not None:
            raise ValueError(f"{where}: has limit_s but no command; leave it out")
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
    """Content of a benchmark file: the captures, the methods, how they are measured and scored, and
    which settings a trade-off varies."""

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
        """Return how many frames of a capture the benchmark needs: the larger of the numbers of
        frames for the accuracy and for the precision."""
        frames = self.frames if "accuracy" in source.measures else 1
        repeated = "precision" in source.measures and any(entry.precision for entry in self.method)
        return max(frames, self.repeats) if repeated else frames


def embedded_benchmarks() -> dict[str, Path]:
    """Find the benchmark files that are installed with handbench. Returns name → file."""
    return {
        path.stem: path
        for path in sorted(EMBEDDED.glob("*.toml"))
        if "\n[[method]]" in path.read_text("utf-8")
    }


def find_benchmark(name: str) -> Path:
    """Return the path of a benchmark file.
    name: the path itself; the name of a benchmark that is installed with handbench; or a folder of
    captures, for which a general benchmark file is returned. Raises HandbenchError for any other
    name."""
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
    """Read and check a benchmark file; return its content and the folder to which its paths are
    relative.
    name: a file, the name of a benchmark that is installed with handbench, or a folder of captures.
    The configuration of every method is checked. Data sets and persons are expanded, so that
    `capture` lists every single capture. Raises HandbenchError for a file that is missing or
    wrong."""
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
    """Return a name of a capture or method unchanged, if it can be told from all other names of a
    result.
    where: file or argument, with which the error message begins. own: id of the method that has the
    name; "" for a capture. Raises HandbenchError if the name is that of a reference or of another
    method."""
    if problem := name_problem(name, own):
        raise HandbenchError(f"{where}: {problem}")
    return name


def checked_entry(entry: MethodEntry, path: Path) -> MethodEntry:
    """Check a method of a benchmark file, and return it unchanged.
    path: the benchmark file. Raises HandbenchError for an unknown method, a wrong configuration, a
    foreign method with the id of one of handbench's, or a missing folder of depth maps."""
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
