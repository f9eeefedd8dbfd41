"""Photographs to a model with pycolmap: structure from motion, in an arbitrary frame and scale, or, where cameras and
poses are known, the matches that the poses explain, triangulated.

Schönberger & Frahm, "Structure-from-Motion Revisited", CVPR 2016. CPU only; the same seed gives the same poses.
"""

from pathlib import Path

import numpy as np

from handbench.groundtruth.cameras.camera_files import FEWEST_POINTS
from handbench.groundtruth.cameras.cameras import Camera, pycolmap, registered, set_pose
from handbench.groundtruth.photos.photos import FEWEST, Photo
from handbench.groundtruth.sparse.features import DATABASE, Lenses, agreement, find_features, match, pipeline_options
from handbench.support.errors import HandbenchError
from handbench.support.progress import say

ATTEMPTS = 4  # with another seed each, while less than half of the photographs register
CONVERGED = 1e-6  # relative fall of an adjustment's cost at which it ends; another one follows
NOTHING_KNOWN = Lenses()
LEAST_AGREEING = 0.5  # of the matches, with the poses: wrong ones have a quarter, since epipolar lines are alike


def structure_from_motion(
    photos: tuple[Photo, ...], folder: Path, lenses: Lenses = NOTHING_KNOWN, seed: int = 0
) -> "pycolmap.Reconstruction":
    """Register the photographs; `folder` (empty) receives COLMAP's database.

    Known lenses are held fixed. So is a known focal length, since a plane and free focal lengths do not determine each
    other. Where nothing is known all but the principal point is estimated, from the focal lengths that EXIF data tell.
    HandbenchError when fewer than three photographs register.
    """
    database = folder / DATABASE
    find_features(photos, database, lenses, seed)
    match(database, seed)
    say("registering")
    pictures, best = photos[0].path.parent, pycolmap.Reconstruction()
    for attempt in range(ATTEMPTS):
        options = pipeline_options(seed + attempt)
        options.min_model_size, options.multiple_models = FEWEST, False
        options.ba_local_function_tolerance = options.ba_global_function_tolerance = CONVERGED
        free_focal = not (lenses.known or lenses.intrinsics or lenses.focal_px)
        options.ba_refine_focal_length = options.mapper.abs_pose_refine_focal_length = free_focal
        options.ba_refine_extra_params = options.mapper.abs_pose_refine_extra_params = not lenses.known
        models = pycolmap.incremental_mapping(database, pictures, folder, options)
        best = max([*models.values(), best], key=lambda model: model.num_reg_images())
        count = best.num_reg_images()
        if 2 * count >= len(photos):
            break
    if count < FEWEST:
        raise HandbenchError(
            f"{pictures}: only {count} of {len(photos)} photographs could be registered, {FEWEST} are needed; take "
            "more photographs from different places, with more overlap and a textured surrounding, or give "
            "the cameras' intrinsics"
        )
    say(f"registered {count} of {len(photos)} photographs")
    return best


def triangulated(
    photos: tuple[Photo, ...], cameras: tuple[Camera, ...], folder: Path, seed: int = 0
) -> "pycolmap.Reconstruction":
    """The model of photographs with known cameras (all with R, t), which stay as they are bit for bit; `folder` (empty)
    receives COLMAP's database.

    Photographs that see next to nothing are left out. HandbenchError when the features do not fit the poses.
    """
    pictures, database, given = photos[0].path.parent, folder / DATABASE, {camera.name: camera for camera in cameras}
    find_features(photos, database, Lenses(cameras), seed)
    model = pycolmap.Reconstruction()  # of the cameras alone, with the database's numbers
    with pycolmap.Database.open(database) as stored:
        for camera in stored.read_all_cameras():
            model.add_camera_with_trivial_rig(camera)
        for image in stored.read_all_images():
            model.add_image_with_trivial_frame(image, _pose(given[image.name]))
    match(database, seed)
    share = agreement(database, model)
    if share < LEAST_AGREEING:
        raise HandbenchError(
            f"{pictures}: {share:.0%} of the matched features agree with the given poses, {LEAST_AGREEING:.0%} are "
            "needed; check that R, t carry world to camera (x right, y down, z forward) and belong to these "
            "photographs, or leave them out"
        )
    say("triangulating")
    model = pycolmap.triangulate_points(model, database, pictures, folder, options=pipeline_options(seed))
    for image in registered(model):
        if image.num_points3D < FEWEST_POINTS:
            model.deregister_frame(image.frame_id)
    if len(registered(model)) < FEWEST:
        raise HandbenchError(
            f"{pictures}: {len(registered(model))} of {len(photos)} photographs see {FEWEST_POINTS} "
            f"points with the given poses, {FEWEST} are needed; take photographs with more overlap and texture"
        )
    for image in registered(model):  # back to where it was given: COLMAP scales its models, and back
        set_pose(image, _pose(given[image.name]))
    error_px = model.compute_mean_reprojection_error()
    say(
        f"{model.num_points3D()} points of {len(registered(model))} photographs with known poses, {error_px:.2f} px off"
    )
    return model


def _pose(camera: Camera) -> "pycolmap.Rigid3d":
    return pycolmap.Rigid3d(pycolmap.Rotation3d(camera.rotation), camera.translation_m)


def changes(model: "pycolmap.Reconstruction", cameras: tuple[Camera, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Distances [n] of a model's cameras from those given, and angles [n] between them, radians."""
    given = {camera.name: camera for camera in cameras}
    pairs = [(image, given[image.name]) for image in registered(model) if image.name in given]
    moved = np.array([np.linalg.norm(image.projection_center() - camera.centre_m) for image, camera in pairs])
    turned_rad = [image.cam_from_world().rotation.angle_to(_pose(camera).rotation) for image, camera in pairs]
    return moved, np.array(turned_rad)


def refinement(model: "pycolmap.Reconstruction", cameras: tuple[Camera, ...]) -> str:
    """The change of a model's cameras against those given, in words."""
    moved, turned_rad = changes(model, cameras)
    turned_deg = np.degrees(turned_rad)
    return (
        f"refined: the given cameras moved by {moved.mean():.3g} (at most {moved.max():.3g}; metres, or their model's "
        f"unit) and turned by {turned_deg.mean():.2g}° (at most {turned_deg.max():.2g}°); "
        f"{model.compute_mean_reprojection_error():.2f} px are left"
    )
