"""Inspection of benchmark and scene files, and of everything that they name."""

from functools import partial
from itertools import chain
from pathlib import Path

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
from handbench.bench.datasets.native import PHOTOS, TARGET, CaptureFile, NativeCapture
from handbench.bench.scenes.scene_file import SceneFile, named_files
from handbench.bench.stages.image import configured, prepare, required_frames
from handbench.bench.validation.captures import inspect_capture, require_reference
from handbench.bench.validation.report import Report
from handbench.calibration.target import load_target
from handbench.groundtruth.mesh.surface import read_triangles
from handbench.radar.data.arrays import AntennaArray, load_positions
from handbench.radar.data.capture import RadarCapture
from handbench.radar.methods.evidence import needed_tones
from handbench.radar.methods.registry import method
from handbench.support.config import load
from handbench.support.errors import HandbenchError
from handbench.support.files import real
from handbench.support.progress import track


def inspect_scene(path: Path, report: Report) -> SceneFile | None:
    """Read a scene file and the files that it names, and report their problems. Returns its
    content; None if it is wrong."""
    scene = report.read(path, partial(load, SceneFile, path, "a scene description"))
    if scene is None:
        return None

    for file in report.read(path, partial(named_files, scene, path.parent)) or ():
        if file.is_dir():
            for name in ("tx_m.csv", "rx_m.csv"):
                report.read(path, partial(load_positions, file / name))
        else:
            read = load_target if file.suffix == ".toml" else read_triangles
            report.read(path, partial(read, file))
    return scene


def inspect_benchmark(name: str, report: Report) -> list[NativeCapture]:
    """Read a benchmark file with everything that it names, and report the problems of all methods
    and captures. name: as for `find_benchmark`. Returns the captures that can be read."""
    path = find_benchmark(name)
    bench = report.read(path, partial(load, BenchFile, path, "a benchmark description"))
    if bench is None:
        return []
    read = partial(report.read, path)
    entries = [entry for entry in bench.method if read(partial(checked_entry, entry, path))]
    methods = read(partial(expanded, entries, path)) or ()
    bench = bench.model_copy(update={"method": methods})
    for origin in bench.calibration:
        read(partial(_inspect_target, path.parent, origin, report))
    sets = (read(partial(each.sources, path.parent)) or () for each in bench.dataset or ())
    recorded: dict[str, NativeCapture | None] = {}
    for source in track([*bench.capture, *chain(*sets)], "captures"):
        opened = read(partial(_inspect_source, bench, path, source, report))
        for name, capture in (opened or {}).items():
            read(partial(require_clear, name, f"capture '{name}'"))
            if name in recorded:
                report.refuse(path, f"two captures are named '{name}'; give each its own name")
            recorded[name] = capture
    return [capture for capture in recorded.values() if capture is not None]


def _inspect_target(base: Path, origin: Origin, report: Report) -> None:
    """Read a capture or scene for a benchmark's calibration, and report its problems. base: folder
    of the benchmark file."""
    if origin.scene is not None:
        inspect_scene(real(base, origin.scene, "calibration.scene"), report)
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
    if source.path is not None:
        folder = real(path.parent, source.path, "capture.path")
        opened = inspect_capture(folder, report, bench.frames_of(source))
        if opened is None:
            return {}
        recorded, echoes = opened
        about, names = recorded.about, [recorded.about.name]
        if "accuracy" in source.measures:
            report.read(path, partial(require_reference, recorded, bool(bench.calibration)))
    else:
        file = real(path.parent, source.scene or "", "capture.scene")
        if inspect_scene(file, report) is None:
            return {}
        scenes = [scene_of(bench, path.parent, one)[0] for one in source.each()]
        names = [scene.name for scene in scenes]
        about, echoes = CaptureFile(name=names[0]), _echoes_of(scenes[0], bench.frames_of(source))
    for entry in bench.method:
        where = f"{path}: capture '{about.name}' with method '{entry.label}'"
        if entry.maps is not None and "accuracy" in source.measures:
            for name in names:
                map_of = partial(_require_map, bench, path.parent / entry.maps / f"{name}.npz")
                report.read(where, partial(map_of, entry, about))
        if not entry.foreign and ("accuracy" in source.measures or entry.precision):
            frames = bench.frames if "accuracy" in source.measures else 1
            report.read(where, partial(_require_imaged, entry, about, echoes, frames))
    return dict.fromkeys(names, recorded)


def _echoes_of(scene: SceneFile, frames: int) -> RadarCapture:
    """Return echoes with the tones and times of a scene, and without a signal."""
    tones_hz = np.asarray(scene.sensor.frequencies_hz)
    one = np.zeros((1, 3))
    return RadarCapture(
        np.zeros((frames, len(tones_hz), 1, 1), np.complex64),
        tones_hz,
        AntennaArray(one, one),
        times_s=scene.sensor.step_time_s * np.arange(len(tones_hz)),
    )


def _require_imaged(
    entry: MethodEntry, about: CaptureFile, echoes: RadarCapture, frames: int
) -> None:
    """Raise HandbenchError if a method cannot image the first frames of a capture."""
    settings = configured(about, entry.id, entry.config)
    if echoes.samples.any():
        needed = required_frames(echoes, frames)
        prepare(echoes, method(entry.id), settings, needed, entry.every_nth_antenna)
    else:  # a scene's, before it is simulated
        needed_tones(echoes, settings)


def _require_map(bench: BenchFile, file: Path, entry: MethodEntry, about: CaptureFile) -> None:
    """Raise HandbenchError if a run would refuse the depth map of a foreign method."""
    from handbench.bench.stages.foreign import pixels, read_map  # whose module images

    read_map(file, entry.id, pixels(about, bench.method))
