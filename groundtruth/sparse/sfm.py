"""Structure from motion with pycolmap: photographs to camera poses and sparse points, in an arbitrary frame and scale.

Schönberger & Frahm, "Structure-from-Motion Revisited", CVPR 2016. CPU only; the same seed gives the same poses.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from groundtruth.cameras.cameras import Camera, pycolmap
from groundtruth.photos.photos import Photo
from radar.support.errors import HandbenchError
from radar.support.progress import say

LONGEST_SIDE_PX = 3200  # features are found on photographs no larger than this
MOST_FEATURES = 4096  # of a photograph
FEWEST_REGISTERED = 3
ATTEMPTS = 4  # with another seed each, while less than half of the photographs register


def structure_from_motion(
    photos: tuple[Photo, ...],
    folder: Path,
    *,
    cameras: tuple[Camera, ...] | None = None,
    intrinsics: tuple[float, float, float, float] | None = None,
    focal_px: dict[str, float] | None = None,
    seed: int = 0,
) -> pycolmap.Reconstruction:
    """Register the photographs; `folder` (empty) receives COLMAP's database.

    cameras: one for each photograph, held fixed. intrinsics: fx, fy, cx, cy in pixels of one camera that took all
    photographs, held fixed while its distortion is estimated. focal_px: a focal length for every name, where
    nothing else is known; held fixed likewise, since a plane and free focal lengths do not determine each other. With
    none of these, all but the principal point is estimated, from the focal lengths that EXIF data tell. HandbenchError
    when fewer than three photographs register.
    """
    pycolmap.logging.minloglevel = int(pycolmap.logging.FATAL)
    pycolmap.set_random_seed(seed)
    database = folder / "database.db"
    _extract(photos, database, cameras, intrinsics)
    if cameras is not None:
        _write_known_cameras(database, {camera.name: camera for camera in cameras})
    elif intrinsics is None:
        guessed_px = {photo.name: photo.focal_px for photo in photos if photo.focal_px is not None}
        _write_focal_lengths(database, focal_px or guessed_px)
    _match(database, seed)
    return _map(photos, database, folder, seed, fixed=cameras is not None, known=bool(intrinsics or focal_px))


def _extract(
    photos: tuple[Photo, ...],
    database: Path,
    cameras: tuple[Camera, ...] | None,
    intrinsics: tuple[float, float, float, float] | None,
) -> None:
    say(f"features of {len(photos)} photographs")
    options = pycolmap.FeatureExtractionOptions(max_image_size=LONGEST_SIDE_PX)
    options.sift.max_num_features = MOST_FEATURES
    options.sift.first_octave = 0  # not doubled in size: a quarter of the time, poses as good
    reader = pycolmap.ImageReaderOptions(camera_model="RADIAL" if intrinsics is None else "OPENCV")
    if intrinsics is not None:
        reader.camera_params = ",".join(map(str, (*intrinsics, 0, 0, 0, 0)))
    folder = photos[0].path.parent
    pycolmap.Database.open(database).close()
    for names, mode in _camera_groups(photos, cameras is not None, intrinsics is not None):
        pycolmap.import_images(database, folder, mode, names, reader)  # in this order, whichever thread is done first
        pycolmap.extract_features(database, folder, names, mode, reader, options, device=pycolmap.Device.cpu)


def _camera_groups(photos: tuple[Photo, ...], fixed: bool, known: bool) -> list[tuple[list[str], pycolmap.CameraMode]]:
    """Groups of photographs that share a camera: all with known intrinsics, those of one body by EXIF, else none."""
    mode = pycolmap.CameraMode
    names = [photo.name for photo in photos]
    if known:
        return [(names, mode.SINGLE)]
    if fixed or any(photo.body is None for photo in photos):
        return [(names, mode.PER_IMAGE)]
    bodies = sorted({photo.body for photo in photos if photo.body is not None})
    return [([photo.name for photo in photos if photo.body == body], mode.SINGLE) for body in bodies]


def _write_known_cameras(database: Path, cameras: dict[str, Camera]) -> None:
    with pycolmap.Database.open(database) as stored:
        for image in stored.read_all_images():
            known = cameras[image.name].colmap()
            known.camera_id = image.camera_id
            known.has_prior_focal_length = True
            stored.update_camera(known)


def _write_focal_lengths(database: Path, focal_px: dict[str, float]) -> None:
    """Give every camera the median focal length of its photographs."""
    with pycolmap.Database.open(database) as stored:
        images = stored.read_all_images()
        for camera in stored.read_all_cameras():
            known = [focal_px[i.name] for i in images if i.camera_id == camera.camera_id and i.name in focal_px]
            if known:
                camera.params = [float(np.median(known)), *camera.params[1:]]
                camera.has_prior_focal_length = True
                stored.update_camera(camera)


def _match(database: Path, seed: int) -> None:
    say("matching every pair")
    matching = pycolmap.FeatureMatchingOptions(num_threads=1)  # with more, the index of descriptors does not repeat
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = seed
    pycolmap.match_exhaustive(database, matching, verification_options=verification, device=pycolmap.Device.cpu)


def _map(
    photos: tuple[Photo, ...], database: Path, folder: Path, seed: int, fixed: bool, known: bool
) -> pycolmap.Reconstruction:
    say("registering")
    pictures, best = photos[0].path.parent, pycolmap.Reconstruction()
    for attempt in range(ATTEMPTS):
        options = _mapping_options(seed + attempt, fixed, known)
        models = pycolmap.incremental_mapping(database, pictures, folder, options)
        best = max([*models.values(), best], key=lambda model: model.num_reg_images())
        registered = best.num_reg_images()
        if 2 * registered >= len(photos):
            break
    if registered < FEWEST_REGISTERED:
        raise HandbenchError(
            f"{pictures}: only {registered} of {len(photos)} photographs could be registered, "
            f"{FEWEST_REGISTERED} are needed; take more photographs from different places, with more overlap and a "
            "textured surrounding, or give the cameras' intrinsics"
        )
    say(f"registered {registered} of {len(photos)} photographs")
    return best


def _mapping_options(seed: int, fixed: bool, known: bool) -> pycolmap.IncrementalPipelineOptions:
    options = pycolmap.IncrementalPipelineOptions(
        random_seed=seed, min_model_size=FEWEST_REGISTERED, multiple_models=False, extract_colors=False
    )
    options.num_threads = 1  # sums over threads would not repeat bit for bit
    options.mapper.random_seed = seed
    options.triangulation.random_seed = seed
    options.triangulation.ignore_two_view_tracks = False
    options.ba_refine_focal_length = options.mapper.abs_pose_refine_focal_length = not (fixed or known)
    options.ba_refine_extra_params = options.mapper.abs_pose_refine_extra_params = not fixed
    return options
