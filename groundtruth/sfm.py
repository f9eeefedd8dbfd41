"""Structure from motion with pycolmap: photographs to camera poses and sparse points, in an arbitrary frame and scale.

Schönberger & Frahm, "Structure-from-Motion Revisited", CVPR 2016. CPU only; the same seed gives the same poses.
"""

from __future__ import annotations

from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING

from calibration import HandbenchError, say
from groundtruth.cameras import Camera, load_pycolmap
from groundtruth.photos import Photo

if TYPE_CHECKING:
    import pycolmap

LONGEST_SIDE_PX = 3200  # features are found on photographs no larger than this
MOST_FEATURES = 4096  # of a photograph
FEWEST_REGISTERED = 3


def structure_from_motion(
    photos: tuple[Photo, ...],
    folder: Path,
    *,
    cameras: tuple[Camera, ...] | None = None,
    intrinsics: tuple[float, float, float, float] | None = None,
    seed: int = 0,
) -> pycolmap.Reconstruction:
    """Register the photographs; `folder` (empty) receives COLMAP's database.

    cameras: one for each photograph, held fixed. intrinsics: fx, fy, cx, cy in pixels of one camera that took all
    photographs, held fixed while its distortion is estimated. With neither, everything is estimated from EXIF data or
    a guess. A HandbenchError when fewer than three photographs register.
    """
    colmap = load_pycolmap()
    colmap.logging.minloglevel = int(colmap.logging.ERROR)
    colmap.set_random_seed(seed)
    database = folder / "database.db"
    _extract(photos, database, cameras, intrinsics)
    _match(database, seed)
    return _map(photos, database, folder, seed, fixed=cameras is not None, known=intrinsics is not None)


def _extract(
    photos: tuple[Photo, ...],
    database: Path,
    cameras: tuple[Camera, ...] | None,
    intrinsics: tuple[float, float, float, float] | None,
) -> None:
    say(f"features of {len(photos)} photographs")
    colmap = load_pycolmap()
    options = colmap.FeatureExtractionOptions(max_image_size=LONGEST_SIDE_PX)
    options.sift.max_num_features = MOST_FEATURES
    options.sift.first_octave = 0  # not doubled in size: a quarter of the time, poses as good
    reader = colmap.ImageReaderOptions(camera_model="OPENCV")
    if intrinsics is not None:
        reader.camera_params = ",".join(map(str, (*intrinsics, 0, 0, 0, 0)))
    for names, mode in _camera_groups(photos, cameras is not None, intrinsics is not None):
        colmap.extract_features(
            database, photos[0].path.parent, names, mode, reader, options, device=colmap.Device.cpu
        )
    if cameras is not None:
        _write_known_cameras(database, {camera.name: camera for camera in cameras})


def _camera_groups(photos: tuple[Photo, ...], fixed: bool, known: bool) -> list[tuple[list[str], object]]:
    """Which photographs share a camera: all with known intrinsics, those of one body by EXIF, else none."""
    mode = load_pycolmap().CameraMode
    names = [photo.name for photo in photos]
    if known:
        return [(names, mode.SINGLE)]
    if fixed or any(photo.body is None for photo in photos):
        return [(names, mode.PER_IMAGE)]
    by_body = groupby(sorted(photos, key=_body), key=_body)
    return [([photo.name for photo in group], mode.SINGLE) for _, group in by_body]


def _body(photo: Photo) -> tuple[str, ...]:
    return photo.body or ()


def _write_known_cameras(database: Path, cameras: dict[str, Camera]) -> None:
    with load_pycolmap().Database.open(database) as stored:
        for image in stored.read_all_images():
            known = cameras[image.name].colmap()
            known.camera_id = image.camera_id
            known.has_prior_focal_length = True
            stored.update_camera(known)


def _match(database: Path, seed: int) -> None:
    say("matching every pair")
    colmap = load_pycolmap()
    verification = colmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = seed
    colmap.match_exhaustive(database, verification_options=verification, device=colmap.Device.cpu)


def _map(
    photos: tuple[Photo, ...], database: Path, folder: Path, seed: int, fixed: bool, known: bool
) -> pycolmap.Reconstruction:
    say("registering")
    colmap = load_pycolmap()
    options = colmap.IncrementalPipelineOptions(
        random_seed=seed, min_model_size=FEWEST_REGISTERED, multiple_models=False, extract_colors=False
    )
    options.num_threads = 1  # sums over threads would not repeat bit for bit
    options.mapper.random_seed = seed
    options.triangulation.random_seed = seed
    options.triangulation.ignore_two_view_tracks = False
    options.ba_refine_focal_length = options.mapper.abs_pose_refine_focal_length = not (fixed or known)
    options.ba_refine_extra_params = options.mapper.abs_pose_refine_extra_params = not fixed
    models = colmap.incremental_mapping(database, photos[0].path.parent, folder, options)
    best = max(models.values(), key=lambda model: model.num_reg_images(), default=None)
    registered = best.num_reg_images() if best else 0
    if registered < FEWEST_REGISTERED:
        raise HandbenchError(
            f"{photos[0].path.parent}: only {registered} of {len(photos)} photographs could be registered, "
            f"{FEWEST_REGISTERED} are needed; take more photographs with more overlap and a textured surrounding"
        )
    return best
