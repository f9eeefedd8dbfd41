"""Checks of benchmark and scene files, and of the captures and depth maps that they name: each
problem with its file and line."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from pydantic import ValidationError

from handbench.bench.benchmarks.benchmark_file import (
    BenchFile,
    DataSet,
    MethodEntry,
    Origin,
    Source,
    checked_entry,
    expanded,
    require_clear,
)
from handbench.bench.datasets.dataset import AT_EMPTY_FILTERED
from handbench.bench.datasets.native import TRANSFORM, CaptureFile
from handbench.bench.scenes.scene_file import BUILT_IN_ARRAY, SceneFile, name_of_person
from handbench.bench.validation.capture_problems import (
    CheckedCapture,
    capture_problems,
    method_problems,
)
from handbench.bench.validation.problems import Found, ParsedFile, Problem, attempt, parse_model
from handbench.calibration.spheres.description import load_target
from handbench.groundtruth.mesh.mesh_files import read_triangles
from handbench.radar.data.arrays import load_positions
from handbench.support.config import Config, Location, load
from handbench.support.errors import HandbenchError
from handbench.support.files import inside
from handbench.support.limits import MOST_TABLES
from handbench.support.progress import track

Table = TypeVar("Table", bound=Config)
SHOWN = 5  # names in a list, at most


def scene_problems(path: Path) -> Found[CheckedCapture]:
    """Yield the problems of a scene file and of the files that it names. Returns the scene's name
    and frequencies, which the checks of a benchmark need."""
    found, scene = yield from parse_model(SceneFile, path, "a scene description")
    if scene is None:
        return CheckedCapture()
    readers: dict[str, Callable[[Path], Any]] = {"file": load_target, "path": read_triangles}
    for key, read in readers.items():
        name = getattr(scene.target, key, None)
        if name is not None:
            file = yield from found.attempt(
                ("target", key), partial(inside, path.parent, name, "target")
            )
            if file is not None:
                yield from found.attempt(("target", key), partial(read, file))
    if scene.sensor.array != BUILT_IN_ARRAY:
        at = ("sensor", "array")
        array = yield from found.attempt(
            at, partial(inside, path.parent, scene.sensor.array, "array")
        )
        for file in () if array is None else (array / "tx_m.csv", array / "rx_m.csv"):
            yield from found.attempt(at, partial(load_positions, file))
    return _facts_of(scene)


def _facts_of(scene: SceneFile) -> CheckedCapture:
    tones_hz = scene.sensor.frequencies_hz
    times_s = scene.sensor.step_time_s * np.arange(len(tones_hz))
    return CheckedCapture(CaptureFile(name=scene.name), tones_hz, times_s=times_s)


def benchmark_problems(found: ParsedFile) -> Iterator[Problem]:
    """Yield all problems of a benchmark file: of its keys, of every method with its configuration,
    and of every capture and scene, including whether the methods can image it and whether it can be
    scored."""
    yield from found.complaints(BenchFile, found.values)
    methods = yield from _methods(found)
    calibrated = "calibration" in found.values
    for at, origin in _tables(found, "calibration", Origin):
        facts = yield from _source(found, at, origin)
        if facts is not None and facts.lacks:
            text = (
                f"the capture for the calibration has no {', '.join(facts.lacks)}; add what is "
                "missing"
            )
            yield found.problem(at, text)
    sources = list(_tables(found, "capture", Source))
    for at, dataset in _tables(found, "dataset", DataSet):
        below = yield from found.attempt((*at, "path"), partial(dataset.sources, found.file.parent))
        sources += [(at, source) for source in below or ()]
    places: dict[str, str] = {}
    scored: dict[str, CaptureFile] = {}
    for at, source in track(sources, "captures"):
        accuracy = "accuracy" in source.measures
        facts = yield from _source(found, at, source, accuracy)
        if facts is None or facts.about is None:
            continue
        about, here = facts.about, str(source.scene or source.path)
        for name in [name_of_person(about.name, number) for number in source.persons or ()] or [
            about.name
        ]:
            yield from found.attempt(at, partial(require_clear, name, f"capture '{name}'"))
            if name in places:
                text = (
                    f"capture '{name}' in {here} has the same name as the one in {places[name]}; "
                    "rename one of them"
                )
                yield found.problem(at, text)
            places.setdefault(name, here)
            scored |= {name: about} if accuracy else {}
        if accuracy and facts.scored[True] and not facts.scored[calibrated]:
            text = f"capture '{about.name}': nothing transforms its surface to the radar frame"
            yield found.problem(
                at, f"{text}; add {TRANSFORM} to the capture, or [calibration] to the benchmark"
            )
        yield from _imaged(found, at, source, facts, methods)
    yield from _maps(found, scored, methods)


def _tables(found: ParsedFile, key: str, model: type[Table]) -> Iterator[tuple[Location, Table]]:
    """Yield the tables under a key of a benchmark file, each as (its place in the file, instance of
    `model`). A single table counts as a list of one.

    A malformed table is yielded without its malformed keys, or left out if that is not enough. It
    is not a problem here, because the check of the whole file reports it.
    """
    given = found.values.get(key, [])
    tables = {
        (key, index): table
        for index, table in enumerate(given[:MOST_TABLES] if isinstance(given, list) else ())
    }
    for at, table in ({(key,): given} if isinstance(given, dict) else tables).items():
        try:
            yield at, model.model_validate(table)
        except (
            ValidationError
        ) as error:  # without the keys that the complaints about the whole file name
            wrong = {each["loc"][0] for each in error.errors() if each["loc"]}
            if isinstance(table, dict) and not wrong & {"maps", "command"}:
                with suppress(ValidationError):
                    yield (
                        at,
                        model.model_validate(
                            {key: v for key, v in table.items() if key not in wrong}
                        ),
                    )


def _methods(found: ParsedFile) -> Found[list[MethodEntry]]:
    """Yield the problems of all methods of a benchmark. Returns the entries of handbench's own
    methods that have none, one for each combination of swept values."""
    entries = []
    for at, entry in _tables(found, "method", MethodEntry):
        if entry.foreign:
            checked = yield from found.attempt(at, partial(checked_entry, entry, found.file))
        else:
            places = (*at, "id"), (*at, "config")
            checked = yield from method_problems(found, entry.id, entry.config, *places)
        if checked is not None:
            entries.append(entry)
    settings = yield from found.attempt(("method",), partial(expanded, entries, found.file))
    return [setting for setting in settings or () if not setting.foreign]


def _source(
    found: ParsedFile, at: Location, source: Origin, scored: bool = True
) -> Found[CheckedCapture | None]:
    """Yield the problems of the scene or capture that a benchmark names. Returns what the
    benchmark's other checks need to know of it (None: it is missing).

    at: place of the entry in the file. scored: whether the capture needs a reference surface.
    """
    key, name = ("scene", source.scene) if source.scene is not None else ("path", str(source.path))
    path = yield from found.attempt((*at, key), partial(inside, found.file.parent, name, key))
    if path is None:
        return None
    if not path.exists() and not name.endswith(AT_EMPTY_FILTERED):
        yield found.problem(
            (*at, key), (f"{name} is missing in the benchmark's folder; check the path")
        )
        return None
    if key == "path":
        return (yield from capture_problems(path, scored))
    facts = yield from scene_problems(path)
    if facts.about is None or not isinstance(source, Source):
        return facts
    scene = load(SceneFile, path, "a scene description")
    if source.persons:
        yield from found.attempt((*at, "persons"), partial(scene.of_person, 1))
    if source.suffix is None:
        return facts
    varied = yield from found.attempt(
        (*at, "set"), partial(scene.varied, source.set, source.suffix)
    )
    return CheckedCapture() if varied is None else _facts_of(varied)


def _imaged(
    found: ParsedFile,
    at: Location,
    source: Source,
    facts: CheckedCapture,
    methods: Sequence[MethodEntry],
) -> Iterator[Problem]:
    """Yield the problems of a capture that lacks the tones or the frames that a method of the
    benchmark needs. at: place of its entry in the file; facts: what is known of the capture."""
    name = facts.about.name if facts.about else ""
    repeats = found.values.get("repeats", BenchFile.model_fields["repeats"].default)
    frames = repeats if facts.frames is None else facts.frames
    for entry in methods:
        repeated = "precision" in source.measures and entry.precision
        if repeated and isinstance(repeats, int) and frames < repeats:
            text = (
                f"capture '{name}' has {frames} frames, but the precision of '{entry.id}' needs "
                f"repeats = {repeats}"
            )
            yield found.problem(at, f"{text}; record more frames, or set fewer repeats")
        refusal = (
            facts.refusal(entry.id, entry.config)
            if repeated or "accuracy" in source.measures
            else None
        )
        if refusal is not None:
            yield found.problem(at, f"capture '{name}' with method '{entry.id}': {refusal}")


def _maps(
    found: ParsedFile, scored: dict[str, CaptureFile], methods: Sequence[MethodEntry]
) -> Iterator[Problem]:
    """Yield the problems of depth maps that were made by other software: captures without a map,
    and maps that a run would refuse.

    scored: name → description of the captures whose accuracy is measured.
    """
    for at, entry in _tables(found, "method", MethodEntry):
        if entry.maps is None:
            continue
        try:
            folder = inside(found.file.parent, entry.maps, "maps")
        except HandbenchError:  # reported where the entry is checked
            continue
        if not folder.is_dir():
            continue
        files = {name: inside(folder, f"{name}.npz", "maps") for name in scored}
        missing = [name for name, file in files.items() if not file.is_file()]
        if missing:
            few = ", ".join(missing[:SHOWN]) + (", …" if len(missing) > SHOWN else "")
            text = (
                f"{entry.maps} has no depth map for {len(missing)} of {len(scored)} captures: {few}"
            )
            yield found.problem((*at, "maps"), f"{text}; add a NAME.npz for each")
        for name, about in scored.items():
            if name not in missing:
                file = files[name]
                yield from attempt(file, partial(_read_map, file, entry.id, about, methods))


def _read_map(file: Path, id: str, about: CaptureFile, methods: Sequence[MethodEntry]) -> None:
    """Read a depth map that was made by other software, in the way that a run reads it. Raises
    HandbenchError if a run would refuse it."""
    from handbench.bench.stages import foreign  # whose module images

    foreign.read_map(file, id, foreign.pixels(about, methods))
