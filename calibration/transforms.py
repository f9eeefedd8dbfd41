"""Similarity transforms between named frames."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from radar.errors import HandbenchError
from radar.files import read_json, write_json

LARGEST = 1e6  # no matrix, covariance or residual of a target in a room is larger


@dataclass(frozen=True)
class Transform:
    """p_target = matrix @ [p_source, 1]; named `target_from_source` where it is used.

    matrix: 4×4, upper left = scale · rotation, last column in metres. covariance: 6×6 (or 7×7 with log-scale) of
    [translation_m, rotation_rad(, log scale)], a left perturbation in the target frame about the target's origin.
    residuals_m: one distance per matched feature.
    """

    source: str
    target: str
    matrix: np.ndarray
    covariance: np.ndarray | None = None
    residuals_m: np.ndarray = field(default_factory=lambda: np.zeros(0))

    @property
    def scale(self) -> float:
        """Cube root of the determinant of the linear part."""
        return float(np.cbrt(np.linalg.det(self.matrix[:3, :3])))

    @property
    def rotation(self) -> np.ndarray:
        """Rotation [3, 3] without the scale."""
        return self.matrix[:3, :3] / self.scale

    def points(self, points_m: np.ndarray) -> np.ndarray:
        """Carry points [..., 3] from the source frame to the target frame."""
        return points_m @ self.matrix[:3, :3].T + self.matrix[:3, 3]

    def point_covariance(self, points_m: np.ndarray) -> np.ndarray:
        """Covariance [..., 3, 3] (m²) that the registration's own uncertainty gives to points [..., 3] in the target
        frame. Raises HandbenchError when the transform carries no covariance."""
        if self.covariance is None:
            raise HandbenchError(f"transform {self.target}_from_{self.source}: carries no covariance; calibrate again")
        jacobian = perturbation_jacobian(points_m)[..., : len(self.covariance)]
        return jacobian @ self.covariance @ np.swapaxes(jacobian, -1, -2)

    def require(self, source: str, target: str, where: object) -> Transform:
        """The transform itself if it leads from `source` to `target`; `where` (its file) opens the error otherwise."""
        if (self.source, self.target) != (source, target):
            raise HandbenchError(
                f"{where}: leads from '{self.source}' to '{self.target}'; expected one from '{source}' to '{target}'"
            )
        return self

    def inverse(self) -> Transform:
        """The transform the other way; it carries no covariance."""
        return Transform(self.target, self.source, np.linalg.inv(self.matrix), residuals_m=self.residuals_m)

    def save(self, path: str | Path) -> None:
        """Write the transform file (JSON), atomically."""
        write_json(path, {
            "from": self.source,
            "to": self.target,
            "matrix": self.matrix,
            "scale": self.scale,
            "covariance": self.covariance,
            "residuals_m": self.residuals_m,
        })


def identity(frame: str) -> Transform:
    """The transform that leaves a frame alone."""
    return Transform(frame, frame, np.eye(4))


def perturbation_jacobian(points_m: np.ndarray) -> np.ndarray:
    """[..., 3, 7]: how points [..., 3] move with [translation_m, rotation_rad, log scale] applied after a transform, in
    its target frame: dp = t + ω×p + λp."""
    x, y, z = np.moveaxis(np.asarray(points_m, np.float64), -1, 0)
    jacobian = np.zeros((*np.shape(x), 3, 7))
    jacobian[..., :3, :3] = np.eye(3)
    jacobian[..., 0, 4], jacobian[..., 0, 5] = z, -y
    jacobian[..., 1, 3], jacobian[..., 1, 5] = -z, x
    jacobian[..., 2, 3], jacobian[..., 2, 4] = y, -x
    jacobian[..., :, 6] = points_m
    return jacobian


def umeyama(source_m: np.ndarray, target_m: np.ndarray, with_scale: bool = False) -> np.ndarray:
    """The 4×4 rotation, translation (and scale) that carries points [n, 3] to points [n, 3] with the least squared
    error; never a reflection (Umeyama 1991)."""
    source_mean, target_mean = source_m.mean(axis=0), target_m.mean(axis=0)
    source, target = source_m - source_mean, target_m - target_mean
    u, stretch, vt = np.linalg.svd(target.T @ source)
    proper = np.array([1.0, 1.0, np.sign(np.linalg.det(u) * np.linalg.det(vt))])
    scale = stretch @ proper / (source**2).sum() if with_scale else 1.0
    matrix = np.eye(4)
    matrix[:3, :3] = scale * (u * proper) @ vt
    matrix[:3, 3] = target_mean - matrix[:3, :3] @ source_mean
    return matrix


def load_transform(path: str | Path) -> Transform:
    """Read a transform file; refuses anything but a finite 4×4 similarity without reflection, with a covariance (if
    any) that is one."""
    content = read_json(path, 'a transform file {"from", "to", "matrix", ...}')
    if not isinstance(content, dict) or not {"from", "to", "matrix"} <= content.keys():
        raise HandbenchError(f'{path}: is not a transform file; expected the keys "from", "to" and "matrix" (4×4)')
    source, target = content["from"], content["to"]
    if not isinstance(source, str) or not isinstance(target, str):
        raise HandbenchError(f"{path}: 'from' and 'to' are {source!r} and {target!r}; expected names of frames")
    matrix = _numbers(path, "matrix", content["matrix"], [(4, 4)])
    linear = matrix[:3, :3]
    scale2 = np.trace(linear @ linear.T) / 3
    if np.linalg.det(linear) <= 0 or np.abs(linear @ linear.T - scale2 * np.eye(3)).max() > 1e-6 * scale2:
        raise HandbenchError(f"{path}: 'matrix' is not a rotation with one scale; reflections and shears are refused")
    if np.abs(matrix[3] - [0, 0, 0, 1]).max() > 1e-12:
        raise HandbenchError(f"{path}: the last row of 'matrix' is {matrix[3].tolist()}; expected [0, 0, 0, 1]")
    residuals_m = _numbers(path, "residuals_m", content.get("residuals_m") or [], None)
    covariance = content.get("covariance")
    if covariance is not None:
        covariance = _numbers(path, "covariance", covariance, [(6, 6), (7, 7)])
        size = np.abs(covariance).max()
        if np.abs(covariance - covariance.T).max() > 1e-6 * size or np.linalg.eigvalsh(covariance)[0] < -1e-6 * size:
            raise HandbenchError(f"{path}: 'covariance' is not symmetric and positive; calibrate again")
    return Transform(source, target, matrix, covariance, residuals_m)


def _numbers(path: str | Path, key: str, value: object, shapes: list[tuple[int, ...]] | None) -> np.ndarray:
    """`value` as a float array of one of the shapes (None: any list); refuses anything else."""
    expected = " or ".join("×".join(map(str, shape)) for shape in shapes) if shapes else "a list of"
    try:
        array = np.array(value)
        good = array.dtype.kind in "iuf" and np.isfinite(array).all() and np.abs(array).max(initial=0) < LARGEST
    except ValueError:  # rows of different lengths
        good = False
    if not good or (array.shape not in shapes if shapes else array.ndim != 1):
        shown = repr(value)
        raise HandbenchError(
            f"{path}: '{key}' is {shown if len(shown) < 60 else shown[:57] + '...'}; expected {expected} finite numbers"
        )
    return array.astype(np.float64)
