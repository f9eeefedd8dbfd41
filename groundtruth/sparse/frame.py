"""The metric frame of a reconstruction, from a board of markers or known camera poses."""

from collections.abc import Iterable
from dataclasses import dataclass
from math import ceil
from typing import Literal

import numpy as np

from handbench.calibration.transforms import umeyama
from handbench.groundtruth.board import Board
from handbench.groundtruth.cameras import Camera, camera_in, pycolmap, registered_images
from handbench.groundtruth.markers import Corners
from handbench.support.errors import HandbenchError
from handbench.support.points import MAJORITY, nearest_majority

TRIM = 4.0  # points beyond this many times the median residual are left out of the fit
# a majority is used if its median residual is smaller by this factor
FAR_BETTER = 2.0
FEWEST_FOR_MAJORITY = 8  # points; of fewer, three agree with a fourth and fifth by chance
COLLINEAR = 0.02  # ratio of the second to the first extent below which points count as a line
LARGEST_MISFIT = 0.03  # root mean square residual relative to the extent of the points
FARTHEST_M = 1e4  # of a camera from the origin: beyond, single precision has steps of a millimetre
CORNER_ERROR_PX = 2.0  # of a marker's corner in one photograph, against those in the others


@dataclass(frozen=True)
class Scale:
    """Source of the metric scale, and quality of its fit.

    features: number of board corners or camera centres that were compared. used: how many of them
    remained after outliers were removed. residual_m: root mean square residual of these after the
    fit (None: unknown).
    """

    source: Literal["board", "poses", "none"]
    features: int = 0
    used: int = 0
    residual_m: float | None = None


def require_near(cameras: Iterable[Camera]) -> None:
    """Raise HandbenchError for a camera that is more than 10 km (FARTHEST_M) from the origin."""
    far_m = max(
        (np.linalg.norm(camera.centre_m) for camera in cameras if camera.posed), default=0.0
    )
    if not far_m <= FARTHEST_M:
        raise HandbenchError(
            f"cameras: are {far_m:.3g} m from the origin of their frame; expected at most "
            f"{FARTHEST_M:g} m; subtract one position from all positions"
        )


def board_from_model(
    model: "pycolmap.Reconstruction", seen: dict[str, Corners], board: Board
) -> tuple[np.ndarray, Scale]:
    """Fit the similarity transform from the reconstruction's frame to the board's frame.

    The board's corners are triangulated in the reconstruction and compared with their known
    positions. seen: pixels of the corners, by the photograph's name. Returns the transform's matrix
    [4, 4] and the quality of the fit. Raises HandbenchError for too few corners or a bad fit.
    """
    observed: dict[tuple[int, int], list[tuple[np.ndarray, pycolmap.Image]]] = {}
    for image in registered_images(model):
        for corner, pixel in seen.get(image.name, {}).items():
            observed.setdefault(corner, []).append((pixel, image))
    points = {
        corner: triangulate(rays) for corner, rays in sorted(observed.items()) if len(rays) > 1
    }
    points = {corner: point for corner, point in points.items() if point is not None}
    known = board.corners_m()
    target_m = np.array([known[marker][k] for marker, k in points]).reshape(-1, 3)
    source = np.array(list(points.values())).reshape(-1, 3)
    matrix, kept, residuals_m = trimmed_similarity(source, target_m, "board corners")
    return matrix, Scale("board", len(kept), int(kept.sum()), _rms(residuals_m[kept]))


def poses_from_model(
    model: "pycolmap.Reconstruction", cameras: tuple[Camera, ...]
) -> tuple[np.ndarray, Scale]:
    """Fit the similarity transform from the reconstruction's frame to the frame of known camera
    poses, by the cameras' projection centres.

    Returns the transform's matrix [4, 4] and the quality of the fit. Raises HandbenchError for too
    few known poses or a bad fit.
    """
    known = {camera.name: camera.centre_m for camera in cameras if camera.posed}
    images = [image for image in registered_images(model) if image.name in known]
    source = np.reshape([image.projection_center() for image in images], (-1, 3))
    target_m = np.reshape([known[image.name] for image in images], (-1, 3))
    matrix, kept, residuals_m = trimmed_similarity(
        source, target_m, "registered cameras with known poses"
    )
    return matrix, Scale("poses", len(kept), int(kept.sum()), _rms(residuals_m[kept]))


def trimmed_similarity(
    source: np.ndarray, target_m: np.ndarray, what: str
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Fit a similarity transform (4×4) from points source [n, 3] to target_m [n, 3] (metres),
    without outliers.

    Outliers are found by repeated fits that start with all points. If a similarity through three
    points fits a majority of the points much better (Rousseeuw 1984), the fits start with that
    majority. what: name of the points, for messages. Returns the matrix, the mask [n] of the points
    used, and the residuals [n] of all points, metres. Raises HandbenchError for fewer than three
    points, for points on a line, if a mirror image would explain the outliers, and if the residuals
    are too large.
    """
    if len(source) < 3 or _collinear(target_m):
        raise HandbenchError(
            f"scale: has only {len(source)} {what}; expected at least three that are not on a "
            "line; add photographs that show the board, or give "
            "--unscaled"
        )
    matrix, kept, residuals_m = _agreeing(source, target_m)
    far_m = LARGEST_MISFIT * np.ptp(target_m, axis=0).max()
    # a majority in a plane equals its mirror image, so points outside it decide
    far = int((residuals_m > far_m).sum())
    if far and 2 * int((_agreeing(source * [1, 1, -1], target_m)[2] > far_m).sum()) < far:
        raise HandbenchError(
            f"scale: {far} of {len(source)} {what} are where a mirror image of the others would "
            "be; check that their coordinates are in a right-handed frame"
        )
    check_fit(_rms(residuals_m[kept]), float(np.ptp(target_m[kept], axis=0).max()), what)
    return matrix, kept, residuals_m


def _agreeing(
    source: np.ndarray, target_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Fit a similarity transform from source [n, 3] to target_m [n, 3] without outliers, starting
    with all points or, if that fits much better, with a majority.

    Returns the matrix, the mask [n] of the points used, and the residuals [n] of all points,
    metres. The quality of the fit is not checked.
    """
    found = _trimmed(source, target_m, np.ones(len(source), dtype=bool))
    if len(source) < FEWEST_FOR_MAJORITY:
        return found
    other = _trimmed(source, target_m, _majority(source, target_m))
    return other if FAR_BETTER * np.median(other[2]) < np.median(found[2]) else found


def _trimmed(
    source: np.ndarray, target_m: np.ndarray, kept: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Fit a similarity transform from source [n, 3] to target_m [n, 3] and remove outliers,
    repeatedly.

    kept [n]: mask of the points in the first fit. Returns the matrix, the mask [n] of the points
    used, and the residuals [n] of all points, metres.
    """
    floor_m = 1e-9 * np.ptp(target_m, axis=0).max()
    for _ in range(20):
        matrix = umeyama(source[kept], target_m[kept], with_scale=True)
        residuals_m = _residuals_m(matrix, source, target_m)
        inside = residuals_m <= TRIM * np.median(residuals_m) + floor_m
        if (inside == kept).all() or inside.sum() < 3 or _collinear(target_m[inside]):
            break
        kept = inside
    return matrix, kept, residuals_m


def _majority(source: np.ndarray, target_m: np.ndarray) -> np.ndarray:
    """Return a mask [n] of the majority of points that agree best with a similarity transform."""

    def usable(chosen: np.ndarray) -> bool:
        return not (_collinear(source[chosen]) or _collinear(target_m[chosen]))

    def residuals_m(chosen: np.ndarray) -> np.ndarray:
        matrix = umeyama(source[chosen], target_m[chosen], with_scale=True)
        return _residuals_m(matrix, source, target_m)

    count = len(source)
    best = nearest_majority(count, ceil(MAJORITY * count), usable, residuals_m)
    return np.isin(np.arange(count), best)


def _residuals_m(matrix: np.ndarray, source: np.ndarray, target_m: np.ndarray) -> np.ndarray:
    return np.linalg.norm(source @ matrix[:3, :3].T + matrix[:3, 3] - target_m, axis=1)


def check_fit(residual_m: float, extent_m: float, what: str) -> None:
    """Raise HandbenchError if the residual of a fit exceeds 3 % of the extent of the fitted points.
    what: name of the points, for the message."""
    if residual_m > LARGEST_MISFIT * extent_m:
        raise HandbenchError(
            f"scale: {what} are {1e3 * residual_m:.1f} mm off after the best fit, "
            f"{residual_m / extent_m:.0%} of their extent; expected at most {LARGEST_MISFIT:.0%}; "
            "check that the numbers belong to these photographs, are in metres, that R, t lead "
            "from world to camera, and that the photographs were taken from different places"
        )


def apply(model: "pycolmap.Reconstruction", matrix: np.ndarray) -> None:
    """Transform the points and cameras of a reconstruction by a similarity matrix [4, 4], in
    place."""
    scale = float(np.cbrt(np.linalg.det(matrix[:3, :3])))
    model.transform(
        pycolmap.Sim3d(scale, pycolmap.Rotation3d(matrix[:3, :3] / scale), matrix[:3, 3])
    )


def triangulate(observed: "list[tuple[np.ndarray, pycolmap.Image]]") -> np.ndarray | None:
    """Triangulate a point from the pixels at which photographs show it.

    observed: pairs of pixel [2] and photograph; those that disagree with the others are left out.
    Returns the point [3], or None if it cannot be triangulated.
    """
    options = pycolmap.EstimateTriangulationOptions()
    options.residual_type = pycolmap.TriangulationResidualType.REPROJECTION_ERROR
    options.ransac.max_error = CORNER_ERROR_PX
    options.ransac.random_seed = 0
    found = pycolmap.estimate_triangulation(
        np.array([pixel for pixel, _ in observed]),
        [image.cam_from_world() for _, image in observed],
        [camera_in(image) for _, image in observed],
        options,
    )
    return None if found is None else np.asarray(found["xyz"]).ravel()


def _collinear(points_m: np.ndarray) -> bool:
    extents = np.linalg.svd(points_m - points_m.mean(axis=0), compute_uv=False)
    return bool(extents[1] <= COLLINEAR * extents[0])


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
