"""Bundle adjustment of a model, with the board's corners if there are any; the covariance of the
adjusted cameras, and of points in space.

Cameras and points move by Gauss–Newton steps with the normal equations of `normal`, which have what
COLMAP's own adjustment has not: weights of the board's corners and priors of the lenses. At the end
COLMAP moves all points, also those that the adjustment leaves out.
"""

import numpy as np

from handbench.groundtruth.cameras import camera_in, pycolmap, registered_images, set_pose
from handbench.groundtruth.markers import Corners
from handbench.groundtruth.sparse.frame import Scale
from handbench.groundtruth.sparse.normal import (
    NOT_SEEN,
    POSE,
    normal_equations,
    parameter_places,
    pixel_jacobians,
)
from handbench.support.parallel import one_blas_thread
from handbench.support.progress import say

MOST_STEPS = 50
SETTLED = 0.1  # standard deviations, in any direction: a step below it is the last
LOSS_PX = 1.0  # scale of Cauchy's loss of points
POINTS_SETTLED = 1e-6  # relative fall of the cost at which points have moved
GAUGE = 1e-12  # eigenvalues of an information matrix below this share are a freedom of the frame


def adjust(
    model: "pycolmap.Reconstruction",
    corners: dict[str, Corners],
    corners_m: dict[int, np.ndarray],
    lens: int,
) -> None:
    """Improve the cameras and points of a model by bundle adjustment, in place.

    model: with a board, already close to its frame. corners: pixels of the board's corners, by the
    photograph's name. corners_m: positions of the corners on the board, by marker. lens: number of
    intrinsics to estimate, 0 or the 8 of COLMAP's lens model OPENCV.
    """
    for _ in range(MOST_STEPS):
        with one_blas_thread():  # sums over threads would not repeat bit for bit
            equations = normal_equations(model, corners, corners_m, lens)
            step = pseudo_inverse(equations.information) @ equations.right
        _move(registered_images(model), step, lens)
        for number, shift in zip(equations.numbers, equations.points_step(step), strict=True):
            model.points3D[number].xyz += shift
        if equations.right @ step < SETTLED**2:
            break
    else:
        say(f"adjustment: the cameras still move after {MOST_STEPS} steps; they may be wrong")
    _move_points(model)


def _move(images: "list[pycolmap.Image]", step: np.ndarray, lens: int) -> None:
    """Move cameras by a step [d] of their parameters."""
    params = {image.camera_id: np.array(camera_in(image).params) for image in images}
    for image, columns in zip(images, parameter_places(images, lens), strict=True):
        shift, turn, change = np.split(step[columns], [3, 6])
        motion = pycolmap.Rigid3d(pycolmap.Rotation3d(turn), shift)
        set_pose(image, motion * image.cam_from_world())
        if lens:
            camera_in(image).params = (params[image.camera_id] + change).tolist()


def _move_points(model: "pycolmap.Reconstruction") -> None:
    """Move all points of a model to where its cameras, which stay, show them."""
    options = pycolmap.BundleAdjustmentOptions(
        print_summary=False,
        refine_rig_from_world=False,
        refine_sensor_from_rig=False,
        refine_focal_length=False,
        refine_principal_point=False,
        refine_extra_params=False,
    )
    options.ceres.loss_function_type = pycolmap.LossFunctionType.CAUCHY
    options.ceres.loss_function_scale = LOSS_PX
    options.ceres.solver_options.function_tolerance = POINTS_SETTLED
    options.ceres.solver_options.num_threads = 1  # sums over threads would not repeat bit for bit
    config = pycolmap.BundleAdjustmentConfig()
    for image in registered_images(model):
        config.add_image(image.image_id)
    pycolmap.create_default_bundle_adjuster(options, config, model).solve()
    model.update_point_3d_errors()


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
