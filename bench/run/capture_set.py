"""Simulate the captures of a benchmark into one folder that can be given to others. It has:

bench.toml      the benchmark with these captures in place of scenes, for `handbench run`
captures/NAME   capture folders
"""

from pathlib import Path
from typing import Any

import tomlkit

from handbench.bench.benchmarks.benchmark_file import BenchFile, Origin, load_benchmark, scene_of
from handbench.bench.datasets.simulated import simulate_capture
from handbench.bench.scenes.build import build
from handbench.bench.scenes.scene_file import SceneFile
from handbench.support.errors import HandbenchError
from handbench.support.files import write_text
from handbench.support.progress import counted
from handbench.support.store import drop, is_owned_folder

BENCH, CAPTURES = "bench.toml", "captures"


def simulate_benchmark(name: str, folder: Path, overwrite: bool) -> int:
    """Simulate all scenes of a benchmark into a folder that can be distributed; return their
    number.
    name: a benchmark file, or the name of a benchmark that is installed with handbench. Captures
    that an earlier call for the same benchmark finished are kept. overwrite: replace the captures
    in the folder, each when the new one is complete. Raises HandbenchError if the benchmark has a
    capture that is not a scene, or if the folder has other files."""
    bench, base = load_benchmark(name)
    sources: list[Origin] = [*bench.capture, *bench.calibration]
    scenes: dict[str, tuple[SceneFile, Path, int]] = {}
    for source in sources:
        if source.scene is None:
            raise HandbenchError(
                f"{name}: has the recorded capture {source.path}, but only scenes can be "
                "simulated; leave this capture out"
            )
        scene, file = scene_of(bench, base, source)
        if scene.name in scenes:
            raise HandbenchError(
                f"{name}: two captures are named '{scene.name}'; give each its own name"
            )
        scenes[scene.name] = scene, file.parent, bench.frames_of(source)
    file, captures = folder / BENCH, folder / CAPTURES
    text = _of_captures(bench, name, list(scenes))
    _require_set(folder, text, overwrite)
    if not file.is_file():  # by which a later call knows whose captures these are
        write_text(file, text)
    wanted = [name for name in scenes if overwrite or not (captures / name).is_dir()]
    with counted(len(wanted)) as progress:
        for capture in wanted:
            scene, place, frames = scenes[capture]
            with progress.part(capture):
                simulate_capture(build(scene, place), captures / capture, frames)
    if overwrite:
        write_text(file, text)
        drop(captures, [path.name for path in captures.glob("[!.]*") if path.name not in scenes])
    return len(scenes)


def _of_captures(bench: BenchFile, name: str, captures: list[str]) -> str:
    """Return the text of the benchmark file in which capture folders replace the scenes.
    name: of the original benchmark, for error messages; captures: names of the folders. Raises
    HandbenchError for a benchmark with a method that is not part of handbench."""
    if any(entry.foreign for entry in bench.method):
        raise HandbenchError(
            f"{name}: has a method with maps or a command, which cannot be simulated; add the "
            "method to the benchmark file that is written"
        )
    content: dict[str, Any] = bench.model_dump(
        mode="json", exclude_none=True, exclude_defaults=True
    )
    content.pop("phase_noise_rad", None)  # it is in the echoes
    paths = [f"{CAPTURES}/{capture}" for capture in captures]
    content["capture"] = [
        {"path": path, "measures": list(source.measures)}
        for path, source in zip(paths, bench.capture, strict=False)
    ]
    if bench.calibration:
        content["calibration"] = [{"path": path} for path in paths[len(bench.capture) :]]
    return tomlkit.dumps(content)


def _require_set(folder: Path, text: str, overwrite: bool) -> None:
    """Raise HandbenchError if a folder has anything but a set of captures whose benchmark file is
    `text` or, with `overwrite`, of any benchmark; or if something in it is a link."""
    file = folder / BENCH
    same = file.is_file() and (overwrite or file.read_text("utf-8", "replace") == text)
    if folder.exists() and any(folder.iterdir()) and not same:
        raise HandbenchError(
            f"{folder}: has files of something else; choose another folder for -o, or use "
            "--overwrite to replace a set of captures"
        )
    is_owned_folder(folder / CAPTURES)
