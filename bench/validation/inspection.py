"""Inspection of any file or folder that handbench reads, which reports all problems at once."""

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from handbench.bench.benchmarks.benchmark_file import find_benchmark, load_benchmark
from handbench.bench.datasets.dataset import captures, open_capture
from handbench.bench.datasets.maroon_alignment import ALIGNMENT, load_alignment, load_any_transform
from handbench.bench.datasets.native import DESCRIPTION
from handbench.bench.datasets.ti import is_ti_raw, read_raw
from handbench.bench.validation.benchmark_problems import benchmark_problems, scene_problems
from handbench.bench.validation.capture_problems import (
    capture_problems,
    is_native,
    is_of_photographs,
    photo_problems,
    surface_problems,
)
from handbench.bench.validation.checks import (
    map_warnings,
    mesh_warnings,
    on_target,
    result_warnings,
)
from handbench.bench.validation.problems import Found, Problem, attempt, parse_lines, warnings_at
from handbench.calibration.array.array_file import load_array
from handbench.calibration.spheres.description import Target
from handbench.calibration.transforms import load_transform
from handbench.groundtruth.board.board import Board
from handbench.groundtruth.cameras.cameras import load_cameras
from handbench.groundtruth.mesh.surface import read_surface
from handbench.radar.data.depthmap import load_depthmap
from handbench.radar.data.echoes_file import load_capture
from handbench.support.config import Config
from handbench.support.errors import HandbenchError
from handbench.support.files import inside, read_json
from handbench.support.progress import track

# A key that identifies a TOML file that is neither benchmark nor scene.
DESCRIPTIONS: dict[str, type[Config]] = {"element": Target, "marker": Board, "charuco": Board}


def show(inputs: Sequence[str], mesh: Path | None = None, transform: Path | None = None) -> None:
    """Print every problem of every input, as "FILE:LINE: problem; what to do", and their number at
    the end.

    mesh, transform: for a depth map, the surface that it shows, and the transform of this surface
    to the radar frame. Raises HandbenchError if any problem is more than a warning.
    """
    problems = warnings = 0
    for name in inputs:
        found = dict.fromkeys(inspect(name, mesh, transform))
        for problem in found:
            print(problem)
        if not found:
            print(f"{name}: no problem found")
        warnings += sum(problem.warning for problem in found)
        problems += sum(not problem.warning for problem in found)
    counts = ((problems, "problem"), (warnings, "warning"), (len(inputs), "input"))
    counted = ", ".join(f"{count} {what}{'s' * (count > 1)}" for count, what in counts if count)
    if problems:
        raise HandbenchError(f"inspect: {counted}; correct the problems listed above")
    if warnings:
        print(f"{counted}; correct the warnings listed above, unless they are intended")


def inspect(
    name: str, mesh: Path | None = None, transform: Path | None = None
) -> Iterator[Problem]:
    """Yield all problems of an input. If none is more than a warning, its captures are also imaged,
    and warnings about the images are yielded.

    name: a path, or a benchmark's name. mesh, transform: for a depth map, the surface that it
    shows, and the transform of this surface to the radar frame.
    """
    found = list(problems_of(name, mesh, transform))
    yield from found
    if not all(problem.warning for problem in found):
        return
    texts = {problem.text for problem in found}
    for folder in (yield from _captures(Path(name))):
        warnings = yield from attempt(folder, partial(_image_warnings, folder))
        yield from (
            problem for problem in warnings_at(folder, warnings or ()) if problem.text not in texts
        )


def _image_warnings(folder: Path) -> list[str]:
    from handbench.bench.validation.capture_warnings import warnings_of_capture  # which images

    return list(warnings_of_capture(open_capture(folder)))


def _captures(path: Path) -> Found[Sequence[Path]]:
    """Return the capture folders of an input: those in a folder, or those that a benchmark names;
    none for other inputs. Yields the problem if the benchmark cannot be loaded."""
    if path.is_dir():
        other = is_of_photographs(path) or _is_result(path) or _is_raw(path)
        return () if other else captures(path)
    file = find_benchmark(str(path))
    if (
        file.suffix != ".toml"
        or "method" not in (yield from parse_lines(file, "a benchmark")).values
    ):
        return ()
    loaded = yield from attempt(file, lambda: load_benchmark(str(path)))
    if loaded is None:
        return ()
    bench, base = loaded
    return [inside(base, source.path, "capture.path") for source in bench.capture if source.path]


def _is_result(folder: Path) -> bool:
    return (folder / "result.json").is_file()


def _is_raw(folder: Path) -> bool:
    return is_ti_raw(folder) and not is_native(folder)


def problems_of(
    name: str, mesh: Path | None = None, transform: Path | None = None
) -> Iterator[Problem]:
    """Yield the problems of one input that can be found without imaging.

    name: a folder (a capture, several captures, photographs, a raw capture of a TI radar, or a
    result), the name of a benchmark, or the file of a benchmark, a scene, a target, a
    board, a depth map, a mesh, echoes, cameras, an array's calibration or a transform. mesh,
    transform: for a depth map, the surface that it shows, and the transform of this surface to the
    radar frame.
    """
    path = Path(name)
    if path.is_dir():
        yield from _folder(path)
        return
    try:
        path = path if path.suffix.lower() == ".npz" else find_benchmark(name)
    except HandbenchError as error:
        yield Problem(path, None, str(error))
        return
    suffix = path.suffix.lower()
    if suffix == ".npz":
        yield from _depth_map(path, mesh, transform)
    elif suffix in (".ply", ".obj", ".stl"):
        surface = yield from surface_problems(path)
        yield from warnings_at(path, mesh_warnings(surface) if surface else ())
    elif suffix in (".h5", ".json"):
        yield from attempt(path, partial(load_capture if suffix == ".h5" else _read_json, path))
    elif suffix == ".xml":
        command = f"handbench groundtruth PHOTOS --cameras {path} -o MESH.ply"
        yield Problem(
            path, None, (f"inspect does not read .xml files; {command} checks cameras of Metashape")
        )
    else:
        yield from _description(path)


def _folder(path: Path) -> Iterator[Problem]:
    """Yield the problems of a folder. Prints what a single capture can be used for."""
    if _is_result(path):
        from handbench.bench.results.result_folder import load as load_result  # with scipy

        result = yield from attempt(path, partial(load_result, path))
        yield from warnings_at(path, result_warnings(result) if result else ())
    elif is_native(path):
        facts = yield from capture_problems(path, scored=False)
        if facts.use:
            print(f"{path}: {facts.use}")
    elif is_of_photographs(path):
        yield from photo_problems(path, scaled=False)
    elif is_ti_raw(path):
        yield from attempt(path, partial(read_raw, path, {}))
    else:
        folders = yield from attempt(path, lambda: captures(path))
        names: dict[str, Path] = {}
        for folder in track(folders or (), "captures"):
            facts = yield from capture_problems(folder, scored=False)
            if (
                facts.about is not None
                and (other := names.setdefault(facts.about.name, folder)) != folder
            ):
                text = (
                    f"has the name '{facts.about.name}', as {other} has, but a benchmark needs "
                    "different names; rename one of them"
                )
                yield Problem(folder / DESCRIPTION, None, text, warning=True)


def _depth_map(path: Path, mesh: Path | None, transform: Path | None) -> Iterator[Problem]:
    """Yield the problems of a depth map's file. If a surface is given, the map is also compared
    with it. Prints how many pixels have a depth."""
    depth = yield from attempt(path, partial(load_depthmap, path))
    if depth is None:
        return
    print(f"{path}: {depth.method}, {depth.z_m.size} pixels, {on_target(depth)}")
    yield from warnings_at(path, map_warnings(depth))
    surface = None if mesh is None else (yield from attempt(mesh, partial(read_surface, mesh)))
    carried = yield from attempt(transform or path, partial(load_any_transform, transform))
    if surface is not None and carried is not None:
        from handbench.bench.validation.mistakes import misplacement_warnings

        yield from warnings_at(path, misplacement_warnings(depth, surface.moved(carried)))


def _read_json(path: Path) -> Any:
    """Read a JSON file with cameras, an array's calibration or a transform. Raises HandbenchError
    if it is invalid."""
    content = read_json(path, "cameras, an array's calibration or a transform")
    keys = content.keys() if isinstance(content, dict) else set()
    if "cameras" in keys:
        return load_cameras(path)
    if keys & {"tx", "rx"}:
        return load_array(path)
    return load_alignment(path) if path.name == ALIGNMENT else load_transform(path)


def _description(path: Path) -> Iterator[Problem]:
    """Yield the problems of a TOML file, which may describe a scene, a calibration target, a board
    or a benchmark."""
    found = yield from parse_lines(path, "a benchmark or a scene")
    if found.values is None:
        return
    kind = next((kind for key, kind in DESCRIPTIONS.items() if key in found.values), None)
    if "target" in found.values:
        yield from scene_problems(path)
    elif kind is not None:
        yield from found.complaints(kind, found.values)
    else:
        yield from benchmark_problems(found)
