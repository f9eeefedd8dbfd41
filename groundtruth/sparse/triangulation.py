"""Sparse points of photographs whose cameras and poses are known: matches that the poses explain, triangulated."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from groundtruth.cameras.camera_files import FEWEST_POINTS
from groundtruth.cameras.cameras import Camera, pycolmap, registered, set_pose
from groundtruth.photos.photos import FEWEST, Photo
from groundtruth.sparse.features import DATABASE, Lenses, agreement, find_features, match
from radar.support.errors import HandbenchError
from radar.support.progress import say

LEAST_AGREEING = 0.5  # of the matches, with the poses: wrong ones have a quarter, since epipolar lines are alike


def triangulated(
    photos: tuple[Photo, ...], cameras: tuple[Camera, ...], folder: Path, seed: int = 0
) -> pycolmap.Reconstruction:
    """The model of photographs with known cameras (all with R, t), which stay as they are bit for bit; `folder` (empty)
    receives COLMAP's database.

    Photographs that see next to nothing are left out. HandbenchError when the features do not fit the poses.
    """
    pycolmap.logging.minloglevel = int(pycolmap.logging.FATAL)
    pycolmap.set_random_seed(seed)
    database = folder / DATABASE
    find_features(photos, database, Lenses(cameras))
    model = _without_points(database, {camera.name: camera for camera in cameras})
    match(database, seed)
    _require_agreement(photos, agreement(database, model))
    options = pycolmap.IncrementalPipelineOptions(random_seed=seed, extract_colors=False, num_threads=1)
    options.mapper.random_seed = options.triangulation.random_seed = seed
    options.triangulation.ignore_two_view_tracks = False
    say("triangulating")
    model = pycolmap.triangulate_points(model, database, photos[0].path.parent, folder, options=options)
    for image in registered(model):
        if image.num_points3D < FEWEST_POINTS:
            model.deregister_frame(image.frame_id)
    if len(registered(model)) < FEWEST:
        raise HandbenchError(
            f"{photos[0].path.parent}: {len(registered(model))} of {len(photos)} photographs see {FEWEST_POINTS} "
            f"points with the given poses, {FEWEST} are needed; take photographs with more overlap and texture"
        )
    given = {camera.name: camera for camera in cameras}
    for image in registered(model):  # back to where it was given: COLMAP scales its models, and back
        set_pose(image, _pose(given[image.name]))
    error_px = model.compute_mean_reprojection_error()
    say(
        f"{model.num_points3D()} points of {len(registered(model))} photographs with known poses, {error_px:.2f} px off"
    )
    return model


def _without_points(database: Path, cameras: dict[str, Camera]) -> pycolmap.Reconstruction:
    """The cameras as COLMAP's model, with the database's numbers."""
    model = pycolmap.Reconstruction()
    with pycolmap.Database.open(database) as stored:
        for camera in stored.read_all_cameras():
            model.add_camera_with_trivial_rig(camera)
        for image in stored.read_all_images():
            model.add_image_with_trivial_frame(image, _pose(cameras[image.name]))
    return model


def _pose(camera: Camera) -> pycolmap.Rigid3d:
    return pycolmap.Rigid3d(pycolmap.Rotation3d(camera.rotation), camera.translation_m)


def _require_agreement(photos: tuple[Photo, ...], share: float) -> None:
    if share < LEAST_AGREEING:
        raise HandbenchError(
            f"{photos[0].path.parent}: {share:.0%} of the matched features agree with the given poses, "
            f"{LEAST_AGREEING:.0%} are needed; check that R, t carry world to camera (x right, y down, z forward) and "
            "belong to these photographs, or leave them out"
        )


def changes(model: pycolmap.Reconstruction, cameras: tuple[Camera, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Distances [n] of a model's cameras from those given, and angles [n] between them, radians."""
    given = {camera.name: camera for camera in cameras}
    pairs = [(image, given[image.name]) for image in registered(model) if image.name in given]
    moved = np.array([np.linalg.norm(image.projection_center() - camera.centre_m) for image, camera in pairs])
    turned_rad = [image.cam_from_world().rotation.angle_to(_pose(camera).rotation) for image, camera in pairs]
    return moved, np.array(turned_rad)


def refinement(model: pycolmap.Reconstruction, cameras: tuple[Camera, ...]) -> str:
    """The change of a model's cameras against those given, in words."""
    moved, turned_rad = changes(model, cameras)
    turned_deg = np.degrees(turned_rad)
    return (
        f"refined: the given cameras moved by {moved.mean():.3g} (at most {moved.max():.3g}; metres, or their model's "
        f"unit) and turned by {turned_deg.mean():.2g}° (at most {turned_deg.max():.2g}°); "
        f"{model.compute_mean_reprojection_error():.2f} px are left"
    )
