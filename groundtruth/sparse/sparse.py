"""The sparse stage: registered cameras and points in the metric frame, and how well the cameras are known."""

from __future__ import annotations

import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from groundtruth.cameras.camera_files import camera_of, load_model
from groundtruth.cameras.cameras import Camera, load_pycolmap, registered
from groundtruth.cameras.model_files import write_model
from groundtruth.options import SparseOptions
from groundtruth.photos.photos import Photo
from groundtruth.sparse.adjust import adjust
from groundtruth.sparse.bundle import Bundle
from groundtruth.sparse.covariance import CameraCovariance, camera_covariance
from groundtruth.sparse.frame import Scale, apply, board_from_model, distances_from_model, poses_from_model
from groundtruth.sparse.inputs import Inputs
from groundtruth.sparse.sfm import structure_from_motion
from radar.support.errors import HandbenchError
from radar.support.files import read_json, write_json
from radar.support.progress import say

if TYPE_CHECKING:
    import pycolmap

SCALE, COVARIANCE = "scale.json", "covariance.npz"
SMALLEST_BASELINE = 0.03  # distance between cameras over distance to the scene
DISTORTION, INTRINSICS = (4, 5, 6, 7), tuple(range(8))  # places among the parameters of COLMAP's camera OPENCV


@dataclass(frozen=True)
class Sparse:
    """A COLMAP model in the mesh's frame, where its scale comes from, and how well its cameras are known."""

    model: pycolmap.Reconstruction
    scale: Scale
    known: CameraCovariance

    def save(self, folder: Path) -> None:
        """Write everything into a folder."""
        write_model(self.model, folder)
        write_json(folder / SCALE, asdict(self.scale))
        self.known.save(folder / COVARIANCE)

    @classmethod
    def load(cls, folder: Path) -> Sparse:
        """Read what `save` wrote."""
        model = load_pycolmap().Reconstruction(str(folder))
        scale = Scale(**read_json(folder / SCALE, "a sparse stage's scale"))
        return cls(model, scale, CameraCovariance.load(folder / COVARIANCE))

    def cameras(self) -> tuple[Camera, ...]:
        """The registered photographs' cameras, by name."""
        return tuple(camera_of(image) for image in registered(self.model))


def register(inputs: Inputs, options: SparseOptions) -> Sparse:
    """The photographs' model, found or given, adjusted and carried into the metric frame; a board, which is known in
    that frame, takes part in the adjustment."""
    model = load_model(inputs.model, inputs.photos) if inputs.model is not None else _found(inputs, options)
    unregistered(inputs.photos, model)
    check_geometry(model)
    free = _free(model, inputs, options)
    corners_m = {} if inputs.board is None else inputs.board.corners_m()
    if inputs.board is not None:
        scale = _to_metric_frame(model, inputs, options)
        adjust(model, inputs.corners, corners_m, free)
    else:
        if inputs.model is None:  # a given one is taken at its word
            adjust(model, {}, {}, free)
        scale = _to_metric_frame(model, inputs, options)
    return Sparse(model, scale, camera_covariance(Bundle(model, inputs.corners, corners_m, free), scale))


def unregistered(photos: tuple[Photo, ...], model: pycolmap.Reconstruction) -> tuple[str, ...]:
    """Names of the photographs that are not part of a reconstruction; said aloud."""
    known = {image.name for image in registered(model)}
    names = tuple(photo.name for photo in photos if photo.name not in known)
    if names:
        say(f"not registered, and not used: {', '.join(names)} (too little overlap with the others, or another scene)")
    return names


def check_geometry(model: pycolmap.Reconstruction) -> None:
    """A HandbenchError when the cameras hardly moved, against the distance of what they see: such photographs register,
    and carry no depth."""
    images = [image for image in registered(model) if image.num_points3D]
    centres = np.array([image.projection_center() for image in images])
    reach = [np.linalg.norm(centres - image.projection_center(), axis=1).max() for image in images]
    moved = np.median([far / _depth(image, model) for far, image in zip(reach, images, strict=True)] or [0])
    if moved < SMALLEST_BASELINE:
        raise HandbenchError(
            f"photographs: the cameras moved by {moved:.2%} of the distance to the scene only, {SMALLEST_BASELINE:.0%} "
            "are needed; turning a camera on the spot shows no depth: take the photographs from different places, 10° "
            "to 30° apart"
        )


def _depth(image: pycolmap.Image, model: pycolmap.Reconstruction) -> float:
    """Median distance of the points that a photograph sees."""
    points = np.array([model.points3D[p.point3D_id].xyz for p in image.points2D if p.has_point3D()])
    return float(np.median(np.linalg.norm(points - image.projection_center(), axis=1)))


def _found(inputs: Inputs, options: SparseOptions) -> pycolmap.Reconstruction:
    with tempfile.TemporaryDirectory(prefix="handbench-") as scratch:
        return structure_from_motion(
            inputs.photos,
            Path(scratch),
            cameras=inputs.cameras,
            intrinsics=options.intrinsics,
            focal_px=inputs.focal_lengths_px(),
            guessed_focal_px=inputs.guessed_focal_lengths_px(),
            seed=options.seed,
        )


def _free(model: pycolmap.Reconstruction, inputs: Inputs, options: SparseOptions) -> tuple[int, ...]:
    """The intrinsics that nobody has given; lenses that COLMAP's camera OPENCV does not describe are held."""
    if inputs.cameras is not None or inputs.model is not None:
        return ()
    _as_opencv(model)
    return DISTORTION if options.intrinsics is not None else INTRINSICS


def _as_opencv(model: pycolmap.Reconstruction) -> None:
    """Give cameras of one focal length and radial distortion alone the parameters that are still missing."""
    for camera in model.cameras.values():
        if camera.model_name == "RADIAL":
            f, cx, cy, k1, k2 = camera.params
            camera.model, camera.params = load_pycolmap().CameraModelId.OPENCV, [f, f, cx, cy, k1, k2, 0, 0]


def _to_metric_frame(model: pycolmap.Reconstruction, inputs: Inputs, options: SparseOptions) -> Scale:
    if inputs.board is not None:
        matrix, scale = board_from_model(model, inputs.corners, inputs.board)
    elif options.distances:
        matrix, scale = distances_from_model(model, options.distances)
    elif inputs.model is not None and options.metric:
        return Scale("model")
    elif not options.unscaled:
        matrix, scale = poses_from_model(model, inputs.cameras or ())
    else:
        return Scale("none")
    apply(model, matrix)
    return scale
