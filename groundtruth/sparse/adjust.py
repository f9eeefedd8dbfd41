"""Bundle adjustment of a model in the board's frame, the joint covariance of the adjusted cameras,
and the resulting covariance of points in space.

The points are eliminated from the normal equations (Schur's complement), and the cameras are
improved by Gauss–Newton steps with the damping of Levenberg and Marquardt. The module `bundle` says
what is adjusted and why COLMAP's own adjustment does not suffice.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from handbench.groundtruth.board.markers import Corners
from handbench.groundtruth.cameras.cameras import pycolmap, registered_images
from handbench.groundtruth.sparse.bundle import Bundle, pseudo_inverse
from handbench.groundtruth.sparse.frame import Scale
from handbench.groundtruth.sparse.jacobians import pixel_jacobians
from handbench.support.files import read_npz, write_npz
from handbench.support.limits import KEPT_BYTES
from handbench.support.parallel import one_blas_thread

STEPS, CONVERGED = 50, 1e-5  # steps at most; relative fall of the cost at which they end
SETTLED = 1e-6  # relative fall of the cost at which points have been triangulated
ROUNDS = 3  # of adjustment, each with the noise level of the last one's residuals
# directions of a point with less relative information are undetermined and do not move
NOT_SEEN = 1e-12


def adjust(
    model: "pycolmap.Reconstruction",
    corners: dict[str, Corners],
    corners_m: dict[int, np.ndarray],
    free: tuple[int, ...] = (),
    scales_px: dict[str, np.ndarray] | None = None,
) -> None:
    """Improve the cameras and points of a model by bundle adjustment, in place, and then
    triangulate all points again.

    model: already close to the board's frame. corners: pixels of the board's corners, by the
    photograph's name. corners_m: positions of the corners on the board, by marker. free: indices of
    the intrinsics to estimate among COLMAP's camera parameters. scales_px: scale of each feature,
    by the photograph's name; features of larger scale get less weight.
    """
    for _ in range(ROUNDS):
        with one_blas_thread():  # sums over threads would not repeat bit for bit
            _descend(Bundle(model, corners, corners_m, free, scales_px or {}))
    _triangulate_again(model)


def _descend(bundle: Bundle) -> None:
    """Minimise the cost of a bundle adjustment by damped Gauss–Newton steps, in place. It ends when
    a step lowers the cost by a smaller share than CONVERGED, or after a fixed number of steps."""
    damping, equations = 1e-4, bundle.normal()
    for _ in range(STEPS):
        matrix, right, inverse = equations.reduced(damping)
        diagonal = np.diag(matrix)
        # undetermined parameters do not move
        held = np.where(diagonal > 0, damping * diagonal, 1.0)
        step = np.linalg.solve(matrix + np.diag(held), right)
        points_step = np.einsum(
            "pij,pj->pi",
            inverse,
            equations.points_right - np.einsum("pdi,d->pi", equations.coupling, step),
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
    """Triangulate all points of a model again with its adjusted cameras, which do not change. This
    includes the points that the adjustment left out because few photographs see them."""
    config = pycolmap.BundleAdjustmentConfig()
    for image in registered_images(model):
        config.add_image(image.image_id)
    options = pycolmap.BundleAdjustmentOptions(print_summary=False)
    options.refine_focal_length = options.refine_principal_point = options.refine_extra_params = (
        False
    )
    options.refine_rig_from_world = options.refine_sensor_from_rig = False
    options.ceres.loss_function_type = pycolmap.LossFunctionType.CAUCHY
    options.ceres.solver_options.function_tolerance = SETTLED
    options.ceres.solver_options.num_threads = 1  # sums over threads would not repeat bit for bit
    pycolmap.create_default_bundle_adjuster(options, config, model).solve()
    model.update_point_3d_errors()


@dataclass(frozen=True)
class CameraCovariance:
    """Joint covariance `matrix` [d, d] of the parameters of all cameras.

    places: indices of a camera's parameters in the matrix, by its photograph's name: six of the
    pose first (translation, rotation), then the estimated intrinsics. free: indices of these
    intrinsics among the parameters of COLMAP's camera model.
    """

    matrix: np.ndarray
    places: dict[str, np.ndarray]
    free: tuple[int, ...]

    def save(self, file: Path) -> None:
        """Write the covariance to an .npz file."""
        names = tuple(self.places)
        write_npz(
            file,
            matrix=self.matrix,
            names=names,
            places=np.array([*self.places.values()]),
            free=self.free,
        )

    @classmethod
    def load(cls, file: Path) -> "CameraCovariance":
        """Read a covariance from an .npz file that `save` wrote."""
        found = read_npz(file, ("matrix", "names", "places", "free"), most=KEPT_BYTES)
        places = dict(zip(found["names"].tolist(), found["places"], strict=True))
        return cls(found["matrix"], places, tuple(found["free"].astype(int).tolist()))


def camera_covariance(bundle: Bundle, scale: Scale) -> CameraCovariance:
    """Compute the joint covariance of the cameras in a bundle adjustment.

    The frame is fixed by the board's corners if there are any, else by known camera poses with the
    standard deviation scale.residual_m. Without either, nothing fixes the frame, and the result is
    the covariance with the smallest trace (inner constraint).
    """
    information, _, _ = bundle.normal().reduced(0.0)
    if scale.source == "poses" and scale.residual_m:
        for image in bundle.images:
            # the centre −Rᵀt moves by −Rᵀτ: any τ by as much
            columns = bundle.place[image.name][:3]
            information[columns, columns] += 1 / scale.residual_m**2
    return CameraCovariance(pseudo_inverse(information), bundle.place, bundle.free)


def point_covariance(
    images: "list[pycolmap.Image]", known: CameraCovariance, points_m: np.ndarray, seen: np.ndarray
) -> np.ndarray:
    """Compute the covariance [n, 3, 3] (m²) that the uncertainty of the cameras causes in
    triangulated points [n, 3].

    images: the photographs; known: covariance of their cameras; seen [n, images]: True where a
    photograph shows a point. A point is assumed to follow the rays of the moved cameras by least
    squares.
    """
    information = np.zeros((len(points_m), 3, 3))
    moved = np.zeros((len(points_m), 3, len(known.matrix)))
    for image, mask in zip(images, seen.T, strict=True):
        columns = known.places[image.name]
        by_point, by_camera = pixel_jacobians(image, points_m[mask], known.free)
        information[mask] += np.einsum("nia,nib->nab", by_point, by_point)
        at = np.nonzero(mask)[0]
        moved[at[:, None, None], np.arange(3)[:, None], columns] -= np.einsum(
            "nia,nib->nab", by_point, by_camera
        )
    shift = np.linalg.pinv(information, rcond=NOT_SEEN, hermitian=True) @ moved
    return shift @ known.matrix @ np.swapaxes(shift, -1, -2)
