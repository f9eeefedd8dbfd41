"""Functions that describe the stages of a benchmark: for each stage its inputs, its arguments, and
the function that executes it.

The stages of a run form rounds. `opening` and `inspection` make every capture available and check
it. `clouds` reconstructs photographs in two rounds, first cameras (sparse), then point clouds
(dense). The stages of `calibration`, `meshing` and `imaging` do not depend on each other. `scoring`
comes last, for captures with a reference.
"""

from pathlib import Path
from pkgutil import resolve_name
from typing import Any

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.pipeline.image import configured
from handbench.bench.results import REFERENCES
from handbench.bench.run import (
    calibrate_stage,
    foreign,
    reconstruct_stage,
    repeat_stage,
    simulate_stage,
)
from handbench.bench.run.benchmark_file import BenchFile, MethodEntry, Origin, Source
from handbench.bench.run.executors import HASH
from handbench.bench.run.outcome import Outcome, RunCapture
from handbench.bench.run.photogrammetry import photographs
from handbench.bench.run.scoring import make as score
from handbench.bench.scenes.build import named_files
from handbench.bench.scenes.scene_file import SceneFile
from handbench.calibration.transforms import Transform, identity
from handbench.groundtruth import pipeline
from handbench.groundtruth.dense_stage import CLOUD
from handbench.groundtruth.mesh_stage import MESH, VIEW
from handbench.groundtruth.options import Quality
from handbench.radar.imaging.device import current_device
from handbench.radar.methods.registry import method_key
from handbench.radar.simulation.causes import Noise
from handbench.support.config import load, suggest
from handbench.support.errors import HandbenchError
from handbench.support.files import content_hash, inside
from handbench.support.store import Stage

# by name: its room checks benchmark files too, so it imports this one
INSPECT = "handbench.bench.validation.capture_warnings:make"
Clouds = tuple[Stage, Stage, Stage]  # sparse, dense and mesh of one capture's photographs


def opening(
    bench: BenchFile, base: Path, source: Origin, frames: int, photos: bool = True
) -> Stage:
    """Return the stage that makes a capture available: it hashes a capture folder, or simulates a
    scene.
    base: folder to which the benchmark's paths are relative. frames: how many frames are needed.
    photos: whether a later stage needs the photographs of the scene."""
    if source.path is not None:
        folder = inside(base, source.path, "capture.path")
        given = {"folder": str(folder), "frames": frames}
        return Stage(HASH, content_key, given, [], open_capture(folder).about.name)
    scene, path = scene_of(bench, base, source)
    if not photos:
        scene = scene.model_copy(update={"photos": None})
    given = {"scene": scene.model_dump(mode="json"), "base": str(path.parent), "frames": frames}
    inputs = [given["scene"], frames, *named_files(scene, path.parent)]
    return Stage("simulate", simulate_stage.simulate, given, inputs, scene.name)


def content_key(root: Path, stage: Stage) -> str:
    """Return the hash of a capture folder's content.
    root: not used; stage: has the folder and the number of frames as arguments."""
    return open_capture(stage.arguments["folder"]).key(stage.arguments["frames"])


def scene_of(bench: BenchFile, base: Path, source: Origin) -> tuple[SceneFile, Path]:
    """Read the scene of a benchmark's capture, and apply the changes that the benchmark makes to
    it: `set`, person, phase noise, no photographs. Returns the scene and its file.
    base: folder to which the benchmark's paths are relative."""
    path = inside(base, source.scene or "", "capture.scene")
    scene = load(SceneFile, path, "a scene description")
    if isinstance(source, Source) and source.suffix:
        scene = scene.varied(source.set, source.suffix)
    if isinstance(source, Source) and source.persons:
        scene = scene.of_person(*source.persons)
    if bench.phase_noise_rad is not None:
        scene = scene.model_copy(update={"noise": Noise(phase_noise_rad=bench.phase_noise_rad)})
    if not source.photos:
        scene = scene.model_copy(update={"photos": None})
    return scene, path


def inspection(capture: RunCapture) -> Stage:
    """Return the stage that checks a capture for likely mistakes before its data are used."""
    given = {"capture": str(capture.folder)}
    return Stage("inspect", resolve_name(INSPECT), given, [capture.key], capture.name)


def clouds(capture: RunCapture, quality: Quality, seed: int, work: Path) -> Clouds:
    """Return the three stages that reconstruct a capture's photographs: cameras (sparse), point
    cloud (dense) and mesh.
    quality, seed: of the reconstruction; work: folder of all stages. Raises HandbenchError if the
    capture has no photographs."""
    photos, options = photographs(capture.folder, quality, seed)
    return pipeline.stages(work, photos, options, [capture.key], capture=capture.name)


def calibration(targets: list[RunCapture], dense: list[Stage], work: Path) -> Stage:
    """Return the stage that computes the transform from the photo frame to the radar frame.
    targets: captures of one calibration target; dense: for each capture, the stage that makes the
    point cloud of its photographs; work: folder of all stages."""
    given = {
        "captures": [str(target.folder) for target in targets],
        "clouds": [str(each.folder(work) / CLOUD) for each in dense],
    }
    inputs = [*(target.key for target in targets), *(each.key for each in dense)]
    return Stage("calibrate", calibrate_stage.calibrate, given, inputs, targets[0].name)


def meshing(bench: BenchFile, capture: RunCapture, work: Path) -> Clouds | None:
    """Return the three stages (sparse, dense, mesh) that turn the photographs of a capture into a
    mesh.
    work: folder of all stages. Returns None if the capture has no photographs, if it has a mesh
    already, or if neither the capture nor the benchmark gives a transform into the radar frame."""
    data = open_capture(capture.folder)
    carried = bool(bench.calibration) or data.transform() is not None
    return (
        clouds(capture, bench.groundtruth.quality, bench.seed, work)
        if carried and data.photos is not None and data.mesh() is None
        else None
    )


def imaging(bench: BenchFile, base: Path, capture: RunCapture, entry: MethodEntry) -> list[Stage]:
    """Return the stages that image a capture by one method.
    For the accuracy, one stage images the first `frames` frames of the benchmark. For the
    precision, another images `repeats` frames, if both the capture and the method measure it. base:
    folder to which the benchmark's paths are relative."""
    if entry.foreign:
        return [_foreign(bench, base, capture, entry)] if "accuracy" in capture.measures else []
    given = {
        "capture": str(capture.folder),
        "method": entry.id,
        "config": configured(capture.about, entry.id, entry.config).model_dump(mode="json"),
        "device": current_device(),
        "every_nth_antenna": entry.every_nth_antenna,
    }
    inputs = [capture.key, given["config"], given["device"], entry.every_nth_antenna]
    wanted = (
        [("reconstruct", reconstruct_stage.reconstruct, bench.frames)]
        if "accuracy" in capture.measures
        else []
    )
    if "precision" in capture.measures and entry.precision:
        wanted.append(("repeat", repeat_stage.repeat, bench.repeats))
    about = capture.name, entry.id, method_key(entry.id)
    return [
        Stage(name, function, {**given, "frames": frames}, [*inputs, frames], *about)
        for name, function, frames in wanted
    ]


def _foreign(bench: BenchFile, base: Path, capture: RunCapture, entry: MethodEntry) -> Stage:
    """Return the stage that obtains the depth map of a foreign method, which is not part of
    handbench: it reads the file of the map, or runs the command of the method.
    base: folder to which the benchmark's paths are relative. Raises HandbenchError if the file is
    missing."""
    grid = foreign.pixels(capture.about, bench.method)
    function = foreign.run if entry.command is not None else foreign.take
    given: dict[str, Any] = {"method": entry.id, "x_m": grid.x_m, "y_m": grid.y_m}
    if entry.command is not None:
        key = foreign.program_key(entry.command, base)
        given |= {"capture": str(capture.folder), "command": foreign.words(entry.command, base)}
        given |= {"limit_s": entry.limit_s or foreign.LIMIT_S, "config": {"command": entry.command}}
    else:
        folder = inside(base, entry.maps or "", "method.maps")
        file = inside(folder, f"{capture.name}.npz", "method.maps")
        if not file.is_file():
            there = suggest(capture.name, [found.stem for found in folder.glob("*.npz")]) or "none"
            raise HandbenchError(f"{file}: the depth map of '{capture.name}' is missing; {there}")
        key = [content_hash(file)]
        given |= {"file": str(file), "config": {"maps": entry.maps}}
    inputs = [capture.key, function.__name__, key, grid.x_m, grid.y_m]
    return Stage("reconstruct", function, given, inputs, capture.name, entry.id)


def references(
    capture: RunCapture, registration: Transform | None, made: Path | None, found: Outcome
) -> dict[str, tuple[Path, Transform]]:
    """Find the surfaces with which a capture's depth maps are compared: reference → mesh file, and
    the transform that moves the mesh into the radar frame.
    registration: radar_from_photo of the benchmark's calibration, for captures that have no
    transform. made: folder with the mesh reconstructed from the capture's photographs, or None.
    found: remarks on the transform and the photograph to show are added to it. Raises
    HandbenchError if there is no reference."""
    available: dict[str, tuple[Path, Transform]] = {}
    data = open_capture(capture.folder)
    transform, mesh = data.transform() or registration, data.mesh()
    if transform is not None and transform.refined:
        found.facts.setdefault("refined_transforms", {})[capture.name] = transform.refined["reason"]
    if transform is not None and mesh is not None:
        available["photogrammetry"] = mesh, transform
    elif transform is not None and made is not None:
        available["photogrammetry"] = made / MESH, transform
        found.views[capture.name] = made / VIEW
    if data.truth is not None:
        available["truth"] = data.truth, identity("radar")
        if "photogrammetry" in available:
            available["completed"] = available["photogrammetry"]
    if not available:
        raise HandbenchError(
            f"{capture.folder}: has no surface to compare depths with; add photographs or "
            "mesh.ply with a transform (radar_from_photo.json, or [calibration] in the "
            "benchmark)"
        )
    return {name: available[name] for name in REFERENCES if name in available}


def scoring(
    bench: BenchFile,
    capture: RunCapture,
    maps: dict[str, Path],
    references: dict[str, tuple[Path, Transform]],
) -> Stage:
    """Return the stage that compares the depth maps of one capture with its references.
    maps: method → file of its depth map. references: name → mesh file, and the transform that moves
    the mesh into the radar frame."""
    given = {
        "capture": str(capture.folder),
        "maps": maps,
        "references": references,
        "protocol": bench.protocol,
    }
    carried = {
        name: [t.matrix, t.covariance, mesh.parent.name] for name, (mesh, t) in references.items()
    }
    # a stage's folder is named by its key
    imaged = {method: file.parent.name for method, file in maps.items()}
    inputs = [capture.key, imaged, carried, bench.protocol]
    return Stage("score", score, given, inputs, capture.name)
