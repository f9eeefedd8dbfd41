"""Similarity transforms (rotation, translation, scale) between named frames, their fit to matched
points, and their files."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field

from handbench.support.config import Config, parse
from handbench.support.errors import HandbenchError
from handbench.support.files import read_json, write_json

# larger than the Earth's radius: offsets, residuals and roots of covariances are smaller
LARGEST_M = 1e7
ROUNDING = 1e-6  # of a rotation, a scale and a covariance, as files write them


def _in_one_row(rows: Any) -> Any:
    """Return the numbers of several rows as one list."""
    return np.ravel(np.asarray(rows, object)).tolist()


Length = Annotated[float, Field(strict=True, gt=-LARGEST_M, lt=LARGEST_M)]
Numbers = Annotated[tuple[Length, ...], BeforeValidator(_in_one_row)]  # also in rows
Matrix = Annotated[Numbers, Field(min_length=16, max_length=16)]  # 4×4, row by row
Covariance = Annotated[Numbers, Field(min_length=36, max_length=36)]  # 6×6


@dataclass(frozen=True)
class Transform:
    """A similarity between frames: p_target = matrix @ [p_source, 1]. Variables are named
    `target_from_source`.

    source, target: names of the frames. matrix: 4×4, upper left = scale · rotation, last column in
    metres. covariance: 6×6, of [translation_m, rotation_rad] of a small motion that is applied
    after the transform, in the target frame and about its origin. residuals_m: one distance for
    each matched point. refined: how alignment to the radar's depth map changed the fit, and why to
    distrust it (None: not refined).
    """

    source: str
    target: str
    matrix: np.ndarray
    covariance: np.ndarray | None = None
    residuals_m: Sequence[float] | np.ndarray = ()
    refined: str | None = None

    @property
    def scale(self) -> float:
        """The scale factor: the cube root of the determinant of the matrix's upper left 3×3
        part."""
        return float(np.cbrt(np.linalg.det(self.matrix[:3, :3])))

    @property
    def rotation(self) -> np.ndarray:
        """The rotation matrix [3, 3], without the scale."""
        return self.matrix[:3, :3] / self.scale

    def points(self, points_m: np.ndarray) -> np.ndarray:
        """Transform points [..., 3] from the source frame to the target frame."""
        return points_m @ self.matrix[:3, :3].T + self.matrix[:3, 3]

    def point_covariance(self, points_m: np.ndarray) -> np.ndarray:
        """Compute the covariance [..., 3, 3] (m²) of points [..., 3] of the target frame that is
        due to the transform's uncertainty. Raises HandbenchError if the transform has no
        covariance."""
        jacobian = perturbation_jacobian(points_m)
        return jacobian @ self.require_covariance() @ np.swapaxes(jacobian, -1, -2)

    def require_covariance(self) -> np.ndarray:
        """Return the covariance. Raises HandbenchError if there is none."""
        if self.covariance is None:
            raise HandbenchError(
                f"transform {self.target}_from_{self.source}: has no covariance; calibrate again"
            )
        return self.covariance

    def require(self, source: str, target: str, where: object) -> "Transform":
        """Return the transform if it leads from the frame `source` to the frame `target`; otherwise
        raise HandbenchError. where: the transform's file, with which the message begins."""
        if (self.source, self.target) != (source, target):
            raise HandbenchError(
                f"{where}: is a transform from '{self.source}' to '{self.target}'; expected one "
                f"from '{'photo' if source == self.source else source}' to '{target}'"
            )
        return self

    def inverse(self) -> "Transform":
        """Return the transform from target to source, without what is known of its errors."""
        return Transform(self.target, self.source, np.linalg.inv(self.matrix))

    def save(self, path: str | Path) -> None:
        """Write the transform to a JSON file, atomically; `load_transform` reads it."""
        content = {
            "from": self.source,
            "to": self.target,
            "matrix": self.matrix,
            "scale": self.scale,
            "covariance": self.covariance,
            "residuals_m": self.residuals_m,
            "refined": self.refined,
        }
        write_json(path, content)


class TransformFile(Config):
    """The content of a transform's file, see `Transform`. scale: the matrix's, for readers."""

    source: str = Field(alias="from")
    target: str = Field(alias="to")
    matrix: Matrix
    scale: float | None = Field(default=None, gt=0)
    covariance: Covariance | None = None
    residuals_m: Numbers = ()
    refined: str | None = None


def identity(frame: str) -> Transform:
    """Return the identity transform from a frame to itself."""
    return Transform(frame, frame, np.eye(4))


def perturbation_jacobian(points_m: np.ndarray) -> np.ndarray:
    """Compute the derivatives [..., 3, 6] of points [..., 3] with respect to a small motion
    [translation_m, rotation_rad] about the origin of their frame: dp = t + ω×p."""
    points_m = np.asarray(points_m, np.float64)[..., None]
    turns = -np.cross(points_m, np.eye(3), axis=-2)
    return np.concatenate([np.broadcast_to(np.eye(3), turns.shape), turns], axis=-1)


def adjoint(step_m: np.ndarray) -> np.ndarray:
    """Return the matrix [6, 6] that converts a small motion (translation, rotation) about one point
    to the same motion about a point shifted by step_m [3]: the translation becomes t' = t + ω×step,
    the rotation stays."""
    matrix = np.eye(6)
    matrix[:3, 3:] = perturbation_jacobian(step_m)[:, 3:]
    return matrix


def umeyama(
    source_m: np.ndarray,
    target_m: np.ndarray,
    with_scale: bool = False,
    weights: np.ndarray | None = None,
) -> np.ndarray:
    """Fit the similarity [4, 4] from source to target points [n, 3] with the least squared error,
    in closed form; it is never a reflection (Umeyama 1991).

    with_scale: fit a scale too; else it is 1. weights [n]: weights of the points (None: equal).
    Raises HandbenchError if a scale is wanted and all source points coincide.
    """
    source_mean, target_mean = (
        np.average(points_m, axis=0, weights=weights) for points_m in (source_m, target_m)
    )
    source = source_m - source_mean
    weighted = source if weights is None else weights[:, None] * source
    u, stretch, vt = np.linalg.svd((target_m - target_mean).T @ weighted)
    proper = np.array([1.0, 1.0, np.sign(np.linalg.det(u) * np.linalg.det(vt))])
    spread = (weighted * source).sum()
    if with_scale and spread == 0:
        raise HandbenchError(
            f"scale: all {len(source)} source points are the same point; use points that are apart"
        )
    scale = stretch @ proper / spread if with_scale else 1.0
    matrix = np.eye(4)
    matrix[:3, :3] = scale * (u * proper) @ vt
    matrix[:3, 3] = target_mean - matrix[:3, :3] @ source_mean
    return matrix


def load_transform(path: str | Path) -> Transform:
    """Read a transform from a JSON file. Raises HandbenchError unless its matrix is a finite 4×4
    similarity without reflection, with the scale that is given beside it, and its covariance, if
    there is one, is symmetric and positive."""
    content = read_json(path, 'a transform file {"from", "to", "matrix", ...}')
    file = parse(TransformFile, content, str(path))
    matrix = np.reshape(file.matrix, (4, 4))
    covariance = None if file.covariance is None else np.reshape(file.covariance, (6, 6))
    transform = Transform(
        file.source, file.target, matrix, covariance, file.residuals_m, file.refined
    )
    scale = transform.scale
    if (
        not scale > 0
        or abs((file.scale or scale) / scale - 1) > ROUNDING
        or np.abs(transform.rotation @ transform.rotation.T - np.eye(3)).max() > ROUNDING
        or np.abs(matrix[3] - [0, 0, 0, 1]).max() > 1e-12
    ):
        raise HandbenchError(
            f"{path}: 'matrix' is not a rotation times its scale {scale:.9g} ('scale': "
            f"{file.scale}) to {ROUNDING:g}, with [0, 0, 0, 1] below and no reflection; write all "
            "digits, or calibrate again"
        )
    if covariance is not None:
        largest = ROUNDING * np.abs(covariance).max()
        if (
            np.abs(covariance - covariance.T).max() > largest
            or np.linalg.eigvalsh(covariance)[0] < -largest
        ):
            raise HandbenchError(
                f"{path}: 'covariance' is not symmetric and positive; calibrate again"
            )
    return transform
