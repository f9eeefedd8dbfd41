"""Inspection of any file or folder that handbench reads, which reports all problems at once."""

import shutil
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from handbench.bench.benchmarks.benchmark_file import (
    BenchFile,
    MethodEntry,
    Origin,
    Source,
    checked_entry,
    expanded,
    find_benchmark,
    require_clear,
    scene_of,
)
from handbench.bench.datasets.dataset import captures, has_capture, load_any_transform
from handbench.bench.datasets.native import (
    DESCRIPTION,
    ECHOES,
    MAPPING,
    PHOTOS,
    TARGET,
    TRANSFORM,
    CaptureFile,
    NativeCapture,
)
from handbench.bench.datasets.ti import is_ti_raw, raw_warnings, read_raw
from handbench.bench.scenes.scene_file import SceneFile
from handbench.bench.stages.image import configured, point_echoes, prepare, required_frames
from handbench.bench.validation.captures import inspect_capture, inspect_photos, require_reference
from handbench.bench.validation.checks import CHANNELS, MAP, MESH, Report, result_warnings
from handbench.calibration.array_file import load_array
from handbench.calibration.target import load_target
from handbench.groundtruth.board import load_board
from handbench.groundtruth.camera_files import cameras_of
from handbench.groundtruth.cameras import load_cameras
from handbench.groundtruth.mesh.surface import read_surface
from handbench.groundtruth.pictures import SUFFIXES
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.depthmap import DepthMap, load_depthmap
from handbench.radar.data.echoes_file import load_capture
from handbench.radar.methods.ability import abilities, further_settings
from handbench.radar.methods.evidence import frame_problems
from handbench.radar.methods.fsk import Fsk, FskEchoes
from handbench.radar.methods.registry import method
from handbench.support.config import inline_toml, load, read_toml
from handbench.support.errors import HandbenchError
from handbench.support.files import read_json, real
from handbench.support.progress import is_terminal, print_lines, print_wrapped, track

if TYPE_CHECKING:
    from handbench.bench.scenes.build import Scene

# what reads a file, and the checks of its content: by the end of its name, or by a key in it
READERS: dict[str, tuple[Callable[[Path], Any], tuple[Callable[[Any], Iterator[str]], ...]]] = {
    ".npz": (load_depthmap, MAP),
    ".h5": (load_capture, CHANNELS),
    **dict.fromkeys((".ply", ".obj", ".stl"), (read_surface, MESH)),
    "cameras": (lambda path: cameras_of(load_cameras(path), path), ()),
    **dict.fromkeys(("tx", "rx"), (load_array, ())),
    "element": (load_target, ()),
    **dict.fromkeys(("marker", "charuco"), (load_board, ())),
}
OFFERED = ("2fsk", "3fsk", "narrowband", "broadband", "nfsk", "joint")
FIRST = "first_depth_m"  # a method's key that may be "auto"
HAND_M = 0.3  # depth for which a resolution is given, if the description has none
JSON = "cameras, an array's calibration or a transform"


def show(inputs: Sequence[str]) -> None:
    """Print every problem and warning of every input, and their number at the end. A terminal shows
    long ones broken between words. Raises HandbenchError if there are problems."""
    counts = Counter({"input": len(inputs)})
    for name in inputs:
        report = inspect(name)
        notes = [f"{name}: {note}" for note in report.notes if all(report.lines.values())]
        for line in [*(report.lines or [f"{name}: no problem found"]), *notes]:
            if is_terminal(sys.stdout):
                print_wrapped(line, "    ")
            else:
                print_lines(line)
        counts.update("warning" if warning else "problem" for warning in report.lines.values())
    kinds = [kind for kind in ("problem", "warning", "input") if counts[kind]]
    counted = ", ".join(f"{counts[kind]} {kind}{'s' * (counts[kind] > 1)}" for kind in kinds)
    if counts["problem"]:
        raise HandbenchError(f"inspect: {counted}; correct the problems")
    if counts["warning"]:
        print_lines(f"{counted}; correct what is not intended")


def inspect(name: str) -> Report:
    """Read an input as a run would, and report its problems and warnings. If it has no problem, its
    captures are also imaged, which shows further mistakes.

    name: a folder (a capture, several captures, photographs, a raw capture of a TI radar, or a
    result), the name of a benchmark, or the file of a benchmark, a scene, a target, a board, a
    depth map, a mesh, echoes, cameras, an array's calibration or a transform.
    """
    report, path = Report(), Path(name)
    read = _inspect_folder if path.is_dir() else _inspect_file
    recorded = report.read(path, read, path, report) or ()
    if recorded and all(report.lines.values()):
        from handbench.bench.validation.capture_warnings import capture_warnings  # which images

        for capture in track(recorded, "images"):
            warnings = capture_warnings(capture)
            report.read(capture.folder, report.warn, capture.folder, warnings)
    return report


def _inspect_file(path: Path, report: Report) -> list[NativeCapture]:
    """Inspect a file or an installed benchmark, and return the captures that a benchmark names."""
    suffix = path.suffix.lower()
    kinds: Any = [suffix]
    if suffix not in READERS:
        file = find_benchmark(str(path))
        is_json = suffix == ".json"
        found = read_json(file, JSON) if is_json else read_toml(file, "a benchmark or a scene")
        kinds = found if isinstance(found, dict) else ()
        if "target" in kinds:
            _inspect_scene(file)
            return []
    known = [READERS[kind] for kind in READERS if kind in kinds]
    if not known and suffix != ".json":
        return inspect_benchmark(str(path), report)
    reader, checks = known[0] if known else (load_any_transform, ())
    report.check(path, reader(path), checks)
    return []


def _inspect_folder(path: Path, report: Report) -> list[NativeCapture]:
    """Inspect a folder, and return its captures that can be read."""
    native = (path / ECHOES).exists()
    if (path / "result.json").is_file():
        from handbench.bench.results import maps, result_folder  # with scipy

        result = result_folder.load(path)
        report.warn(path, result_warnings(result))
        for file, name in result_folder.map_files(result).items():
            report.read(file, maps.read_map, file, name)
    elif native or has_capture(path):
        return _inspect_captures([path] if native else captures(path), report)
    elif is_ti_raw(path):
        profile, samples = read_raw(path, {})
        report.warn(path, [*raw_warnings(profile, samples), *frame_problems(samples)])
    elif any(file.suffix.lower() in SUFFIXES for file in path.iterdir()):
        inspect_photos(path, report, scaled=False)
    else:
        captures(path)
    return []


def _inspect_captures(folders: Sequence[Path], report: Report) -> list[NativeCapture]:
    """Inspect captures, and return those that can be read."""
    recorded: dict[str, NativeCapture] = {}
    for folder in track(folders, "captures"):
        if opened := inspect_capture(folder, report):
            capture, echoes = opened
            if len(folders) == 1 and all(report.lines.values()):
                report.notes += abilities(echoes, capture.about.distance_m or HAND_M)
                _inspect_methods(capture.about, echoes, report, folder)
            if capture.truth is None and capture.mesh() and not capture.transform():
                report.warn(folder, [f"has a mesh, but no {TRANSFORM} to compare depths with it"])
            other = recorded.setdefault(capture.about.name, capture)
            if other != capture:
                text = (
                    f"has the name '{capture.about.name}', as {other.folder} has, but a benchmark "
                    "needs different names; rename one of them"
                )
                report.warn(folder / DESCRIPTION, [text])
    return list(recorded.values())


def _built(scene: SceneFile, folder: Path) -> "Scene":
    """Build a scene and choose its effects, as its simulation does before its long work. folder: of
    the files that the scene names. Raises HandbenchError if it cannot be simulated."""
    from handbench.bench.scenes.build import build  # with Open3D
    from handbench.bench.scenes.echoes import echo_scene
    from handbench.radar.simulation.catalogue import choose

    placed = build(scene, folder)
    choose(echo_scene(placed), scene.effects)
    return placed


def _inspect_scene(path: Path) -> None:
    """Raise HandbenchError for a scene file that cannot be simulated."""
    _built(load(SceneFile, path, "a scene description"), path.parent)


def inspect_benchmark(name: str, report: Report) -> list[NativeCapture]:
    """Read a benchmark file with everything that it names, and report the problems of all methods
    and captures. name: as for `find_benchmark`. Returns the captures that can be read."""
    from handbench.bench.stages.foreign import words  # whose module images

    path = find_benchmark(name)
    bench = report.read(path, load, BenchFile, path, "a benchmark description")
    if bench is None:
        return []
    read = partial(report.read, path)
    entries = [entry for entry in bench.method if read(checked_entry, entry, path)]
    for entry in entries:
        if entry.command and not shutil.which(program := words(entry.command, path.parent)[0]):
            text = f"its command '{program}' is not an installed program; give its path"
            report.refuse(path, f"method '{entry.label}': {text}")
    methods = read(expanded, entries, path) or ()
    bench = bench.model_copy(update={"method": methods})
    for origin in bench.calibration:
        read(_inspect_target, path.parent, origin, report)
    sets = (read(each.sources, path.parent) or () for each in bench.dataset or ())
    recorded: dict[str, NativeCapture | None] = {}
    for source in track([*bench.capture, *chain(*sets)], "captures"):
        opened = read(_inspect_source, bench, path, source, report)
        for name, capture in (opened or {}).items():
            read(require_clear, name, f"capture '{name}'")
            if name in recorded:
                report.refuse(path, f"two captures are named '{name}'; give each its own name")
            recorded[name] = capture
    return [capture for capture in recorded.values() if capture is not None]


def _inspect_target(base: Path, origin: Origin, report: Report) -> None:
    """Read a capture or scene for a benchmark's calibration, and report its problems. base: folder
    of the benchmark file."""
    if origin.scene is not None:
        file = real(base, origin.scene, "calibration.scene")
        report.read(file, _inspect_scene, file)
        return
    folder = real(base, origin.path or "", "calibration.path")
    inspect_capture(folder, report, 1)
    missing = [name for name in (TARGET, PHOTOS) if not (folder / name).exists()]
    if missing:
        raise HandbenchError(
            f"the capture for the calibration, {folder}, has no {', '.join(missing)}; add what is "
            "missing"
        )


def _inspect_source(
    bench: BenchFile, path: Path, source: Source, report: Report
) -> dict[str, NativeCapture | None]:
    """Read a capture or scene of a benchmark, and report its problems, also with each method.
    path: the benchmark file. Returns the capture by its name; the name of a scene, or the names of
    its persons, lead to None."""
    recorded: NativeCapture | None = None
    accurate = "accuracy" in source.measures
    if source.path is not None:
        folder = real(path.parent, source.path, "capture.path")
        opened = inspect_capture(folder, report, bench.frames_of(source))
        if opened is None:
            return {}
        recorded, echoes = opened
        about, names = recorded.about, [recorded.about.name]
        if accurate:
            report.read(path, require_reference, recorded, bool(bench.calibration))
    else:
        file = real(path.parent, source.scene or "", "capture.scene")
        scenes = [scene_of(bench, path.parent, one)[0] for one in source.each()]
        names = [scene.name for scene in scenes]
        scene = report.read(file, _built, scenes[0], file.parent)
        if scene is None:
            return {}
        about, sensor = CaptureFile(name=names[0]), scene.file.sensor
        times_s = sensor.step_time_s * np.arange(len(sensor.frequencies_hz))
        distance_m = scene.file.target.distance_m
        echoes = point_echoes(scene.array, sensor.frequencies_hz, distance_m, times_s)
    for entry in bench.method:
        where = f"{path}: capture '{about.name}' with method '{entry.label}'"
        if entry.maps is not None and accurate:
            for file in (path.parent / entry.maps / f"{name}.npz" for name in names):
                depth = report.read(where, _map, bench, file, entry, about)
                report.check(file, depth, MAP)
                if depth and recorded and (surface := recorded.surface()):
                    from handbench.bench.validation.capture_warnings import mirror_warnings

                    report.warn(file, mirror_warnings(depth, surface))
        if not entry.foreign and (accurate or entry.precision):
            frames = bench.frames if recorded and accurate else 1
            chosen = entry.id, entry.config, frames, entry.every_nth_antenna
            report.read(where, _require_imaged, about, echoes, *chosen)
    return dict.fromkeys(names, recorded)


def _require_imaged(
    about: CaptureFile,
    echoes: RadarCapture,
    id: str,
    config: dict[str, Any],
    frames: int = 1,
    every_nth_antenna: int = 1,
) -> None:
    """Raise HandbenchError if a method cannot image the first frames of a capture."""
    settings = configured(about, id, config)
    needed = required_frames(echoes, frames)
    task = prepare(echoes, method(id), settings, needed, every_nth_antenna)
    if isinstance(settings, Fsk):
        FskEchoes.of(task.echoes, settings, 0)  # finds the first depth, if it is "auto"


def _inspect_methods(about: CaptureFile, echoes: RadarCapture, report: Report, place: Path) -> None:
    """Note which methods can image a capture, and which could with other settings in its
    description. Report a problem if none can."""
    allowed: list[str] = []
    offers: list[str] = []
    problem = ""
    measured = further_settings(echoes.frequencies_hz)
    for id in OFFERED:
        own = measured.get(id, {})
        for config in ({}, own, own | {FIRST: about.distance_m or HAND_M}):
            try:
                _require_imaged(about, echoes, id, config)
            except HandbenchError as error:
                problem = problem or str(error)
                continue
            given = {key: inline_toml(value) for key, value in config.items()}
            if config.get(FIRST) != own.get(FIRST):
                given[FIRST] = "DISTANCE"
            text = " and ".join(f"{key} = {value}" for key, value in given.items())
            needs = (
                f"{id} needs below [methods.{id}] of {DESCRIPTION}, or [capture.methods.{id}] of "
                f"{MAPPING}: {text}"
            )
            offers.append(needs) if config else allowed.append(id)
            break
    report.notes += offers
    if allowed:
        report.notes.append(f"methods that its tones allow as they are: {', '.join(allowed)}")
    elif not offers:
        report.refuse(place, f"no method can image it as it is ({problem})")


def _map(bench: BenchFile, file: Path, entry: MethodEntry, about: CaptureFile) -> DepthMap:
    """Read the depth map of a foreign method. Raises HandbenchError if a run would refuse it."""
    from handbench.bench.stages.foreign import pixels, read_map  # whose module images

    return read_map(file, entry.id, pixels(about, bench.method))[0]
