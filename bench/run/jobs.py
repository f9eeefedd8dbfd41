"""The jobs of a benchmark, as data: what each depends on, what it is given, and whose code it runs.

They come in three rounds: `opening` for every capture; then, of the captures that are open, `calibration`, `meshing`
and `imaging`, which do not wait for each other; last `scoring`, of the captures that have a reference.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from bench.datasets.dataset import open_capture
from bench.run import stages
from bench.run.benchmark_file import BenchFile, MethodEntry, Source
from bench.run.outcome import Capture
from bench.run.tasks import HASH, Job, job
from bench.scenes.build import named_files
from bench.scenes.scene_file import SceneFile
from calibration.transforms import Transform
from radar.imaging.device import chosen
from radar.simulation.causes import Noise
from radar.support.config import load
from radar.support.files import inside

# The code that each kind of stage runs: a change of it makes the stage anew.
MESHES = ("groundtruth/mesh/mesh_files.py", "groundtruth/mesh/ply.py", "calibration/transforms.py")
SIMULATION = (
    "radar",
    "bench/scenes",
    "bench/datasets",
    "calibration/target/description.py",
    *MESHES,
    "groundtruth/board/board.py",
    "groundtruth/cameras/cameras.py",
)
PHOTOGRAMMETRY = ("groundtruth", "bench/run/stages.py", *MESHES)
IMAGING = (
    "radar",
    "bench/datasets",
    "calibration/array/array_file.py",
    "radar/methods/registry.py",
    "bench/run/stages.py",
    "bench/evaluation/metrics.py",
)  # and the method's own, of which the job knows
SCORING = (
    "bench/datasets",
    "bench/run/scoring.py",
    "bench/evaluation/depth_errors.py",
    "bench/evaluation/scoring_protocols.py",
    "bench/run/stages.py",
    "groundtruth/mesh/depth.py",
    "groundtruth/mesh/surface.py",
    "radar/data/depthmap.py",
    "radar/support/rays.py",
    *MESHES,
)


def opening(bench: BenchFile, base: Path, source: Source, frames: int) -> Job:
    """To hash a capture folder as it lies, or to simulate a scene into one; paths start from `base`."""
    if source.path is not None:
        folder = inside(base, source.path, "capture.path")
        return Job(HASH, open_capture(folder).about.name, arguments={"folder": str(folder), "frames": frames})
    path = inside(base, source.scene or "", "capture.scene")
    scene = load(SceneFile, path, "a scene description")
    if bench.phase_noise_rad is not None:
        scene = scene.model_copy(update={"noise": Noise(phase_noise_rad=bench.phase_noise_rad)})
    if not source.photos:
        scene = scene.model_copy(update={"photos": None})
    given = {"scene": scene.model_dump(mode="json"), "base": str(path.parent), "frames": frames}
    depends_on = [given["scene"], frames, *named_files(scene, path.parent)]
    return job("simulate", scene.name, "", depends_on, SIMULATION, given)


def calibration(bench: BenchFile, targets: list[Capture]) -> list[Job]:
    """To register the sensors by captures of one target, if there are any."""
    if not targets:
        return []
    given = {"captures": [str(target.folder) for target in targets], **_photogrammetry(bench)}
    depends_on = [*(target.key for target in targets), *_photogrammetry(bench).values()]
    return [job("calibrate", targets[0].name, "", depends_on, (*PHOTOGRAMMETRY, "calibration", "radar"), given)]


def meshing(bench: BenchFile, capture: Capture) -> list[Job]:
    """To make the capture's photographs a mesh, if it has none and if a transform carries it into the radar frame."""
    data = open_capture(capture.folder)
    carried = bool(bench.calibration) or data.transform() is not None
    if not carried or data.photos is None or data.mesh() is not None:
        return []
    options = _photogrammetry(bench)
    depends_on, given = [capture.key, *options.values()], {"capture": str(capture.folder), **options}
    return [job("groundtruth", capture.name, "", depends_on, PHOTOGRAMMETRY, given)]


def imaging(bench: BenchFile, capture: Capture, entry: MethodEntry) -> list[Job]:
    """To image the capture by one method and, where asked for, its repeats."""
    config = stages.configuration(capture.folder, entry.id, entry.config).model_dump(mode="json")
    depends_on = [capture.key, config, chosen(), entry.every_nth_antenna]
    given = {
        "capture": str(capture.folder),
        "method": entry.id,
        "config": config,
        "device": chosen(),
        "every_nth_antenna": entry.every_nth_antenna,
    }
    about, frames = (capture.name, entry.id), bench.repeats
    jobs = [job("reconstruct", *about, depends_on, IMAGING, given)]
    if entry.precision:
        jobs.append(job("repeat", *about, [*depends_on, frames], IMAGING, {**given, "frames": frames}))
    return jobs


def scoring(
    bench: BenchFile, capture: Capture, maps: dict[str, Path], references: dict[str, tuple[Path, Transform]]
) -> Job:
    """To compare the capture's depth maps, files of kept stages by method, with its references."""
    given = {"capture": str(capture.folder), "maps": maps, "references": references, "protocol": bench.protocol}
    carried = {name: [t.matrix, t.covariance, mesh.parent.name] for name, (mesh, t) in references.items()}
    imaged = {method: file.parent.name for method, file in maps.items()}  # a stage's folder is named by its key
    return job("score", capture.name, "", [capture.key, imaged, carried, bench.protocol], SCORING, given)


def _photogrammetry(bench: BenchFile) -> dict[str, Any]:
    return {"quality": bench.groundtruth.quality, "seed": bench.seed}
