"""The sparse stage: registered cameras and points in the metric frame, with the covariance of the
cameras."""

from __future__ import annotations

import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.distance import cdist

from handbench.groundtruth.camera_files import cameras_in, write_model
from handbench.groundtruth.cameras import Camera, pycolmap, registered_images
from handbench.groundtruth.options import Lenses, SparseOptions
from handbench.groundtruth.photos import FEWEST, Photo
from handbench.groundtruth.sparse.adjust import adjust, camera_covariance
from handbench.groundtruth.sparse.frame import Scale, apply, board_from_model, poses_from_model
from handbench.groundtruth.sparse.inputs import Known
from handbench.groundtruth.sparse.sfm import structure_from_motion, triangulate_known_poses
from handbench.support.errors import HandbenchError
from handbench.support.files import KEPT_BYTES, read_json, read_npz, write_json, write_npz
from handbench.support.progress import say

SCALE, COVARIANCE = "scale.json", "covariance.npz"
SMALLEST_BASELINE = 0.03  # distance between cameras over distance to the scene
# median distance of the board's corners beyond which other lenses are tried, and factor by which
# they must lower it
SUSPICIOUS_PX = 0.5
FAR_BETTER = 2.0
INTRINSICS = 8  # parameters of COLMAP's lens model OPENCV


@dataclass(frozen=True)
class Sparse:
    """Result of the sparse stage.

    model: COLMAP model with the registered cameras and the points. scale: where its metric scale
    comes from. covariance [d, d]: joint covariance of its cameras' parameters.
    """

    model: pycolmap.Reconstruction
    scale: Scale
    covariance: np.ndarray

    def save(self, folder: Path) -> None:
        """Write model, scale and covariance into a folder."""
        write_model(self.model, folder)
        write_json(folder / SCALE, asdict(self.scale))
        write_npz(folder / COVARIANCE, matrix=self.covariance)

    @classmethod
    def load(cls, folder: Path) -> Sparse:
        """Read a result from a folder into which `save` wrote it."""
        model = pycolmap.Reconstruction(str(folder))
        scale = Scale(**read_json(folder / SCALE, "a sparse stage's scale"))
        arrays = read_npz(folder / COVARIANCE, ("matrix",), most=KEPT_BYTES)
        return cls(model, scale, arrays["matrix"])

    def cameras(self) -> tuple[Camera, ...]:
        """Return the cameras of the registered photographs, with lens and pose, sorted by name."""
        return cameras_in(self.model)


def register(known: Known, options: SparseOptions) -> Sparse:
    """Find the cameras of the photographs, and transform cameras and points to the metric frame.

    If unknown lenses were taken to be the same and the board's corners contradict that, each
    photograph gets its own, if that fits much better. Raises HandbenchError if the cameras hardly
    moved between photographs, or if nothing gives a consistent scale.
    """
    may_differ = options.lenses == "auto" and not known.cameras and known.board is not None
    try:
        shared = _solved(known, options.lenses, options.seed)
    except HandbenchError as error:
        if not may_differ:
            raise
        say(f"{error}; lenses: each photograph is given its own")
        return _solved(known, "each", options.seed)
    shared_px = board_error_px(shared.model, known)
    if not may_differ or shared_px < SUSPICIOUS_PX:
        return shared
    try:
        apart = _solved(known, "each", options.seed)
    except HandbenchError as error:
        say(f"lenses: the board's corners are {shared_px:.2f} px off, but {error}")
        return shared
    apart_px = board_error_px(apart.model, known)
    better = FAR_BETTER * apart_px < shared_px and len(apart.cameras()) >= len(shared.cameras())
    say(
        f"lenses: the board's corners are {shared_px:.2f} px off if photographs share lenses, and "
        f"{apart_px:.2f} px if each has its own, which is {'' if better else 'not '}used"
    )
    return apart if better else shared


def _solved(known: Known, lenses: Lenses, seed: int) -> Sparse:
    """Register the photographs and transform them to the metric frame.

    A bundle adjustment, which includes the board's corners, improves cameras and points. It does
    not change given poses, unless a board gives the scale that they lack.
    """
    with tempfile.TemporaryDirectory(prefix="handbench-") as scratch:
        if known.posed:
            model = triangulate_known_poses(known, Path(scratch), seed)
        else:
            model = structure_from_motion(known, Path(scratch), lenses, seed)
    warn_of_unregistered(known.photos, model)
    check_geometry(model)
    board, lens = known.board, 0 if known.cameras else _all_free(model)
    seen = (known.corners, {} if board is None else board.corners_m(), lens)
    if board is not None:
        scale = _to_metric_frame(model, known)
    if not known.posed or not (known.metric or board is None):
        adjust(model, *seen)
    if board is None:
        scale = _to_metric_frame(model, known)
    return Sparse(model, scale, camera_covariance(model, *seen, scale))


def board_error_px(model: pycolmap.Reconstruction, known: Known) -> float:
    """Return the median distance in pixels of the board's corners from where the cameras of a model
    in the board's frame show them; 0 without a board."""
    corners_m = {} if known.board is None else known.board.corners_m()
    off_px = [
        float(np.linalg.norm(pixel - shown))
        for image in registered_images(model)
        for (marker, k), pixel in known.corners.get(image.name, {}).items()
        if (shown := image.project_point(corners_m[marker][k])) is not None
    ]
    return float(np.median(off_px or [0.0]))


def warn_of_unregistered(photos: tuple[Photo, ...], model: pycolmap.Reconstruction) -> None:
    """Print a warning that names the photographs that are not registered in a model, if any."""
    registered = {image.name for image in registered_images(model)}
    names = [photo.name for photo in photos if photo.name not in registered]
    if names:
        say(
            f"these photographs could not be registered and are not used: {', '.join(names)} (too "
            "little overlap with the others, or another scene)"
        )


def check_geometry(model: pycolmap.Reconstruction) -> None:
    """Raise HandbenchError if the cameras hardly moved compared with their distance to the scene.
    Such photographs can be registered but contain no depth."""
    centres = np.array([image.projection_center() for image in registered_images(model)])
    points = np.array([point.xyz for point in model.points3D.values()]).reshape(-1, 3)
    reach, depth = cdist(centres, centres).max(axis=1), cdist(centres, points)
    moved = np.median(reach / np.median(depth, axis=1)) if len(points) else 0.0
    if moved < SMALLEST_BASELINE:
        raise HandbenchError(
            f"photographs: the cameras moved by only {moved:.2%} of the distance to the scene; "
            f"expected at least {SMALLEST_BASELINE:.0%}; take the photographs from different "
            "places, 10° to 30° apart, because turning a camera on the spot shows no depth"
        )


def _all_free(model: pycolmap.Reconstruction) -> int:
    """Convert a model's cameras from COLMAP's lens model RADIAL to OPENCV, in place. Returns the
    number of its parameters, which are to be estimated."""
    for camera in model.cameras.values():
        f, cx, cy, k1, k2 = camera.params
        camera.model = pycolmap.CameraModelId.OPENCV
        camera.params = [f, f, cx, cy, k1, k2, 0, 0]
    return INTRINSICS


def _to_metric_frame(model: pycolmap.Reconstruction, known: Known) -> Scale:
    """Transform a model to the metric frame, in place, and return the source of the scale."""
    posed = [camera for camera in known.cameras if camera.posed and known.metric]
    if known.board is not None:
        matrix, scale = board_from_model(model, known.corners, known.board)
    elif known.posed and known.metric:
        return Scale("poses", len(posed), len(posed), 0.0)
    elif len(posed) < FEWEST:
        return Scale("none")
    else:
        matrix, scale = poses_from_model(model, known.cameras)
    apply(model, matrix)
    return scale
