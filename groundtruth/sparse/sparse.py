"""The sparse stage: registered cameras and points in the metric frame, with the covariance of the
cameras."""

from __future__ import annotations

import tempfile
from dataclasses import asdict, dataclass, field
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
    distances_from_model,
    origin_near,
    poses_from_model,
    shift,
)
from handbench.groundtruth.sparse.inputs import SparseInputs
from handbench.groundtruth.sparse.sfm import (
    DATABASE,
    Lenses,
    camera_changes,
    describe_refinement,
    scales_px,
    structure_from_motion,
    triangulate_known_poses,
)
from handbench.support.errors import HandbenchError
from handbench.support.files import read_json, write_json
from handbench.support.progress import say

SCALE, ORIGIN, COVARIANCE = "scale.json", "origin.json", "covariance.npz"
SMALLEST_BASELINE = 0.03  # distance between cameras over distance to the scene
# places among the parameters of COLMAP's camera OPENCV
DISTORTION, INTRINSICS = ((4, 5, 6, 7), tuple(range(8)))


@dataclass(frozen=True)
class Sparse:
    """Result of the sparse stage.

    model: COLMAP model with the registered cameras and the points. scale: where its metric scale
    comes from. known: joint covariance of its cameras. origin_m [3]: position of the model's origin
    in the mesh's frame. It is zero unless the cameras are far from the mesh's origin (coordinates
    of a survey), where libraries of single precision would not resolve the surface.
    """

    model: pycolmap.Reconstruction
    scale: Scale
    known: CameraCovariance
    origin_m: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def save(self, folder: Path) -> None:
        """Write model, scale, origin and covariance into a folder."""
        write_model(self.model, folder)
        write_json(folder / SCALE, asdict(self.scale))
        write_json(folder / ORIGIN, self.origin_m.tolist())
        self.known.save(folder / COVARIANCE)

    @classmethod
    def load(cls, folder: Path) -> Sparse:
        """Read a result from a folder into which `save` wrote it."""
        model = pycolmap.Reconstruction(str(folder))
        scale = Scale(**read_json(folder / SCALE, "a sparse stage's scale"))
        origin_m = np.array(read_json(folder / ORIGIN, "a sparse stage's origin"))
        return cls(model, scale, CameraCovariance.load(folder / COVARIANCE), origin_m)

    def cameras(self) -> tuple[Camera, ...]:
        """Return the cameras of the registered photographs, with lens and pose, sorted by name."""
        return cameras_in(self.model)


def register(inputs: SparseInputs, options: SparseOptions) -> Sparse:
    """Find the cameras of the photographs, or load their COLMAP model, and transform cameras and
    points to the metric frame.

    A bundle adjustment, which includes the board's corners, improves cameras and points; given
    poses stay unchanged unless options.refine_poses is set. Returns the model with the covariance
    of its cameras. Raises HandbenchError if the cameras hardly moved between photographs, or if
    nothing gives a consistent scale.
    """
    origin_m = inputs.origin_m
    with tempfile.TemporaryDirectory(prefix="handbench-") as scratch:
        model = (_found if inputs.model is None else _given)(inputs, options, Path(scratch))
        database = Path(scratch) / DATABASE
        scales = scales_px(database) if database.exists() else {}
    if inputs.model is not None:
        origin_m = origin_near(np.array([camera.centre_m for camera in cameras_in(model)]))
        shift(model, -origin_m)
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
        scale, origin_m = _to_metric_frame(model, inputs, options, origin_m)
    # given poses are not adjusted
    given = inputs.posed or (board is None and inputs.model is not None)
    if options.refine_poses or not given:
        before = cameras_in(model)
        adjust(model, *seen)
        if options.refine_poses:  # it stays in the frame of the given cameras
            if board is None:
                apply(model, poses_from_model(model, before)[0])
            say(describe_refinement(model, before))
    if board is None:
        scale, origin_m = _to_metric_frame(model, inputs, options, origin_m)
    return Sparse(model, scale, camera_covariance(Bundle(model, *seen), scale), origin_m)


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
    lenses = Lenses(inputs.cameras, options.intrinsics, options.refine_distortion, found_px, shared)
    return structure_from_motion(inputs.photos, scratch, lenses, options.seed)


def _free(
    model: pycolmap.Reconstruction, inputs: SparseInputs, options: SparseOptions
) -> tuple[int, ...]:
    """Return the indices of the intrinsics to estimate among the parameters of COLMAP's lens model
    OPENCV; empty if all intrinsics are known. The model's cameras of the lens model RADIAL are
    converted to OPENCV, in place."""
    if inputs.cameras is not None or inputs.model is not None:
        return ()
    if options.intrinsics is not None and not options.refine_distortion:
        return ()
    for camera in model.cameras.values():
        # one focal length and radial distortion only: initial values of the other parameters
        if camera.model_name == "RADIAL":
            f, cx, cy, k1, k2 = camera.params
            camera.model, camera.params = (
                pycolmap.CameraModelId.OPENCV,
                [f, f, cx, cy, k1, k2, 0, 0],
            )
    return DISTORTION if options.intrinsics is not None else INTRINSICS


def _to_metric_frame(
    model: pycolmap.Reconstruction,
    inputs: SparseInputs,
    options: SparseOptions,
    origin_m: np.ndarray,
) -> tuple[Scale, np.ndarray]:
    """Transform a model to the metric frame, in place.

    origin_m [3]: position of the model's origin in the frame that its poses were given in. Returns
    the source of the scale, and the position [3] of the model's origin in the metric frame.
    """
    if inputs.board is not None:
        matrix, scale = board_from_model(model, inputs.corners, inputs.board)
        origin_m = np.zeros(3)
    elif options.distances:
        matrix, scale = distances_from_model(model, options.distances)
        origin_m = matrix[:3, :3] @ origin_m
    elif inputs.model is not None and options.metric:
        return Scale("model"), origin_m
    elif inputs.posed and inputs.cameras is not None and not options.unscaled:
        moved_m = camera_changes(model, inputs.cameras)[0]
        rms_m = float(np.sqrt(np.mean(moved_m**2))) if options.refine_poses else 0.0
        return Scale("poses", len(moved_m), len(moved_m), rms_m), origin_m
    elif not options.unscaled:
        matrix, scale = poses_from_model(model, inputs.cameras or ())
        origin_m = inputs.origin_m
    else:
        return Scale("none"), origin_m
    apply(model, matrix)
    return scale, origin_m
