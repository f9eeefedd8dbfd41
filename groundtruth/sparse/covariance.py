"""Joint covariance of the adjusted cameras, and the resulting covariance of points in space."""

import numpy as np

from handbench.groundtruth.board.markers import Corners
from handbench.groundtruth.cameras.cameras import pycolmap, registered_images
from handbench.groundtruth.sparse.frame import Scale
from handbench.groundtruth.sparse.jacobians import POSE, pixel_jacobians
from handbench.groundtruth.sparse.normal import NOT_SEEN, normal_equations, parameter_places
from handbench.support.parallel import one_blas_thread

GAUGE = 1e-12  # eigenvalues of an information matrix below this share are a freedom of the frame


def camera_covariance(
    model: "pycolmap.Reconstruction",
    corners: dict[str, Corners],
    corners_m: dict[int, np.ndarray],
    lens: int,
    scale: Scale,
) -> np.ndarray:
    """Compute the joint covariance [d, d] of the cameras of an adjusted model, whose parameters are
    in the order of `parameter_places`.

    corners, corners_m, lens: as for `adjust`. The frame is fixed by the board's corners if there
    are any, else by known camera poses with the standard deviation scale.residual_m. Without
    either, nothing fixes the frame, and the result is the covariance with the smallest trace (inner
    constraint).
    """
    with one_blas_thread():  # sums over threads would not repeat bit for bit
        matrix = normal_equations(model, corners, corners_m, lens).information
        if scale.source == "poses" and scale.residual_m:
            for place in parameter_places(registered_images(model), lens):
                # the centre −Rᵀt moves by −Rᵀτ: any τ by as much
                matrix[place[:3], place[:3]] += 1 / scale.residual_m**2
        return pseudo_inverse(matrix)


def pseudo_inverse(information: np.ndarray) -> np.ndarray:
    """Compute the covariance [d, d] from an information matrix [d, d] (inverse covariance), scaled
    to a unit diagonal first. Directions that the matrix does not determine get the variance 0."""
    unit = 1 / np.sqrt(np.maximum(np.diag(information), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(information * np.outer(unit, unit))
    kept = values > GAUGE * values[-1]
    vectors = vectors[:, kept] * unit[:, None]
    return (vectors / values[kept]) @ vectors.T


def point_covariance(
    images: "list[pycolmap.Image]", of_cameras: np.ndarray, points_m: np.ndarray, seen: np.ndarray
) -> np.ndarray:
    """Compute the covariance [n, 3, 3] (m²) that the uncertainty of the cameras causes in
    triangulated points [n, 3].

    images: all registered photographs; of_cameras [d, d]: covariance of their cameras; seen
    [n, images]: True where a photograph shows a point. A point is assumed to follow the rays of the
    moved cameras by least squares.
    """
    information = np.zeros((len(points_m), 3, 3))
    moved = np.zeros((len(points_m), 3, len(of_cameras)))
    cameras = {image.camera_id for image in images}
    lens = (len(of_cameras) - POSE * len(images)) // len(cameras)
    for image, columns, mask in zip(images, parameter_places(images, lens), seen.T, strict=True):
        by_point, by_camera = pixel_jacobians(image, points_m[mask], lens)
        information[mask] += np.einsum("nia,nib->nab", by_point, by_point)
        at = np.nonzero(mask)[0]
        moved[at[:, None, None], np.arange(3)[:, None], columns] -= np.einsum(
            "nia,nib->nab", by_point, by_camera
        )
    shift = np.linalg.pinv(information, rcond=NOT_SEEN, hermitian=True) @ moved
    spread = (shift.reshape(-1, len(of_cameras)) @ of_cameras).reshape(shift.shape)
    return spread @ np.swapaxes(shift, -1, -2)
