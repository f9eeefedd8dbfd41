"""The sparse stage: registered cameras and points in the metric frame, with the covariance of the
cameras."""

from __future__ import annotations

import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from handbench.groundtruth.cameras.camera_files import cameras_in, load_model, write_model
from handbench.groundtruth.cameras.cameras import Camera, pycolmap, registered_images
from handbench.groundtruth.options import SparseOptions
from handbench.groundtruth.photos.photos import Photo
from handbench.groundtruth.sparse.adjust import CameraCovariance, adjust, camera_covariance
from handbench.groundtruth.sparse.bundle import Bundle
from handbench.groundtruth.sparse.frame import (
    Scale,
    apply,
    board_from_model,
    poses_from_model,
    require_near,
)
from handbench.groundtruth.sparse.inputs import SparseInputs
from handbench.groundtruth.sparse.sfm import (
    DATABASE,
    Lenses,
    scales_px,
    structure_from_motion,
    triangulate_known_poses,
)
from handbench.support.errors import HandbenchError
from handbench.support.files import read_json, write_json
from handbench.support.progress import say

SCALE, COVARIANCE = "scale.json", "covariance.npz"
SMALLEST_BASELINE = 0.03  # distance between cameras over distance to the scene
INTRINSICS = tuple(range(8))  # places among the parameters of COLMAP's camera OPENCV


@dataclass(frozen=True)
class Sparse:
    """Result of the sparse stage.

    model: COLMAP model with the registered cameras and the points. scale: where its metric scale
    comes from. known: joint covariance of its cameras.
    """

    model: pycolmap.Reconstruction
    scale: Scale
    known: CameraCovariance

    def save(self, folder: Path) -> None:
        """Write model, scale and covariance into a folder."""
        write_model(self.model, folder)
        write_json(folder / SCALE, asdict(self.scale))
        self.known.save(folder / COVARIANCE)

    @classmethod
    def load(cls, folder: Path) -> Sparse:
        """Read a result from a folder into which `save` wrote it."""
        model = pycolmap.Reconstruction(str(folder))
        scale = Scale(**read_json(folder / SCALE, "a sparse stage's scale"))
        return cls(model, scale, CameraCovariance.load(folder / COVARIANCE))

    def cameras(self) -> tuple[Camera, ...]:
        """Return the cameras of the registered photographs, with lens and pose, sorted by name."""
        return cameras_in(self.model)


def register(inputs: SparseInputs, options: SparseOptions) -> Sparse:
    """Find the cameras of the photographs, or load their COLMAP model, and transform cameras and
    points to the metric frame.

    A bundle adjustment, which includes the board's corners, improves cameras and points; given
    poses stay unchanged. Returns the model with the covariance of its cameras. Raises
    HandbenchError if the cameras hardly moved between photographs, if they are more than 10 km from
    the origin, or if nothing gives a consistent scale.
    """
    with tempfile.TemporaryDirectory(prefix="handbench-") as scratch:
        model = (_found if inputs.model is None else _given)(inputs, options, Path(scratch))
        database = Path(scratch) / DATABASE
        scales = scales_px(database) if database.exists() else {}
    require_near(cameras_in(model))
    warn_of_unregistered(inputs.photos, model)
    check_geometry(model)
    board = inputs.board
    seen = (
        inputs.corners,
        {} if board is None else board.corners_m(),
        _free(model, inputs, options),
        scales,
    )
    if board is not None:
        scale = _to_metric_frame(model, inputs, options)
    # given poses are not adjusted
    if not (inputs.posed or (board is None and inputs.model is not None)):
        adjust(model, *seen)
    if board is None:
        scale = _to_metric_frame(model, inputs, options)
    return Sparse(model, scale, camera_covariance(Bundle(model, *seen), scale))


def warn_of_unregistered(
    photos: tuple[Photo, ...], model: pycolmap.Reconstruction
) -> tuple[str, ...]:
    """Return the names of the photographs that are not registered in a model, and print them as a
    warning if there are any."""
    known = {image.name for image in registered_images(model)}
    names = tuple(photo.name for photo in photos if photo.name not in known)
    if names:
        say(
            f"these photographs could not be registered and are not used: {', '.join(names)} (too "
            "little overlap with the others, or another scene)"
        )
    return names


def check_geometry(model: pycolmap.Reconstruction) -> None:
    """Raise HandbenchError if the cameras hardly moved compared with their distance to the scene.
    Such photographs can be registered but contain no depth."""
    images = [image for image in registered_images(model) if image.num_points3D]
    centres = np.array([image.projection_center() for image in images])
    reach = [np.linalg.norm(centres - centre, axis=1).max() for centre in centres]
    seen = [
        [model.points3D[p.point3D_id].xyz for p in image.points2D if p.has_point3D()]
        for image in images
    ]
    depths = [
        np.median(np.linalg.norm(np.array(xyz) - c, axis=1))
        for xyz, c in zip(seen, centres, strict=True)
    ]
    moved = np.median([far / depth for far, depth in zip(reach, depths, strict=True)] or [0])
    if moved < SMALLEST_BASELINE:
        raise HandbenchError(
            f"photographs: the cameras moved by only {moved:.2%} of the distance to the scene; "
            f"expected at least {SMALLEST_BASELINE:.0%}; take the photographs from different "
            "places, 10° to 30° apart, because turning a camera on the spot shows no depth"
        )


def _given(inputs: SparseInputs, options: SparseOptions, scratch: Path) -> pycolmap.Reconstruction:
    """Load the COLMAP model that the inputs name. If it has no points, they are triangulated with
    its cameras, which do not change. scratch: empty folder for COLMAP's database."""
    assert inputs.model is not None
    model = load_model(inputs.model, inputs.photos)
    if model.num_points3D():
        return model
    cameras = cameras_in(model)
    names = {camera.name for camera in cameras}
    return triangulate_known_poses(
        tuple(p for p in inputs.photos if p.name in names), cameras, scratch, options.seed
    )


def _found(inputs: SparseInputs, options: SparseOptions, scratch: Path) -> pycolmap.Reconstruction:
    if inputs.posed and inputs.cameras is not None:
        return triangulate_known_poses(inputs.photos, inputs.cameras, scratch, options.seed)
    found_px, shared = inputs.focal_lengths_px(), options.shared_intrinsics
    lenses = Lenses(inputs.cameras, options.intrinsics, found_px, shared)
    return structure_from_motion(inputs.photos, scratch, lenses, options.seed)


def _free(
    model: pycolmap.Reconstruction, inputs: SparseInputs, options: SparseOptions
) -> tuple[int, ...]:
    """Return the indices of the intrinsics to estimate among the parameters of COLMAP's lens model
    OPENCV; empty if all intrinsics are known. The model's cameras of the lens model RADIAL are
    converted to OPENCV, in place."""
    if any(known is not None for known in (inputs.cameras, inputs.model, options.intrinsics)):
        return ()
    for camera in model.cameras.values():
        # one focal length and radial distortion only: initial values of the other parameters
        if camera.model_name == "RADIAL":
            f, cx, cy, k1, k2 = camera.params
            camera.model, camera.params = (
                pycolmap.CameraModelId.OPENCV,
                [f, f, cx, cy, k1, k2, 0, 0],
            )
    return INTRINSICS


def _to_metric_frame(
    model: pycolmap.Reconstruction, inputs: SparseInputs, options: SparseOptions
) -> Scale:
    """Transform a model to the metric frame, in place, and return the source of the scale."""
    if inputs.board is not None:
        matrix, scale = board_from_model(model, inputs.corners, inputs.board)
    elif inputs.model is not None and options.metric:
        return Scale("model")
    elif options.unscaled:
        return Scale("none")
    elif inputs.posed:
        count = len(registered_images(model))
        return Scale("poses", count, count, 0.0)
    else:
        matrix, scale = poses_from_model(model, inputs.cameras or ())
    apply(model, matrix)
    return scale
