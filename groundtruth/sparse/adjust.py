"""Bundle adjustment of a model that lies in the board's frame.

Gauss–Newton steps on the cameras after the points have been eliminated (Schur's complement), damped after Levenberg and
Marquardt; see `bundle` for what is adjusted and why COLMAP's own adjustment is not enough.
"""

import numpy as np

from handbench.groundtruth.board.markers import Corners
from handbench.groundtruth.cameras.cameras import pycolmap, registered
from handbench.groundtruth.sparse.bundle import Bundle
from handbench.support.parallel import one_blas_thread

STEPS, CONVERGED = 50, 1e-5  # steps at most; relative fall of the cost at which they end
SETTLED = 1e-6  # relative fall of the cost at which points have been triangulated
ROUNDS = 3  # of adjusting with the noise that the last one left


def adjust(
    model: "pycolmap.Reconstruction",
    corners: dict[str, Corners],
    corners_m: dict[int, np.ndarray],
    free: tuple[int, ...] = (),
    scales_px: dict[str, np.ndarray] | None = None,
) -> None:
    """Adjust a model that lies near the board's frame, in place. Arguments: as of `Bundle`."""
    for _ in range(ROUNDS):
        with one_blas_thread():  # sums over threads would not repeat bit for bit
            _descend(Bundle(model, corners, corners_m, free, scales_px or {}))
    _triangulate_again(model)


def _descend(bundle: Bundle) -> None:
    """Move the bundle's model to the least cost."""
    damping, equations = 1e-4, bundle.normal()
    for _ in range(STEPS):
        matrix, right, inverse = equations.reduced(damping)
        diagonal = np.diag(matrix)
        held = np.where(diagonal > 0, damping * diagonal, 1.0)  # what nothing tells stays where it is
        step = np.linalg.solve(matrix + np.diag(held), right)
        points_step = np.einsum(
            "pij,pj->pi", inverse, equations.points_right - np.einsum("pdi,d->pi", equations.coupling, step)
        )
        before = bundle.state()
        bundle.move(step, points_step)
        if bundle.normal(jacobians=False).cost < equations.cost:
            last, equations, damping = equations.cost, bundle.normal(), damping / 5
            if last - equations.cost < CONVERGED * last:
                return
        else:
            bundle.restore(before)
            damping *= 10


def _triangulate_again(model: "pycolmap.Reconstruction") -> None:
    """Move all points, those left out too, to where the cameras see them now."""
    config = pycolmap.BundleAdjustmentConfig()
    for image in registered(model):
        config.add_image(image.image_id)
    options = pycolmap.BundleAdjustmentOptions(print_summary=False)
    options.refine_focal_length = options.refine_principal_point = options.refine_extra_params = False
    options.refine_rig_from_world = options.refine_sensor_from_rig = False
    options.ceres.loss_function_type = pycolmap.LossFunctionType.CAUCHY
    options.ceres.solver_options.function_tolerance = SETTLED
    options.ceres.solver_options.num_threads = 1  # sums over threads would not repeat bit for bit
    pycolmap.create_default_bundle_adjuster(options, config, model).solve()
    model.update_point_3d_errors()
