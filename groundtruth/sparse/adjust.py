"""Bundle adjustment of a model, with the board's corners if there are any.

Cameras and points move by Gauss–Newton steps with the normal equations of `normal`, which have what
COLMAP's own adjustment has not: weights of the board's corners and priors of the lenses. At the end
COLMAP moves all points, also those that the adjustment leaves out."""

import numpy as np

from handbench.groundtruth.board.markers import Corners
from handbench.groundtruth.cameras.cameras import camera_in, pycolmap, registered_images, set_pose
from handbench.groundtruth.sparse.covariance import pseudo_inverse
from handbench.groundtruth.sparse.normal import normal_equations, parameter_places
from handbench.support.parallel import one_blas_thread
from handbench.support.progress import say

MOST_STEPS = 50
SETTLED = 0.1  # standard deviations, in any direction: a step below it is the last
LOSS_PX = 1.0  # scale of Cauchy's loss of points
POINTS_SETTLED = 1e-6  # relative fall of the cost at which points have moved


def adjust(
    model: "pycolmap.Reconstruction",
    corners: dict[str, Corners],
    corners_m: dict[int, np.ndarray],
    lens: int = 0,
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
