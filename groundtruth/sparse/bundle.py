"""Normal equations of a bundle adjustment that includes the board's corners.

Triggs et al., "Bundle Adjustment – A Modern Synthesis", 2000, with Cauchy's weights for outliers.
Features and board corners have separate noise levels, estimated from their residuals. The noise of
a feature grows with its scale, except for a part that all features have in common.

The board's corners are points with known positions, detected about ten times as precisely as
features; COLMAP's adjustment does not support such points. They fix frame and scale, and they
determine focal lengths and principal points, which features determine poorly.

Features that only two of many photographs show are left out where a board holds the cameras: false
ones (such as apparent crossings of contours) cannot be detected, and many of them bias the cameras.
Without a board they count, because cameras far apart have few others. The normal matrix of the
cameras, after elimination of the points, is the joint information matrix (inverse covariance) of
all cameras.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from handbench.groundtruth.board.markers import Corners
from handbench.groundtruth.cameras.cameras import pycolmap, registered_images, set_pose
from handbench.groundtruth.sparse.jacobians import POSE, pixel_jacobians, project

# scale below which all features are equally precise: noise grows with the root of the sum of both
# squares
LOCATED_LIKE_PX = 2.0
LEAST_NOISE_PX = 0.03  # least noise of any observation
# standard deviations at which a residual weighs half: 95 % efficient where errors are normal
CAUCHY = 2.385
MAD = 1.4826  # of a normal distribution: standard deviation over median absolute deviation
# Priors of any lens: standard deviation of principal point (of the width), fx/fy, and distortion k
# and p.
CENTRE, SQUARE, RADIAL, TANGENTIAL = 0.01, 1e-3, 0.2, 1e-3
LEAST_SHARE = 0.05  # least redundancy, relative to the number of residuals, in the noise estimate
FEWEST_SIGHTINGS = 3  # of a feature beside a board; 2 without one, or of three photographs
GAUGE = 1e-12  # eigenvalues of an information matrix below this share are a freedom of the frame


class Observations(NamedTuple):
    """Pixels observed in one photograph.

    pixels [n, 2]. numbers [n]: index of the point that each pixel shows, in the list of the model's
    points followed by the board's corners. A pixel's standard deviation is noise_px times its
    relative value spread [n, 1].
    """

    image: "pycolmap.Image"
    pixels: np.ndarray
    numbers: np.ndarray
    spread: np.ndarray
    noise_px: float = 1.0

    def off(self, xyz: np.ndarray) -> np.ndarray:
        """Compute the residuals [n, 2] of the observed pixels (observed minus projected), in units
        of their standard deviation. xyz [p, 3]: positions of all model points, followed by the
        board's corners."""
        return (self.pixels - project(self.image, xyz[self.numbers])) / (
            self.noise_px * self.spread
        )


class NormalEquations(NamedTuple):
    """Normal equations of a bundle adjustment with d camera parameters and p points, and its cost.

    cameras [d, d] and right [d]: matrix and right side of the cameras. points [p, 3, 3] and
    points_right [p, 3]: matrix and right side of each point. coupling [p, d, 3]: the blocks between
    cameras and points.
    """

    cameras: np.ndarray
    right: np.ndarray
    points: np.ndarray
    points_right: np.ndarray
    coupling: np.ndarray
    cost: float

    @classmethod
    def empty(cls, d: int, p: int) -> "NormalEquations":
        """Return normal equations of d camera parameters and p points, filled with zeros."""
        return cls(
            np.zeros((d, d)),
            np.zeros(d),
            np.zeros((p, 3, 3)),
            np.zeros((p, 3)),
            np.zeros((p, d, 3)),
            0.0,
        )

    def reduced(self, damping: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Eliminate the points by Schur's complement.

        damping: share by which the diagonals of the points' matrices are enlarged first. Returns
        the normal matrix [d, d] and right side [d] of the cameras, and the inverses [p, 3, 3] of
        the points' matrices.
        """
        diagonal = np.einsum("pii->pi", self.points)
        inverse = np.linalg.inv(self.points + np.eye(3) * (damping * diagonal + 1e-12)[:, None])
        eliminated = self.coupling @ inverse
        rows = [
            np.swapaxes(part, 1, 2).reshape(-1, len(self.right))
            for part in (eliminated, self.coupling)
        ]
        matrix = self.cameras - rows[0].T @ rows[1]
        return matrix, self.right - np.einsum("pdi,pi->d", eliminated, self.points_right), inverse


@dataclass
class Bundle:
    """A COLMAP model with its observations, for bundle adjustment.

    corners: pixels of the board's corners, by the photograph's name. corners_m: positions of the
    corners on the board, by marker. free: indices of the intrinsics to estimate among the
    parameters of COLMAP's lens model OPENCV (fx, fy, cx, cy, k1, k2, p1, p2); for any other lens
    model it must be empty. scales_px: scales [n] of a photograph's features, by its name, if known.

    The attribute `place` has the indices of a photograph's parameters among all unknowns: six of
    its pose, then the intrinsics of its camera, which other photographs may share.
    """

    model: "pycolmap.Reconstruction"
    corners: dict[str, Corners]
    corners_m: dict[int, np.ndarray]
    free: tuple[int, ...] = ()
    scales_px: dict[str, np.ndarray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.images = registered_images(self.model)
        cameras = sorted({image.camera_id for image in self.images})
        first, k = POSE * len(self.images), len(self.free)
        self.size = first + k * len(cameras)
        self.intrinsics = {c: first + k * i + np.arange(k) for i, c in enumerate(cameras)}
        self.place = {
            image.name: np.concatenate(
                [POSE * i + np.arange(POSE), self.intrinsics[image.camera_id]]
            )
            for i, image in enumerate(self.images)
        }
        self.start = {c: np.array(self.model.cameras[c].params) for c in cameras}
        fewest = min(FEWEST_SIGHTINGS if self.corners else 2, len(self.images) - 1)
        points = [point for _, point in sorted(self.model.points3D.items())]
        self.points = [
            p for p in points if len({element.image_id for element in p.track.elements}) >= fewest
        ]
        # asking for each takes longer
        self.points_m = np.reshape([point.xyz for point in self.points], (-1, 3))
        self.features, self.known = self._features(), self._known()
        self._count_unknowns()

    def _features(self) -> list[Observations]:
        shown: dict[int, list[tuple[int, int]]] = {image.image_id: [] for image in self.images}
        for number, point in enumerate(self.points):
            for element in point.track.elements:
                shown[element.image_id].append((number, element.point2D_idx))
        seen = []
        for image in (image for image in self.images if shown[image.image_id]):
            numbers, places = np.array(shown[image.image_id]).T
            # standard deviations of the features over that of the smallest
            spread = np.ones(len(places))
            if image.name in self.scales_px:
                spread = np.hypot(1.0, self.scales_px[image.name][places] / LOCATED_LIKE_PX)
            pixels = np.array([image.points2D[k].xy for k in places.tolist()])
            seen.append(Observations(image, pixels, numbers, spread[:, None]))
        return self._with_noise(seen)

    def _known(self) -> list[Observations]:
        names = [
            (name, k) for name, places_m in self.corners_m.items() for k in range(len(places_m))
        ]
        number = {corner: len(self.points) + n for n, corner in enumerate(names)}
        seen = []
        for image in self.images:
            if at := self.corners.get(image.name):
                numbers = np.array([number[corner] for corner in at])
                seen.append(
                    Observations(image, np.array([*at.values()]), numbers, np.ones((len(at), 1)))
                )
        return self._with_noise(seen)

    def _with_noise(self, seen: list[Observations]) -> list[Observations]:
        """Return the observations with one common noise level, estimated from the median absolute
        deviation of their residuals. Pixels of points behind the camera are left out."""
        xyz = self._xyz()
        off = [s.off(xyz) for s in seen]
        before = [np.isfinite(each).all(axis=1) for each in off]
        left = np.concatenate(
            [np.empty(0), *(np.abs(o[b]).ravel() for o, b in zip(off, before, strict=True))]
        )
        noise_px = max(MAD * float(np.median(left)), LEAST_NOISE_PX) if len(left) else np.nan
        shown = [(s, b) for s, b in zip(seen, before, strict=True) if b.any()]
        return [
            Observations(s.image, s.pixels[b], s.numbers[b], s.spread[b], noise_px)
            for s, b in shown
        ]

    def _count_unknowns(self) -> None:
        """Raise the noise levels of features and board corners, because fitted unknowns make
        residuals smaller than the noise.

        Each of the two gets the number of unknowns that its observations determine (Förstner, "Ein
        Verfahren zur Schätzung von Varianz- und Kovarianzkomponenten", AVN 1979).
        """
        information, _, _ = self.normal().reduced(0.0)
        of_known, xyz = NormalEquations.empty(self.size, 0), self._xyz()
        for seen in self.known:
            self._add(of_known, seen, xyz, seen.off(xyz))
        inverse = pseudo_inverse(information)
        by_known = float(np.sum(of_known.cameras * inverse))
        by_features = float(np.sum(information * inverse)) - by_known
        self.features = _with_redundancy(self.features, by_features + 3 * len(self.points))
        self.known = _with_redundancy(self.known, by_known)

    def _xyz(self) -> np.ndarray:
        """Return the positions [p, 3] of the model's points, followed by those of the board's
        corners."""
        return np.concatenate([self.points_m, *self.corners_m.values()])

    def normal(self, jacobians: bool = True) -> NormalEquations:
        """Compute the normal equations and the cost at the model's current state. With
        jacobians=False, only the cost is complete: the observations are not added to the
        equations."""
        equations = NormalEquations.empty(self.size, len(self.points))
        cost, xyz = self._add_priors(equations), self._xyz()
        for seen in (*self.features, *self.known):
            off = seen.off(xyz)
            cost += CAUCHY**2 * float(np.log1p((off**2).sum(axis=1) / CAUCHY**2).sum())
            if jacobians:
                self._add(equations, seen, xyz, off)
        return equations._replace(cost=cost)

    def _add(
        self, equations: NormalEquations, seen: Observations, xyz: np.ndarray, off: np.ndarray
    ) -> None:
        by_point, by_camera = pixel_jacobians(seen.image, xyz[seen.numbers], self.free)
        sigma_px = seen.noise_px * seen.spread
        weight = 1 / (1 + (off**2).sum(axis=1, keepdims=True) / CAUCHY**2) / sigma_px
        columns = self.place[seen.image.name]
        weighted = by_camera * (weight / sigma_px)[..., None]
        equations.cameras[np.ix_(columns, columns)] += np.einsum("nia,nib->ab", weighted, by_camera)
        equations.right[columns] += np.einsum("nia,ni->a", by_camera, weight * off)
        at = seen.numbers
        if at[0] < len(self.points):  # the board's corners stay where they are
            np.add.at(
                equations.coupling,
                (at[:, None], columns),
                np.einsum("nia,nij->naj", weighted, by_point),
            )
            by_weight = by_point * (weight / sigma_px)[..., None]
            np.add.at(equations.points, at, np.einsum("nia,nib->nab", by_weight, by_point))
            np.add.at(equations.points_right, at, np.einsum("nia,ni->na", by_point, weight * off))

    def _add_priors(self, equations: NormalEquations) -> float:
        """Add the prior knowledge of any lens to the normal equations, in place: principal point
        near the picture's middle, square pixels, small distortion. Returns the cost of the current
        deviations from this knowledge."""
        cost = 0.0
        for camera_id, columns in self.intrinsics.items():
            camera = self.model.cameras[camera_id]
            value, start = np.array(camera.params), self.start[camera_id]
            middle = np.array([0, 0, camera.width / 2, camera.height / 2, 0, 0, 0, 0])
            sigma = np.array(
                [
                    np.inf,
                    np.inf,
                    *[CENTRE * camera.width] * 2,
                    RADIAL,
                    RADIAL,
                    TANGENTIAL,
                    TANGENTIAL,
                ]
            )
            for column, k in zip(columns, self.free, strict=True):
                equations.cameras[column, column] += 1 / sigma[k] ** 2
                equations.right[column] += (middle[k] - value[k]) / sigma[k] ** 2
                cost += ((middle[k] - value[k]) / sigma[k]) ** 2
            if {0, 1} <= set(self.free):
                fx, fy = columns[list(self.free).index(0)], columns[list(self.free).index(1)]
                slope = np.array([1, -1]) / (SQUARE * start[0])
                both = [fx, fy]
                equations.cameras[np.ix_(both, both)] += np.outer(slope, slope)
                equations.right[both] -= slope * (slope @ value[:2])
                cost += float(slope @ value[:2]) ** 2
        return cost

    def move(self, step: np.ndarray, points_step: np.ndarray) -> None:
        """Change the model by steps of the camera parameters [d] and of the points [p, 3]."""
        poses, intrinsics, xyz = self.state()
        for n, (image, pose) in enumerate(zip(self.images, poses, strict=True)):
            poses[n] = _moved(pose, step[self.place[image.name][:POSE]])
        for camera_id, columns in self.intrinsics.items():
            intrinsics[camera_id][list(self.free)] += step[columns]
        self.restore((poses, intrinsics, xyz + points_step))

    def state(self) -> "tuple[list[pycolmap.Rigid3d], dict[int, np.ndarray], np.ndarray]":
        """Return the current poses by image, intrinsics by camera and points, so that `restore` can
        undo later changes of the model."""
        poses = [image.cam_from_world() for image in self.images]
        intrinsics = {c: np.array(self.model.cameras[c].params) for c in self.intrinsics}
        return poses, intrinsics, self.points_m

    def restore(
        self, state: "tuple[list[pycolmap.Rigid3d], dict[int, np.ndarray], np.ndarray]"
    ) -> None:
        """Set the model's poses, intrinsics and points to a state that `state` returned earlier."""
        poses, intrinsics, self.points_m = state
        for image, pose in zip(self.images, poses, strict=True):
            set_pose(image, pose)
        for camera_id, params in intrinsics.items():
            self.model.cameras[camera_id].params = params.tolist()
        for point, xyz in zip(self.points, self.points_m, strict=True):
            point.xyz = xyz


def _moved(pose: "pycolmap.Rigid3d", step: np.ndarray) -> "pycolmap.Rigid3d":
    """Return the pose after a small motion in the camera frame. step [6]: translation τ and
    rotation ω, which move a point x of the camera frame to x + τ + ω × x."""
    tau, omega = np.split(step, 2)
    turn = Rotation.from_rotvec(omega).as_matrix()
    return pycolmap.Rigid3d(
        pycolmap.Rotation3d(turn @ pose.rotation.matrix()), turn @ pose.translation + tau
    )


def pseudo_inverse(information: np.ndarray) -> np.ndarray:
    """Compute the covariance [d, d] from an information matrix [d, d] (inverse covariance), scaled
    to a unit diagonal first. Directions that the matrix does not determine get the variance 0."""
    unit = 1 / np.sqrt(np.maximum(np.diag(information), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(information * np.outer(unit, unit))
    kept = values > GAUGE * values[-1]
    vectors = vectors[:, kept] * unit[:, None]
    return (vectors / values[kept]) @ vectors.T


def _with_redundancy(seen: list[Observations], unknowns: float) -> list[Observations]:
    """Return the observations with a higher noise level, because `unknowns` parameters fitted to
    them make their residuals smaller than the noise."""
    count = 2 * sum(len(s.pixels) for s in seen)
    share = max(1 - unknowns / count, LEAST_SHARE) if count else 1.0
    return [s._replace(noise_px=s.noise_px / share**0.5) for s in seen]
