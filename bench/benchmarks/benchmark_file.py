"""Benchmark files: which captures are imaged by which methods, and the protocol that scores the
depth maps.

A method with a `sweep` is one method for each combination of the listed values:

    [[method]]
    id = "broadband"
    config = { tolerance = 1e-3 }
    sweep = { "z.step_m" = [1e-3, 2e-3], every_nth_antenna = [1, 2] }
"""

import shlex
from collections.abc import Iterator, Sequence
from functools import reduce
from itertools import product
from math import prod
from operator import getitem
from os.path import relpath
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, field_validator, model_validator

from handbench.bench.datasets.dataset import AT_EMPTY_FILTERED, captures
from handbench.bench.results.about import MEASURES, Measure, name_problem
from handbench.bench.scenes.people import MOST_PEOPLE
from handbench.bench.scenes.scene_file import SceneFile
from handbench.groundtruth.options import Quality
from handbench.radar.methods.registry import method, titles
from handbench.radar.simulation.scene import Noise
from handbench.support.config import Config, Name, checked_name, load, parse, suggest
from handbench.support.errors import HandbenchError
from handbench.support.files import MOST_TABLES, real, require_folder

EMBEDDED = Path(__file__).parent
FOLDER = Path(__file__).with_name("folder.toml")  # the benchmark of a folder of captures
PLACES = ("{capture}", "{depth}")  # in a command: the folder to read, the file to write
EXAMPLE = "python mine.py {capture} {depth}"
UNITS = (("_hz", 1e-9, "GHz"), ("_m", 1e3, "mm"), ("_px", 1, "px"))  # of swept values, in names
ANTENNAS = "every_nth_antenna"
ADDED = ("capture", "dataset", "method")  # to those of the base

Measures = Annotated[tuple[Measure, ...], Field(min_length=1)]
Number = Annotated[int, Field(ge=1, le=MOST_PEOPLE)]


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
    persons: tuple[Number, ...] | None = Field(default=None, min_length=1, max_length=1000)
    set: dict[str, Any] = Field(default_factory=dict)
    suffix: Name | None = None

    @model_validator(mode="after")
    def _changes_of_a_scene(self) -> "Source":
        if self.scene is None and (self.set or self.suffix or self.persons):
            raise ValueError(
                'set, suffix or persons is given without a scene; give scene = "FILE.toml" instead '
                "of path"
            )
        if self.set and self.suffix is None:
            raise ValueError(
                'set is given without suffix; give suffix = "NAME", which tells this capture from '
                "others of the scene"
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
        root = real(base, self.path, "dataset.path")
        folders = captures(root, self.objects, self.distances)[: self.limit]
        suffix = AT_EMPTY_FILTERED if self.empty_filtered else ""
        paths = (f"{relpath(folder, base.resolve())}{suffix}" for folder in folders)
        return tuple(Source(path=path, measures=self.measures) for path in paths)


class GroundTruthSweep(Config):
    """Settings of the photogrammetric reconstruction that are compared. quality: as for
    `handbench groundtruth`."""

    quality: tuple[Quality, ...] = Field(min_length=1)


class GroundTruth(Config):
    """Options of the photogrammetric reconstruction that turns the captures' photographs into
    meshes. Those of a calibration target are always reconstructed at draft quality. sweep: settings
    to compare on the first capture that has photographs, a true surface and its transform."""

    quality: Quality = "draft"
    sweep: GroundTruthSweep | None = None


class MethodEntry(Config):
    """A method of the benchmark, with the settings that differ from the method's defaults
    (`config`).
    precision = true: measure its precision too. every_nth_antenna: use only every n-th transmitter
    and every n-th receiver, in the order of the echo file.
    name: how the tables call it, if not by its id; methods with the same id need different names.
    title: the name for readers. sweep: parameter → values, of which all combinations are measured.
    A dot leads into a table ("z.step_m"); parameters that change together share a key, separated by
    commas ("x.step_m,y.step_m").

    A foreign method, which is not part of handbench, has one of two fields. `maps` is a folder with
    a depth map CAPTURE.npz for each capture, relative to the benchmark file. `command` is a command
    line that makes the depth map; its placeholders {capture} and {depth} stand for the folder to
    read and the file to write. limit_s: longest duration of the command for each capture, s.
    """

    id: str
    name: Name | None = None
    title: str | None = None
    config: dict[str, Any] = Field(default_factory=dict)
    sweep: dict[str, Annotated[tuple[Any, ...], Field(min_length=1)]] = Field(default_factory=dict)
    precision: bool = False
    every_nth_antenna: int = Field(default=1, ge=1, le=MOST_TABLES)
    maps: str | None = None
    command: str | None = None
    limit_s: float | None = Field(default=None, gt=0, le=1e7)  # 115 days

    @property
    def label(self) -> str:
        """The name of the method in all tables: `name`, or the id."""
        return self.name or self.id

    @property
    def foreign(self) -> bool:
        """Whether the method is not part of handbench, but given by depth maps or by a command."""
        return self.maps is not None or self.command is not None

    @model_validator(mode="after")
    def _foreign_as_it_is(self) -> "MethodEntry":
        if self.maps is not None and self.command is not None:
            raise ValueError(f"method '{self.id}': has maps and a command; give only one of them")
        if self.command is None and self.limit_s is not None:
            raise ValueError(f"method '{self.id}': has limit_s but no command; leave it out")
        if not self.foreign:
            return self
        checked_name(self.id)
        if self.config or self.sweep or self.precision or self.every_nth_antenna > 1:
            raise ValueError(
                f"method '{self.id}': is from outside handbench, so config, sweep, precision and "
                "every_nth_antenna do not apply; leave these keys out"
            )
        if self.command is not None:
            try:
                words = " ".join(shlex.split(self.command))
            except ValueError:  # a quotation that does not end
                words = ""
            lacking = [place for place in PLACES if place not in words]
            if not words.isprintable() or lacking:
                raise ValueError(
                    f"method '{self.id}': the command is {self.command!r}; expected printable "
                    f"words, quoted as for a shell, with {' and '.join(lacking or PLACES)}, "
                    f"such as '{EXAMPLE}'"
                )
        return self


class BenchFile(Config):
    """Content of a benchmark file: the captures, the methods, and how they are measured and
    scored."""

    version: Literal[1]
    name: Name
    base: str | None = Field(
        default=None,
        description="an installed benchmark: its captures, data sets and methods follow those of "
        "the file, and its other keys hold where the file has none",
    )
    seed: int = Field(default=0, ge=0, lt=2**31)
    repeats: int = Field(default=10, ge=2, le=1000, description="frames for the precision")
    frames: int = Field(
        default=1, ge=1, le=1000, description="frames for the accuracy; the figures are the first's"
    )
    rounds: int = Field(
        default=1, ge=1, le=100, description="how often each image is timed, in shuffled order"
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

    @model_validator(mode="before")
    @classmethod
    def _on_base(cls, own: Any) -> Any:
        if not isinstance(own, dict) or own.get("base") is None:
            return own
        installed, name = embedded_benchmarks(), str(own["base"])
        if name not in installed:
            raise ValueError(
                f"'base' is {name[:80]!r}; expected an installed benchmark; "
                f"{suggest(name, list(installed))}"
            )
        # a paper's figures are those of its own captures
        others = {"reproduces"} if own.keys() & {"capture", "dataset"} else set[str]()
        base = load(cls, installed[name], "a benchmark description")
        given = base.model_dump(exclude_unset=True, exclude={"version", "name"} | others)
        for source in (*given["capture"], *given.get("calibration", ())):
            source["scene"] = str(EMBEDDED / source["scene"])
        lists = [key for key in ADDED if isinstance(own.get(key), list)]
        added = {key: [*own[key], *given.get(key, ())] for key in lists}
        return {**given, **own, **added, "base": None}

    @field_validator("calibration", mode="before")
    @classmethod
    def _one_or_several(cls, given: Any) -> Any:
        return [given] if isinstance(given, dict) else given

    @model_validator(mode="after")
    def _something_to_measure(self) -> "BenchFile":
        sources: tuple[Source | DataSet, ...] = (*self.capture, *(self.dataset or ()))
        measures = [source.measures for source in sources]
        if not any("accuracy" in measured for measured in measures):
            raise ValueError(
                "no capture measures the accuracy, which the table needs; add a [[capture]] or "
                "[[dataset]] that does"
            )
        if ("precision",) in measures and not any(entry.precision for entry in self.method):
            raise ValueError(
                "a capture measures only the precision, but no method has precision = true; add "
                "this to a method"
            )
        return self

    def frames_of(self, source: Origin) -> int:
        """Return how many frames of a capture the benchmark needs: the larger of the numbers of
        frames for the accuracy and for the precision; one of a calibration target."""
        if not isinstance(source, Source):
            return 1
        frames = self.frames if "accuracy" in source.measures else 1
        repeated = "precision" in source.measures and any(entry.precision for entry in self.method)
        return max(frames, self.repeats) if repeated else frames


def embedded_benchmarks() -> dict[str, Path]:
    """Find the benchmark files that are installed with handbench. Returns name → file."""
    return {
        path.stem: path
        for path in sorted(EMBEDDED.glob("*.toml"))
        if path != FOLDER and "\n[[method]]" in path.read_text("utf-8")
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
    if name and path.is_dir():
        return FOLDER
    raise HandbenchError(
        f"benchmark: '{name}' is neither a file, nor a folder of captures, nor a built-in "
        f"benchmark; {suggest(name, list(known))}"
    )


def load_benchmark(name: str, only: Sequence[str] = ()) -> tuple[BenchFile, Path]:
    """Read and check a benchmark file; return its content and the folder to which its paths are
    relative.
    name: a file, the name of a benchmark that is installed with handbench, or a folder of captures.
    only: labels of the methods to keep (none: all). The configuration of every method is checked.
    Sweeps, data sets and persons are expanded, so that `method` and `capture` list every single
    one. Raises HandbenchError for a file that is missing or wrong, and for an unknown label."""
    path = find_benchmark(name)
    base = Path(name) if path == FOLDER else path.parent
    bench = load(BenchFile, path, "a benchmark description")
    found = tuple(source for dataset in bench.dataset or () for source in dataset.sources(base))
    update = {
        "method": expanded(bench.method, path),
        "dataset": None,
        "capture": (*(one for source in bench.capture for one in source.each()), *found),
    }
    return _only(bench.model_copy(update=update), only), base


def scene_of(bench: BenchFile, base: Path, source: Origin) -> tuple[SceneFile, Path]:
    """Read the scene of a benchmark's capture, and apply the changes that the benchmark makes to
    it: `set`, person, phase noise, no photographs where nothing needs them. Returns the scene and
    its file.
    base: folder to which the benchmark's paths are relative."""
    path = real(base, source.scene or "", "capture.scene")
    scene = load(SceneFile, path, "a scene description")
    if isinstance(source, Source) and source.suffix:
        scene = scene.varied(source.set, source.suffix)
    if isinstance(source, Source) and source.persons:
        scene = scene.of_person(*source.persons)
    if bench.phase_noise_rad is not None:
        scene = scene.model_copy(update={"noise": Noise(phase_noise_rad=bench.phase_noise_rad)})
    precise = isinstance(source, Source) and "accuracy" not in source.measures
    if precise or not source.photos:  # nothing needs photographs
        scene = scene.model_copy(update={"photos": None})
    return scene, path


def load_tradeoff(name: str, only: Sequence[str] = ()) -> tuple[BenchFile, Path]:
    """Read a benchmark file like `load_benchmark`, to measure accuracy against time.
    A benchmark without any sweep gets the methods and rounds of the installed benchmark
    "tradeoff", with its own settings of these methods where the sweep sets no others, and keeps its
    foreign methods. Only captures for the accuracy are kept. If all are scenes, which have a true
    surface, no photographs are reconstructed: only the first scene has some, and only for a sweep
    of the ground truth."""
    bench, base = load_benchmark(name)
    if bench.groundtruth.sweep is None and all(entry.label == entry.id for entry in bench.method):
        default, _ = load_benchmark("tradeoff")
        configs = {entry.id: entry.config for entry in bench.method}
        entries = (
            entry.model_copy(update={"config": configs.get(entry.id, {}) | entry.config})
            for entry in default.method
        )
        foreign = (entry for entry in bench.method if entry.foreign)
        methods = (*entries, *foreign)
        bench = bench.model_copy(update={"method": methods, "rounds": default.rounds})
    bench = _only(bench, only)
    sources = tuple(source for source in bench.capture if "accuracy" in source.measures)
    if all(source.scene is not None for source in sources):
        count = 0 if bench.groundtruth.sweep is None else 1
        without = (source.model_copy(update={"photos": False}) for source in sources[count:])
        sources = (*sources[:count], *without)
        bench = bench.model_copy(update={"calibration": ()})
    return bench.model_copy(update={"capture": sources}), base


def _only(bench: BenchFile, labels: Sequence[str]) -> BenchFile:
    """Return the benchmark with only the methods of these labels, and without a sweep of the ground
    truth; unchanged if there are no labels. Raises HandbenchError for an unknown label."""
    known = [entry.label for entry in bench.method]
    for label in labels:
        if label not in known:
            raise HandbenchError(
                f"--only: benchmark '{bench.name}' has no method '{label}'; {suggest(label, known)}"
            )
    if not labels:
        return bench
    kept = tuple(entry for entry in bench.method if entry.label in labels)
    groundtruth = bench.groundtruth.model_copy(update={"sweep": None})
    return bench.model_copy(update={"method": kept, "groundtruth": groundtruth})


def expanded(entries: Sequence[MethodEntry], path: Path) -> tuple[MethodEntry, ...]:
    """Check the methods of a benchmark file, and return one entry for each combination of their
    swept values, with its own name, title and complete configuration.
    path: the benchmark file. Raises HandbenchError for what `checked_entry` refuses, for two
    entries with the same label, and for more than MOST_TABLES entries."""
    count = sum(prod(map(len, entry.sweep.values())) for entry in entries)
    if count > MOST_TABLES:
        raise HandbenchError(
            f"{path}: its sweeps make {count} methods; expected at most {MOST_TABLES}; list fewer "
            "values"
        )
    settings = tuple(
        checked_entry(setting, path) for entry in entries for setting in _combinations(entry, path)
    )
    labels = [setting.label for setting in settings]
    if twice := next((label for label in labels if labels.count(label) > 1), None):
        raise HandbenchError(
            f"{path}: method '{twice}' is listed twice; list it once, or give it another name "
            '(name = "…")'
        )
    return settings


def _combinations(entry: MethodEntry, path: Path) -> Iterator[MethodEntry]:
    """Yield one entry for each combination of the swept values of a method."""
    where = f"{path}: method '{entry.label}'"
    for values in product(*entry.sweep.values()):
        swept = dict(zip(entry.sweep, values, strict=True))
        words = [_words(keys, value) for keys, value in swept.items()]
        changes = {key.strip(): value for keys, value in swept.items() for key in keys.split(",")}
        every = changes.pop(ANTENNAS, entry.every_nth_antenna)
        config = entry.config
        for key, value in changes.items():
            resolved = method(entry.id).configure(config, where).model_dump(mode="json")
            *tables, leaf = key.split(".")
            try:
                reduce(getitem, tables, resolved)[leaf] = value
            except (KeyError, TypeError):
                raise HandbenchError(
                    f"{where}: sweep: '{key}' is not in a table of the method; correct the key"
                ) from None
            first = (tables or [leaf])[0]  # with the rest of its table
            config = {**config, first: resolved[first]}
        title = entry.title or entry.name or titles().get(entry.id, entry.id)
        update = {
            "title": ", ".join([title, *(text.replace("_", " ") for text in words)]),
            "config": config,
            ANTENNAS: every,
            "sweep": {},
        }
        if words:
            update["name"] = "-".join([entry.label, *words]).replace(" ", "-")
        # checked again: the values of a list have any type
        yield parse(MethodEntry, entry.model_dump() | update, where)


def _words(keys: str, value: Any) -> str:
    """Describe a swept value in a few words for names: "z.step_m", 2e-3 → "z.step 2mm". Parameters
    that change together become one word, such as xyz.step."""
    if keys == ANTENNAS:
        return f"1 of {value} antennas"
    names = [key.strip() for key in keys.split(",")]
    tables, leaves = zip(*(name.rpartition(".")[::2] for name in names), strict=True)
    together = all(tables) and len(set(leaves)) == 1
    words = f"{''.join(tables)}.{leaves[0]}" if together else "+".join(names)
    suffix, scale, unit = next((u for u in UNITS if words.endswith(u[0])), ("", 1, ""))
    words = "+".join(word.removesuffix(suffix) for word in words.split("+"))
    return f"{words} {_short(value, scale)}{unit}"


def _short(value: Any, scale: float) -> str:
    """Write a value, multiplied by `scale`, with as few characters as possible: 0.001 → 1e-3."""
    if isinstance(value, dict):
        return "_".join(_short(inner, 1) for inner in value.values())
    if isinstance(value, list | tuple):
        return "_".join(_short(inner, scale) for inner in value)
    if isinstance(value, bool) or not isinstance(value, int | float):
        return str(value)
    text = f"{value * scale:.12g}"
    short = np.format_float_scientific(float(text), trim="-", exp_digits=1).replace("+", "")
    return min(text, short, key=len)


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
    foreign method with the id of one of handbench's, a misleading name, or a missing folder of
    depth maps."""
    where = f"{path}: method '{entry.label}'"
    for name in (entry.label, entry.title or entry.label):
        require_clear(name, where, entry.id if entry.label == entry.id else "")
    if not entry.foreign:
        method(entry.id).configure(entry.config, where)
    elif entry.id in titles():
        raise HandbenchError(
            f"{where}: has maps or a command, but its id is that of a method of handbench; choose "
            "another id"
        )
    elif entry.maps is not None:
        require_folder(
            real(path.parent, entry.maps, f"{where}: maps"),
            "a depth map for each capture, CAPTURE.npz",
        )
    return entry
