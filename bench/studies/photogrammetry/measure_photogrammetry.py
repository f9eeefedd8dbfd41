"""Study of photogrammetry: photographs of hands are rendered, reconstructed as a user would, and
the meshes compared with the true surface.

    python -m handbench.bench.studies.photogrammetry.measure_photogrammetry bars|sweep
        [--poses C,Y]

`bars` measures the accuracy in several conditions, and whether predicted standard deviations are
right. `sweep` measures accuracy against computing time, on the first pose.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree

from handbench.bench.datasets.simulated import write_photos
from handbench.bench.evaluation.metrics import BAND
from handbench.bench.evaluation.tables import declared_tables
from handbench.bench.scenes.build import Scene, build
from handbench.bench.studies.photogrammetry.photogrammetry_cases import (
    PhotogrammetryCase,
    bars,
    sweep,
)
from handbench.bench.studies.study import Record, Study, Table, measured, parser
from handbench.bench.tradeoff.groundtruth import radar_side
from handbench.calibration.transforms import umeyama
from handbench.groundtruth.cameras.cameras import Camera
from handbench.groundtruth.mesh.mesh_files import raycasting_scene
from handbench.groundtruth.options import Options
from handbench.groundtruth.pipeline import ReconstructedMesh, reconstruct
from handbench.support.cost import measured as costs
from handbench.support.files import atomic_folder, content_hash

COMPLETE_M = 1e-3
WITHIN = {"within_1_sigma": 1.0, "within_2_sigma": 2.0, "within_95": BAND}  # standard deviations


def study(work: Path, what: str, poses: str) -> Study:
    """Make the study of photogrammetry on rendered photographs of hands, whose true surface is
    known.

    work: folder for photographs and results. what: "bars" for the accuracy and the predicted
    standard deviations on all poses; "sweep" for accuracy against time on the first pose. poses:
    letters of the manual alphabet or mesh files, separated by commas.
    """
    letters = tuple(poses.split(","))
    return Study(
        f"photogrammetry_{what}",
        list(bars(letters) if what == "bars" else sweep(letters[0])),
        lambda case: measure(case, work),
        tables,
        label=lambda case: f"{case.name}, {case.pose}",
    )


def tables(records: list[Record]) -> list[Table]:
    """Make the study's one table, with a row for each record."""
    return [Table("rows", declared_tables(__file__)["rows"].columns, records)]


def measure(case: PhotogrammetryCase, work: Path) -> Record:
    """Render the photographs of a case, reconstruct them, and compare the mesh with the true
    surface. Returns a record.

    Photographs and intermediate results are kept in `work`, where cases with the same photographs
    share them.
    """
    file = case.scene_file()
    scene = build(file, Path(case.pose).parent)
    mesh = {"mesh": content_hash(Path(case.pose))} if case.is_file else {}
    values = {**file.model_dump(mode="json", exclude={"name"}), **mesh}
    folder = work / f"{Path(case.pose).stem}-{content_hash(values)[:12]}"
    if not (folder / "capture").is_dir():
        with atomic_folder(folder / "capture") as temporary:
            write_photos(scene, temporary)
    taken = photos = folder / "capture" / "photos"
    if not case.known:
        photos = folder / "unknown"
        intrinsics = shutil.ignore_patterns("*cameras.json")
        if not photos.is_dir():
            with atomic_folder(photos) as temporary:
                shutil.copytree(taken, temporary, dirs_exist_ok=True, ignore=intrinsics)
    # each rendered camera has a lens of its own, and none has EXIF data
    lens, box_m = None if case.known else False, tuple(scene.box_m.ravel())
    options = Options(quality=case.quality, box_m=box_m, shared_intrinsics=lens)
    return reconstructed(case, scene, photos, options, folder / "reconstruction")


def reconstructed(
    case: PhotogrammetryCase, scene: Scene, photos: Path, options: Options, workdir: Path
) -> Record:
    """Reconstruct the photographs of a case in the folder `photos`, and compare the mesh with the
    scene. Returns a record of errors, time and memory. workdir: folder that keeps the stages'
    results."""
    with costs() as cost:
        result = reconstruct(photos, options, workdir)
    about = ("pose", "cameras", "width", "quality")
    return {
        "case": case.name,
        **{name: getattr(case, name) for name in about},
        **score(result, scene),
        **{f"{stage}_s": seconds for stage, seconds in result.seconds.items()},
        "all_s": sum(result.seconds.values()),
        "cpu_s": cost.cpu_seconds,
        "peak_memory_mb": cost.peak_memory_mb,
    }


def score(result: ReconstructedMesh, scene: Scene) -> Record:
    """Compare a reconstruction with the scene that was photographed. Returns statistics by name.

    Distances in metres (median_m, rms_m, …) are those of the mesh's observed vertices from the true
    surface. The shares within_1_sigma, within_2_sigma and within_95 say for how many vertices the
    distance is below so many of the vertex's predicted standard deviations. Further values:
    completeness, error of the scale, and mean error of the cameras' centres.
    """
    surface, photo_from_radar = result.surface, scene.radar_from_photo.inverse()
    points_m = scene.radar_from_photo.points(surface.vertices_m)[surface.observed]
    true_surface = raycasting_scene(scene.target_mesh)
    signed_m = true_surface.compute_signed_distance(points_m.astype(np.float32)).numpy()
    distance_m = np.abs(signed_m.astype(np.float64))
    x_m, y_m, z_m = radar_side(scene.target_mesh, scene.radar_from_photo, scene.box_m)
    side_m = np.stack([*np.meshgrid(x_m, y_m), z_m], axis=-1)[np.isfinite(z_m)]
    ratio = distance_m / surface.sigma_m[surface.observed]
    true = {camera.name: camera for camera in scene.cameras}
    off_m = [np.linalg.norm(one.centre_m - true[one.name].centre_m) for one in result.cameras]
    return {
        "median_m": float(np.median(distance_m)),
        "signed_m": float(np.median(signed_m)),
        "rms_m": float(np.sqrt(np.mean(distance_m**2))),
        "p95_m": float(np.quantile(distance_m, 0.95)),
        "max_m": float(distance_m.max()),
        "complete": completeness(points_m, side_m),
        "scale": scale_error(photo_from_radar.points(side_m), result.cameras, true),
        "centre_m": float(np.mean(off_m)),
        **{name: float(np.mean(ratio <= k)) for name, k in WITHIN.items()},
    }


def completeness(points_m: np.ndarray, side_m: np.ndarray) -> float:
    """Compute the share of the true surface's points side_m [n, 3] that are within a millimetre of
    a point of the reconstruction, points_m [m, 3]."""
    return float(
        np.mean(KDTree(points_m).query(side_m, distance_upper_bound=COMPLETE_M)[0] < np.inf)
    )


def scale_error(points_m: np.ndarray, ours: tuple[Camera, ...], true: dict[str, Camera]) -> float:
    """Compute the relative error of scale that errors of the estimated cameras cause: 0.01 means
    that reconstructions are 1 % too large.

    points_m [n, 3] (photo frame) are projected by the true cameras, and triangulated by the
    estimated ones, `ours`.
    """
    normal, right = np.zeros((len(points_m), 3, 3)), np.zeros((len(points_m), 3))
    for camera in ours:
        xy = np.asarray(camera.colmap().cam_from_img(true[camera.name].project(points_m)))
        rays = np.column_stack([xy, np.ones(len(xy))]) @ camera.rotation
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        across = np.eye(3) - rays[:, :, None] * rays[:, None, :]  # the nearest point to all rays
        normal += across
        right += across @ camera.centre_m
    found_m = np.linalg.solve(normal, right[..., None])[..., 0]
    similarity = umeyama(points_m, found_m, with_scale=True)
    return float(np.cbrt(np.linalg.det(similarity[:3, :3])) - 1)


def main() -> None:
    """Measure, on rendered hands, the error of reconstructed surfaces, whether their predicted
    standard deviations are right, and the time; write and print the table."""
    purpose = "what photogrammetry's accuracy costs, and whether its error bars are honest"
    options = parser("photogrammetry.measure_photogrammetry", purpose)
    what = "what a ground truth is held to, or its price in time"
    options.add_argument("what", choices=["bars", "sweep"], help=what)
    poses = "letters or mesh files of hands, separated by commas; sweep takes the first"
    options.add_argument("--poses", default="C,Y", help=f"{poses} (default C,Y)")
    measured(options, study, "photogrammetry")


if __name__ == "__main__":
    main()
