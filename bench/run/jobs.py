"""The stages of a benchmark, as data: what each depends on, what it is given, and whose code it runs.

They come in rounds: `opening`, then `inspection`, for every capture; of the captures that are open the photographs'
`clouds`, which are two rounds, `sparse` and `dense`; then `calibration`, `meshing` and `imaging`, which do not wait for
each other; last `scoring`, of the captures that have a reference.
"""

from pathlib import Path

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.pipeline.image import configured
from handbench.bench.run.benchmark_file import BenchFile, MethodEntry, Origin, Source
from handbench.bench.run.outcome import Capture
from handbench.bench.run.photogrammetry import photographs
from handbench.bench.run.submitted_stage import grid_of
from handbench.bench.run.tasks import HASH
from handbench.bench.scenes.build import named_files
from handbench.bench.scenes.scene_file import SceneFile
from handbench.bench.submissions.submission import load_submission
from handbench.calibration.transforms import Transform
from handbench.groundtruth import pipeline
from handbench.groundtruth.dense_stage import CLOUD
from handbench.radar.imaging.device import chosen
from handbench.radar.methods.registry import method_key
from handbench.radar.simulation.causes import Noise
from handbench.support.config import load
from handbench.support.errors import HandbenchError
from handbench.support.files import inside
from handbench.support.store import Stage, stage

Clouds = tuple[Stage, Stage, Stage]  # sparse, dense and mesh of one capture's photographs


def opening(bench: BenchFile, base: Path, source: Origin, frames: int, photos: bool = True) -> Stage:
    """To hash a capture folder as it lies, or to simulate a scene into one; paths start from `base`. photos: whether
    anything needs the scene's photographs."""
    if source.path is not None:
        folder = inside(base, source.path, "capture.path")
        return Stage(HASH, open_capture(folder).about.name, arguments={"folder": str(folder), "frames": frames})
    path = inside(base, source.scene or "", "capture.scene")
    scene = load(SceneFile, path, "a scene description")
    if isinstance(source, Source) and source.persons:
        scene = scene.of_person(*source.persons)
    if bench.phase_noise_rad is not None:
        scene = scene.model_copy(update={"noise": Noise(phase_noise_rad=bench.phase_noise_rad)})
    if not (photos and source.photos):
        scene = scene.model_copy(update={"photos": None})
    given = {"scene": scene.model_dump(mode="json"), "base": str(path.parent), "frames": frames}
    depends_on = [given["scene"], frames, *named_files(scene, path.parent)]
    return stage("simulate", "handbench.bench.run.simulate_stage:simulate", depends_on, given, scene.name)


def inspection(capture: Capture) -> Stage:
    """To look the capture over for mistakes before anything is believed of it."""
    return stage(
        "inspect",
        "handbench.bench.validation.doubts:make",
        [capture.key],
        {"capture": str(capture.folder)},
        capture.name,
    )


def clouds(bench: BenchFile, capture: Capture, work: Path) -> Clouds:
    """To reconstruct the capture's photographs; a HandbenchError where it has none."""
    photos, options = photographs(capture.folder, bench.groundtruth.quality, bench.seed)
    return pipeline.stages(work, photos, options, [capture.key], capture=capture.name)


def calibration(targets: list[Capture], dense: list[Stage], work: Path) -> Stage:
    """To register the sensors by captures of one target, whose clouds are there."""
    given = {
        "captures": [str(target.folder) for target in targets],
        "clouds": [str(each.folder(work) / CLOUD) for each in dense],
    }
    depends_on = [*(target.key for target in targets), *(each.key for each in dense)]
    return stage("calibrate", "handbench.bench.run.calibrate_stage:calibrate", depends_on, given, targets[0].name)


def meshing(bench: BenchFile, capture: Capture, work: Path) -> Clouds | None:
    """To make the capture's photographs a mesh, if it has none and if a transform carries it into the radar frame."""
    data = open_capture(capture.folder)
    carried = bool(bench.calibration) or data.transform() is not None
    return clouds(bench, capture, work) if carried and data.photos is not None and data.mesh() is None else None


def imaging(bench: BenchFile, capture: Capture, entry: MethodEntry) -> list[Stage]:
    """To image the capture by one method: for the accuracy the benchmark's frames, for the precision, where the method
    has one, all repeats."""
    if entry.submission is not None:
        return [_submitted(bench, capture, entry.id, Path(entry.submission))]
    given = {
        "capture": str(capture.folder),
        "method": entry.id,
        "config": configured(capture.about, entry.id, entry.config).model_dump(mode="json"),
        "device": chosen(),
        "every_nth_antenna": entry.every_nth_antenna,
    }
    depends_on = [capture.key, given["config"], given["device"], entry.every_nth_antenna]
    wanted = {"reconstruct": bench.frames} if "accuracy" in capture.measures else {}
    if "precision" in capture.measures and entry.precision:
        wanted["repeat"] = bench.repeats
    about = capture.name, entry.id, method_key(entry.id)
    return [
        stage(
            name, f"handbench.bench.run.{name}_stage:{name}", [*depends_on, frames], {**given, "frames": frames}, *about
        )
        for name, frames in wanted.items()
    ]


def _submitted(bench: BenchFile, capture: Capture, id: str, submission: Path) -> Stage:
    """To take a submitted depth map of the capture, which is scored as if it had been imaged here."""
    about, rows = load_submission(submission)
    if capture.name not in rows:
        raise HandbenchError(f"{submission}: has no depth map of '{capture.name}'")
    grid, config = grid_of(bench, capture.folder), about.model_dump(mode="json")
    given = {"submission": str(submission), "capture": capture.name, "x_m": grid.x_m, "y_m": grid.y_m, "config": config}
    depends_on = [capture.key, vars(rows[capture.name]), grid.x_m, grid.y_m]
    return stage("reconstruct", "handbench.bench.run.submitted_stage:take", depends_on, given, capture.name, id)


def scoring(
    bench: BenchFile, capture: Capture, maps: dict[str, Path], references: dict[str, tuple[Path, Transform]]
) -> Stage:
    """To compare the capture's depth maps, files of kept stages by method, with its references."""
    given = {"capture": str(capture.folder), "maps": maps, "references": references, "protocol": bench.protocol}
    carried = {name: [t.matrix, t.covariance, mesh.parent.name] for name, (mesh, t) in references.items()}
    imaged = {method: file.parent.name for method, file in maps.items()}  # a stage's folder is named by its key
    depends_on = [capture.key, imaged, carried, bench.protocol]
    return stage("score", "handbench.bench.run.scoring:make", depends_on, given, capture.name)
