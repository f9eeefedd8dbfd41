"""Inspection of any file or folder that handbench reads, which reports all problems at once."""

import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from handbench.bench.benchmarks.benchmark_file import find_benchmark
from handbench.bench.datasets.dataset import captures, has_capture
from handbench.bench.datasets.maroon_alignment import load_any_transform
from handbench.bench.datasets.native import DESCRIPTION, ECHOES, TRANSFORM, NativeCapture
from handbench.bench.datasets.ti import is_ti_raw, raw_warnings, read_raw
from handbench.bench.stages.image import configured
from handbench.bench.validation.benchmarks import inspect_benchmark, inspect_scene
from handbench.bench.validation.captures import inspect_capture, inspect_photos
from handbench.bench.validation.checks import CHANNELS, MAP, MESH, result_warnings
from handbench.bench.validation.report import Report
from handbench.calibration.array_file import load_array
from handbench.calibration.target import load_target
from handbench.groundtruth.board import load_board
from handbench.groundtruth.cameras import load_cameras
from handbench.groundtruth.mesh.surface import read_surface
from handbench.groundtruth.pictures import SUFFIXES
from handbench.radar.data.depthmap import load_depthmap
from handbench.radar.data.echoes_file import load_capture
from handbench.radar.methods.ability import abilities, methods_of_tones
from handbench.radar.methods.evidence import frame_problems
from handbench.support.config import read_toml
from handbench.support.errors import HandbenchError
from handbench.support.files import read_json
from handbench.support.progress import is_terminal, print_lines, print_wrapped, track

# what reads a file, and the checks of its content: by the end of its name, or by a key in it
READERS: dict[str, tuple[Callable[[Path], Any], tuple[Callable[[Any], Iterator[str]], ...]]] = {
    ".npz": (load_depthmap, MAP),
    ".h5": (load_capture, CHANNELS),
    **dict.fromkeys((".ply", ".obj", ".stl"), (read_surface, MESH)),
    "cameras": (load_cameras, ()),
    **dict.fromkeys(("tx", "rx"), (load_array, ())),
    "element": (load_target, ()),
    **dict.fromkeys(("marker", "charuco"), (load_board, ())),
}
PAPER = ("2fsk", "3fsk", "narrowband", "broadband")
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
    recorded = report.read(path, partial(read, path, report)) or ()
    if recorded and all(report.lines.values()):
        from handbench.bench.validation.capture_warnings import capture_warnings  # which images

        for capture in track(recorded, "images"):
            warnings = capture_warnings(capture)
            report.read(capture.folder, partial(report.warn, capture.folder, warnings))
    return report


def _inspect_file(path: Path, report: Report) -> list[NativeCapture]:
    """Inspect a file or an installed benchmark, and return the captures that a benchmark names."""
    suffix = path.suffix.lower()
    kinds: Any = [suffix]
    if suffix not in READERS:
        file = find_benchmark(str(path))
        is_json = suffix == ".json"
        kinds = read_json(file, JSON) if is_json else read_toml(file, "a benchmark or a scene")
        if "target" in kinds:
            inspect_scene(file, report)
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
        from handbench.bench.results.result_folder import load as load_result  # with scipy

        report.check(path, load_result(path), (result_warnings,))
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
            if len(folders) == 1:
                of_methods = {id: configured(capture.about, id, {}) for id in PAPER}
                report.notes += abilities(echoes, capture.about.distance_m or HAND_M)
                report.notes += methods_of_tones(echoes, of_methods)
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
