"""Normal equations of the cameras of a model, with the board's corners as points that do not move,
from the derivatives of pixels with respect to points and cameras.

Triggs et al., "Bundle Adjustment – A Modern Synthesis", 2000: Cauchy's weights for outliers, points
eliminated by Schur's complement. Features and corners have separate standard deviations, estimated
from their residuals.

Where a board holds the cameras, features that only two photographs show do not count: false ones
(such as apparent crossings of contours) cannot be detected there, and bias the cameras. Without a
board they count, because cameras far apart have few others.
"""

from functools import partial
from typing import NamedTuple

import numpy as np

from handbench.groundtruth.board import CHESSBOARD
from handbench.groundtruth.cameras import camera_in, pycolmap, registered_images
from handbench.groundtruth.markers import Corners, crossings_of_edges

# standard deviations at which a residual weighs half: 95 % efficient where errors are normal
CAUCHY = 2.385
MAD = 1.4826  # of a normal distribution: standard deviation over median absolute deviation
LEAST_NOISE_PX = 0.03  # of features
# Residuals of corners do not show the errors that corners of one photograph share, along its rows
# and columns of pixels, which reach 0.019 px. So a corner's standard deviation is at least this
# share of a feature's.
LEAST_CORNER = 1 / 16
LEAST_SHARE = 0.05  # least redundancy, relative to the number of residuals, in the noise estimate
FEWEST_SIGHTINGS = 3  # of a feature beside a board; 2 without one, or of three photographs
# directions of a point with less relative information are undetermined and do not move
NOT_SEEN = 1e-12
# Priors of any lens, standard deviations:
CENTRE = 0.01  # of the principal point from the picture's middle, relative to the width
SQUARE = 1e-3  # of fx/fy from 1
RADIAL = 0.2  # of k1, k2
TANGENTIAL = 1e-3  # of p1, p2
# parameters of a pose: translation τ and rotation ω on the camera's side, x → x + τ + ω × x
POSE = 6
STEP = 1e-6  # of differences, relative


class Observations(NamedTuple):
    """Pixels of one photograph that show points_m [n, 3], and their distances off_px [n, 2] from
    the projected points. numbers [n]: of these points in the model; None: corners of the board."""

    image: "pycolmap.Image"
    numbers: np.ndarray | None
    points_m: np.ndarray
    off_px: np.ndarray


class NormalEquations(NamedTuple):
    """Normal equations of a bundle adjustment with cameras of d parameters and n points.

    information [d, d]: of all cameras (inverse covariance), and right [d]: its right side, from
    which the points are eliminated. numbers [n]: of the points in the model; inverses [n, 3, 3],
    coupling [n, d, 3] and points_right [n, 3]: their part.
    """

    information: np.ndarray
    right: np.ndarray
    numbers: np.ndarray
    inverses: np.ndarray
    coupling: np.ndarray
    points_right: np.ndarray

    def points_step(self, step: np.ndarray) -> np.ndarray:
        """Return the step [n, 3] of the points that belongs to a step [d] of the cameras."""
        caused = np.einsum("pdi,d->pi", self.coupling, step)
        return np.asarray(np.einsum("pij,pj->pi", self.inverses, self.points_right - caused))


def parameter_places(images: "list[pycolmap.Image]", lens: int) -> list[np.ndarray]:
    """Return the indices of each photograph's parameters among those of all cameras: six of its
    pose, then `lens` intrinsics, which photographs with the same camera share."""
    cameras = sorted({image.camera_id for image in images})
    first = [POSE * len(images) + lens * cameras.index(image.camera_id) for image in images]
    return [
        np.r_[POSE * i : POSE * (i + 1), of_lens : of_lens + lens]
        for i, of_lens in enumerate(first)
    ]


def normal_equations(
    model: "pycolmap.Reconstruction",
    corners: dict[str, Corners],
    corners_m: dict[int, np.ndarray],
    lens: int,
) -> NormalEquations:
    """Compute the normal equations of the adjustment of all cameras and points.

    corners: pixels of the board's corners, by the photograph's name. corners_m: positions of the
    corners on the board, by marker. lens: number of intrinsics that are estimated, 0 or the 8 of
    COLMAP's lens model OPENCV; these have priors.
    """
    images = registered_images(model)
    places = parameter_places(images, lens)
    size = 1 + max(int(columns.max()) for columns in places)
    features = _features(model, images, min(FEWEST_SIGHTINGS if corners else 2, len(images) - 1))
    board = [_corners(image, corners.get(image.name, {}), corners_m) for image in images]
    numbers = np.unique(np.concatenate([seen.numbers for seen in features]))
    noise_px = _spread_px(features, 3 * len(numbers) + (0 if corners else size))
    noise_px = max(noise_px, LEAST_NOISE_PX)
    corner_px = np.clip(_spread_px(board, size), LEAST_CORNER * noise_px, noise_px)
    matrix, right = np.zeros((size, size)), np.zeros(size)
    coupling, points = np.zeros((len(numbers), size, 3)), np.zeros((len(numbers), 3, 3))
    points_right = np.zeros((len(numbers), 3))
    for seen, sigma_px in [(s, noise_px) for s in features] + [(s, corner_px) for s in board]:
        columns = places[images.index(seen.image)]
        by_point, by_camera = pixel_jacobians(seen.image, seen.points_m, lens)
        weight = 1 / (sigma_px**2 + (seen.off_px**2).sum(axis=1) / CAUCHY**2)
        weighted = by_camera * weight[:, None, None]
        matrix[np.ix_(columns, columns)] += np.einsum("nia,nib->ab", weighted, by_camera)
        right[columns] += np.einsum("nia,ni->a", weighted, seen.off_px)
        if seen.numbers is not None:
            at = np.searchsorted(numbers, seen.numbers)
            coupling[at[:, None], columns] += np.einsum("nia,nij->naj", weighted, by_point)
            points[at] += np.einsum("n,nia,nij->naj", weight, by_point, by_point)
            points_right[at] += np.einsum("n,nia,ni->na", weight, by_point, seen.off_px)
    if lens:
        cameras = {image.camera_id: image for image in images}.values()
        for image in cameras:
            columns = places[images.index(image)][POSE:]
            slope, off = _lens_prior(camera_in(image))
            matrix[np.ix_(columns, columns)] += slope.T @ slope
            right[columns] += slope.T @ off
    inverses = np.linalg.pinv(points, rcond=NOT_SEEN, hermitian=True)
    eliminated = coupling @ inverses
    rows = [np.swapaxes(part, 1, 2).reshape(-1, size) for part in (eliminated, coupling)]
    matrix -= rows[0].T @ rows[1]
    right -= np.einsum("pdi,pi->d", eliminated, points_right)
    return NormalEquations(matrix, right, numbers, inverses, coupling, points_right)


def _lens_prior(camera: "pycolmap.Camera") -> tuple[np.ndarray, np.ndarray]:
    """Return what is known of any lens: the deviations [8] of an OPENCV camera's parameters from
    what is expected, in standard deviations, and their derivatives [8, 8]."""
    fx, width = camera.params[0], camera.width
    sigma = [np.inf, SQUARE * fx, *[CENTRE * width] * 2, *[RADIAL] * 2, *[TANGENTIAL] * 2]
    slope = np.diag(1 / np.array(sigma))
    slope[1, 0] = -slope[1, 1]
    expected = [fx, fx, width / 2, camera.height / 2, 0, 0, 0, 0]
    return slope, slope @ (expected - np.array(camera.params))


def _features(
    model: "pycolmap.Reconstruction", images: "list[pycolmap.Image]", fewest: int
) -> list[Observations]:
    """Collect the pixels of each photograph that show points with at least `fewest` observations.
    Points behind a camera are left out."""
    # asking the model for each point takes longer
    points_m = {n: p.xyz for n, p in model.points3D.items() if p.track.length() >= fewest}
    features = []
    for image in images:
        shown = [(p.point3D_id, p.xy) for p in image.points2D if p.point3D_id in points_m]
        numbers = np.array([number for number, _ in shown], dtype=int)
        at_m = np.reshape([points_m[number] for number in numbers.tolist()], (-1, 3))
        off_px = np.reshape([pixel for _, pixel in shown], (-1, 2)) - project(image, at_m)
        front = np.isfinite(off_px).all(axis=1)
        features.append(Observations(image, numbers[front], at_m[front], off_px[front]))
    return features


def _corners(
    image: "pycolmap.Image", corners: Corners, corners_m: dict[int, np.ndarray]
) -> Observations:
    """Collect a photograph's corners. Those of markers are compared with the crossings of lines
    through the edges that its lens bends, as they were found. Markers behind the camera are left
    out."""
    shown_px = {marker: project(image, corners_m[marker]) for marker in {m for m, _ in corners}}
    expected_px = {
        marker: pixels
        if marker == CHESSBOARD
        else crossings_of_edges(partial(project, image), corners_m[marker])
        for marker, pixels in shown_px.items()
        if np.isfinite(pixels).all()
    }
    corners = {corner: pixel for corner, pixel in corners.items() if corner[0] in expected_px}
    at_m = np.reshape([corners_m[marker][k] for marker, k in corners], (-1, 3))
    off_px = np.reshape([p - expected_px[m][k] for (m, k), p in corners.items()], (-1, 2))
    return Observations(image, None, at_m, off_px)


def _spread_px(observations: list[Observations], unknowns: int) -> float:
    """Estimate the standard deviation of pixels from the median absolute deviation of their
    residuals, which `unknowns` fitted parameters make smaller."""
    off = np.abs(np.concatenate([seen.off_px for seen in observations]))
    share = max(1 - unknowns / max(off.size, 1), LEAST_SHARE)
    return MAD * float(np.median(off)) / share**0.5 if off.size else 0.0


def project(image: "pycolmap.Image", points_m: np.ndarray) -> np.ndarray:
    """Project points [n, 3] of the model's frame to pixels [n, 2] of a photograph, in COLMAP's
    convention: the first pixel's centre is at (0.5, 0.5)."""
    return _pixels(camera_in(image), _in_camera(image, points_m))


def pixel_jacobians(
    image: "pycolmap.Image", points_m: np.ndarray, lens: int
) -> tuple[np.ndarray, np.ndarray]:
    """Compute the derivatives of the pixels at which a photograph shows points [n, 3].

    Returns the derivatives with respect to the point [n, 2, 3], and those with respect to the
    camera [n, 2, 6 + lens]: translation and rotation of the pose, then the first `lens` of COLMAP's
    parameters. Derivatives of the projection are central differences.
    """
    camera, x = camera_in(image), _in_camera(image, points_m)
    by_x = np.empty((len(x), 2, 3))
    for axis in range(3):
        step = np.zeros_like(x)
        step[:, axis] = STEP * x[:, 2]
        by_x[..., axis] = (_pixels(camera, x + step) - _pixels(camera, x - step)) / (
            2 * step[:, axis, None]
        )
    by_camera = np.empty((len(x), 2, POSE + lens))
    by_camera[..., :3] = by_x
    by_camera[..., 3:6] = -np.cross(by_x, x[:, None, :])  # d(ω × x) = −[x]× dω
    for k in range(lens):
        step = STEP * max(abs(camera.params[k]), 1.0)
        ahead, behind = (_pixels(_moved(camera, k, s), x) for s in (step, -step))
        by_camera[..., POSE + k] = (ahead - behind) / (2 * step)
    return by_x @ image.cam_from_world().rotation.matrix(), by_camera


def _in_camera(image: "pycolmap.Image", points_m: np.ndarray) -> np.ndarray:
    pose = image.cam_from_world()
    return points_m @ pose.rotation.matrix().T + pose.translation


def _pixels(camera: "pycolmap.Camera", x: np.ndarray) -> np.ndarray:
    return np.asarray(camera.img_from_cam(x)).reshape(-1, 2)


def _moved(camera: "pycolmap.Camera", k: int, step: float) -> "pycolmap.Camera":
    """Return a copy of the camera whose intrinsic parameter number k is increased by step."""
    other = type(camera)(camera.todict())
    params = np.array(camera.params)
    params[k] += step
    other.params = params.tolist()
    return other
