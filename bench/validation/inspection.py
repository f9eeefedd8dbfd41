"""Everything that can be wrong with any file that handbench reads, found before hours are spent."""

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from handbench.bench.datasets.dataset import AT_EMPTY_FILTERED, captures, open_capture
from handbench.bench.datasets.maroon_alignment import ALIGNMENT, load_alignment, load_any_transform
from handbench.bench.datasets.native import DESCRIPTION, ECHOES, TARGET, TRANSFORM
from handbench.bench.results import load as load_result
from handbench.bench.results import load_tradeoff
from handbench.bench.results.about import MEASURES
from handbench.bench.run.benchmark_file import BenchFile, DataSet, MethodEntry, checked, find_benchmark, load_benchmark
from handbench.bench.scenes.scene_file import BUILT_IN_ARRAY, SceneFile, name_of_person
from handbench.bench.validation.capture_problems import Seen, capture_problems, method_problems, surface_problems
from handbench.bench.validation.checks import map_warnings, mesh_warnings, result_warnings
from handbench.bench.validation.photo_problems import is_of_photographs, photo_problems
from handbench.bench.validation.problems import Found, Location, Problem, Sheet, attempt, parsed, sheet
from handbench.calibration.array.array_file import load_array
from handbench.calibration.spheres.description import Target, load_target
from handbench.calibration.transforms import load_transform
from handbench.groundtruth.board.board import Board
from handbench.groundtruth.cameras.cameras import load_cameras
from handbench.groundtruth.mesh.mesh_files import read_triangles
from handbench.groundtruth.mesh.surface import read_surface
from handbench.radar.data.arrays import load_positions
from handbench.radar.data.depthmap import FLAGGED, load_depthmap
from handbench.radar.data.echoes_file import load_capture
from handbench.radar.methods.registry import method
from handbench.support.config import Config, load, read_toml
from handbench.support.errors import HandbenchError
from handbench.support.files import inside, read_json
from handbench.support.limits import MOST_TABLES
from handbench.support.progress import track

# A key that tells what a TOML file is, if it is neither benchmark nor scene.
DESCRIPTIONS: dict[str, type[Config]] = {"element": Target, "marker": Board, "charuco": Board}
MESHES = (".ply", ".obj", ".stl")


def show(inputs: Sequence[str], mesh: Path | None = None, transform: Path | None = None) -> None:
    """Print every problem of every input, FILE:LINE: problem; what to do, and at last how many there are.

    mesh, transform: the surface of a depth map, and what carries it into the radar frame. Raises HandbenchError if
    there is a problem that is more than a warning.
    """
    problems = warnings = 0
    for name in inputs:
        found = dict.fromkeys(inspect(name, mesh, transform))
        for problem in found:
            print(problem)
        if not found:
            print(f"{name}: nothing looks wrong")
        warnings += sum(problem.warning for problem in found)
        problems += sum(not problem.warning for problem in found)
    counts = ((problems, "problem"), (warnings, "warning"), (len(inputs), "input"))
    counted = ", ".join(f"{count} {what}{'s' * (count > 1)}" for count, what in counts if count)
    if problems:
        raise HandbenchError(f"inspect: {counted}; what is wrong is listed above")
    if warnings:
        print(f"{counted}; fine, if meant so")


def inspect(name: str, mesh: Path | None = None, transform: Path | None = None) -> Iterator[Problem]:
    """Everything that is wrong with an input; where no run would fail, what the data themselves show, as warnings."""
    path = Path(name)
    if path.suffix == ".npz":
        yield from _depth_map(path, mesh, transform)
        return
    if (path / "result.json").is_file():
        result = yield from attempt(path, partial(load_result, path))
        if result is not None:
            yield from _warnings(path, result_warnings(result))
        return
    if (path / "tradeoff.json").is_file():
        yield from attempt(path, partial(load_tradeoff, path))
        return
    found = list(problems_of(name, scored=None))
    yield from found
    if not all(problem.warning for problem in found):
        return
    if path.suffix.lower() in MESHES:
        yield from _warnings(path, mesh_warnings(read_surface(path)))
    told = {problem.text for problem in found}
    for folder in _captures(name):
        yield from (p for p in _capture_warnings(folder) if p.text not in told)


def _captures(name: str) -> Sequence[Path]:
    """The capture folders of an input: a folder of them, or a benchmark's."""
    path = Path(name)
    if path.is_dir():
        return () if is_of_photographs(path) else captures(path)
    file = find_benchmark(name)
    if file.suffix != ".toml" or "method" not in read_toml(file, "a benchmark"):
        return ()
    bench, base = load_benchmark(name)
    return [inside(base, source.path, "capture.path") for source in bench.capture if source.path]


def _capture_warnings(folder: Path) -> Iterator[Problem]:
    """Warnings about the images of a capture; reading it says which hand a foreign radar frame has."""
    from handbench.bench.validation.doubts import of_capture

    found = yield from attempt(folder, lambda: list(of_capture(open_capture(folder))))
    yield from _warnings(folder, found or ())


def _depth_map(path: Path, mesh: Path | None, transform: Path | None) -> Iterator[Problem]:
    """A depth map by itself, and against a surface."""
    depth = yield from attempt(path, partial(load_depthmap, path))
    if depth is None:
        return
    on_target = np.isfinite(depth.z_m)
    of_these = "" if depth.p_gross is None else f", {int((depth.p_gross[on_target] > FLAGGED).sum())} of these flagged"
    print(f"{path}: {depth.method}, {int(on_target.sum())} of {depth.z_m.size} pixels on target{of_these}")
    yield from _warnings(path, map_warnings(depth))
    if mesh is not None:
        from handbench.bench.validation import surface_fit

        surface = yield from attempt(mesh, partial(read_surface, mesh))
        if surface is not None:
            carried = surface.moved(load_any_transform(transform))
            yield from _warnings(path, surface_fit.findings(depth, carried))


def _warnings(path: Path, texts: Iterable[str]) -> Iterator[Problem]:
    return (Problem(path, None, text, warning=True) for text in texts)


def problems_of(name: str, scored: bool | None = True) -> Iterator[Problem]:
    """The problems of one input: a capture folder or a folder of them; a benchmark, by file or name; the file of a
    scene, a target, a board, a mesh, echoes, cameras, an array's calibration or a transform."""
    path = Path(name)
    if path.is_dir():
        yield from _folder(path, scored)
        return
    try:
        path = find_benchmark(name)
    except HandbenchError as error:
        yield Problem(path, None, str(error))
        return
    if path.suffix.lower() in MESHES:
        yield from surface_problems(path)
        return
    if path.suffix.lower() in (".h5", ".json"):
        yield from attempt(path, partial(load_capture if path.suffix.lower() == ".h5" else _read_json, path))
        return
    found = yield from sheet(path, "a benchmark or a scene")
    if found.values is None:
        return
    kind = next((kind for key, kind in DESCRIPTIONS.items() if key in found.values), None)
    if "target" in found.values:
        yield from _scene(path)
    elif kind is not None:
        yield from found.complaints(kind, found.values)
    else:
        yield from _benchmark(found)


def _read_json(path: Path) -> Any:
    """Cameras, an array's calibration, or a transform."""
    content = read_json(path, "cameras, an array's calibration or a transform")
    keys = content.keys() if isinstance(content, dict) else set()
    if "cameras" in keys:
        return load_cameras(path)
    if keys & {"tx", "rx"}:
        return load_array(path)
    return load_alignment(path) if path.name == ALIGNMENT else load_transform(path)


def _folder(path: Path, scored: bool | None) -> Iterator[Problem]:
    if (path / ECHOES).exists() or (path / DESCRIPTION).exists():
        yield from _capture(path, scored)
        return
    if is_of_photographs(path):
        yield from photo_problems(path, bool(scored))
        return
    folders = yield from attempt(path, lambda: captures(path))
    names: dict[str, Path] = {}
    for folder in track(folders or (), "captures"):
        seen = yield from _capture(folder, scored)
        if seen.name is not None and names.setdefault(seen.name, folder) != folder:
            text = f"is named '{seen.name}', as {names[seen.name]} is; no benchmark can hold both"
            yield Problem(folder / DESCRIPTION, None, text, warning=True)


def _capture(path: Path, scored: bool | None = True) -> Found[Seen]:
    """A capture of any form; of those that are not ours, what their adapters complain of. scored: it needs a
    reference."""
    if (path / ECHOES).exists() or (path / DESCRIPTION).exists():
        return (yield from capture_problems(path, scored))
    capture = yield from attempt(path, lambda: open_capture(path))
    if capture is None:
        return Seen(None)
    about = yield from attempt(path, lambda: capture.about)
    echoes = yield from attempt(path, capture.echoes)
    mesh = yield from attempt(path, capture.mesh)
    if mesh is not None:
        yield from attempt(mesh, partial(read_triangles, mesh))
    transform = yield from attempt(path, capture.transform)
    true, measured = capture.truth is not None, mesh is not None or capture.photos is not None
    return Seen.of(about, echoes, (true or (measured and transform is not None), true or measured), (TARGET,))


def _scene(path: Path) -> Found[Seen]:
    found, scene = yield from parsed(SceneFile, path, "a scene description")
    if scene is None:
        return Seen(None)
    readers: dict[str, Callable[[Path], Any]] = {"file": load_target, "path": read_triangles}
    for key, read in readers.items():
        name = getattr(scene.target, key, None)
        if name is not None:
            file = yield from found.attempt(("target", key), partial(inside, path.parent, name, "target"))
            if file is not None:
                yield from found.attempt(("target", key), partial(read, file))
    if scene.sensor.array != BUILT_IN_ARRAY:
        at = ("sensor", "array")
        array = yield from found.attempt(at, partial(inside, path.parent, scene.sensor.array, "array"))
        for file in () if array is None else (array / "tx_m.csv", array / "rx_m.csv"):
            yield from found.attempt(at, partial(load_positions, file))
    return Seen(scene.name, scene.sensor.frequencies_hz)


def _benchmark(found: Sheet) -> Iterator[Problem]:
    """Its own keys; every method with its configuration; every capture and scene, and whether the methods can image it
    and something can score it."""
    yield from found.complaints(BenchFile, found.values)
    configs = yield from _methods(found)
    calibrated = "calibration" in found.values
    for at, source in _tables(found, "calibration"):
        seen = yield from _source(found, source, at)
        if seen is not None and seen.lacks:
            yield found.problem(at, f"calibration by a capture without {', '.join(seen.lacks)}; add what is missing")
    sources = list(_tables(found, "capture"))
    for at, values in _tables(found, "dataset"):
        if list(found.complaints(DataSet, values)):
            continue
        dataset = DataSet.model_validate(values)
        below = yield from found.attempt((*at, "path"), partial(dataset.sources, found.file.parent))
        sources += [(at, source.model_dump()) for source in below or ()]
    names: dict[str, str] = {}
    scored: list[str] = []
    for at, source in track(sources, "captures"):
        seen = yield from _source(found, source, at)
        if seen is None or seen.name is None:
            continue
        here = str(source.get("scene") or source.get("path"))
        for name in [name_of_person(seen.name, number) for number in _persons(source)] or [seen.name]:
            if name in names:
                text = f"capture '{name}' in {here} is named as the one in {names[name]}; give one another name"
                yield found.problem(at, text)
            names.setdefault(name, here)
            scored += [name] if "accuracy" in _measures(source) else []
        if "accuracy" in _measures(source) and not seen.scored[calibrated]:
            text = f"capture '{seen.name}': nothing carries its surface into the radar frame"
            yield found.problem(at, f"{text}; add {TRANSFORM} to it, or [calibration] to the benchmark")
        yield from _imaged(found, seen, at, configs, _measures(source))
    for at, entry in _tables(found, "method"):
        yield from _missing_maps(found, at, entry.get("maps"), scored)


def _missing_maps(found: Sheet, at: Location, maps: Any, captures: Sequence[str]) -> Iterator[Problem]:
    """Captures of which a folder of depth maps has none."""
    if not isinstance(maps, str) or not os.path.isdir(folder := f"{found.file.parent}/{maps}"):
        return
    missing = [name for name in captures if not os.path.isfile(f"{folder}/{name}.npz")]
    if missing:
        few = ", ".join(missing[:5]) + (", …" if len(missing) > 5 else "")
        text = f"{maps} has no depth map of {len(missing)} of {len(captures)} captures: {few}; add NAME.npz for each"
        yield found.problem((*at, "maps"), text)


def _tables(found: Sheet, key: str) -> Iterator[tuple[Location, dict[str, Any]]]:
    """The tables of a key, each with its place, also where there is but one; what is no table is left out."""
    given = found.values.get(key, [])
    if isinstance(given, dict):
        yield (key,), given
    for index, entry in enumerate(given[:MOST_TABLES] if isinstance(given, list) else ()):
        if isinstance(entry, dict):
            yield (key, index), entry


def _methods(found: Sheet) -> Found[dict[str, dict[str, Any]]]:
    """Method id → its entry, of those that are well formed."""
    good = {}
    for at, entry in _tables(found, "method"):
        if isinstance(entry.get("id"), str) and {"maps", "command", "submission"} & entry.keys():
            if not list(found.complaints(MethodEntry, entry)):  # those of the file as a whole name them
                yield from found.attempt(at, partial(checked, MethodEntry.model_validate(entry), found.file))
        elif isinstance(entry.get("id"), str):
            values = entry.get("config", {})
            config = yield from method_problems(found, entry["id"], values, (*at, "id"), (*at, "config"))
            if config is not None:
                good[entry["id"]] = entry
    return good


def _source(found: Sheet, source: dict[str, Any], at: Location) -> Found[Seen | None]:
    """The scene or the capture that a benchmark names."""
    folder = partial(_capture, scored="accuracy" in _measures(source))
    for key, check in (("scene", _scene), ("path", folder)):
        name = source.get(key)
        if not isinstance(name, str):
            continue
        path = yield from found.attempt((*at, key), partial(inside, found.file.parent, name, key))
        if path is not None and not path.exists() and not name.endswith(AT_EMPTY_FILTERED):
            yield found.problem((*at, key), f"{name} is missing beside the benchmark; check the path")
            return None
        if path is None:
            return None
        seen = yield from check(path)
        if seen.name is not None and key == "scene" and _persons(source):
            scene = load(SceneFile, path, "a scene description")
            yield from found.attempt((*at, "persons"), partial(scene.of_person, 1))
        return seen
    return None


def _persons(source: dict[str, Any]) -> list[int]:
    """The persons whose hands a capture asks for; what is no list of numbers is a problem of its own."""
    given = source.get("persons")
    return [number for number in given if isinstance(number, int)] if isinstance(given, list | tuple) else []


def _measures(source: dict[str, Any]) -> Sequence[Any]:
    """The accuracy, the precision or both, as a capture says; both where it is no list, a problem of its own."""
    given = source.get("measures")
    return given if isinstance(given, list | tuple) else MEASURES


def _imaged(
    found: Sheet, seen: Seen, at: Location, entries: dict[str, dict[str, Any]], measures: Sequence[Any]
) -> Iterator[Problem]:
    """Problems of captures that lack the tones or the frames that a method takes."""
    repeats = found.values.get("repeats", BenchFile.model_fields["repeats"].default)
    frames = repeats if seen.frames is None else seen.frames
    for id, entry in entries.items():
        repeated = "precision" in measures and entry.get("precision") is True
        if not repeated and "accuracy" not in measures:
            continue
        if repeated and isinstance(repeats, int) and frames < repeats:
            text = f"capture '{seen.name}' has {frames} frames, but the precision of '{id}' takes repeats = {repeats}"
            yield found.problem(at, f"{text}; record more, or ask for fewer")
        problem = seen.problem_of(method(id), entry.get("config", {}))
        if problem is not None:
            yield found.problem(at, f"capture '{seen.name}' with method '{id}': {problem}")
