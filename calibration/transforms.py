"""Similarity transforms between named frames."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from radar.errors import HandbenchError
from radar.files import read_json, write_json


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


def load_transform(path: str | Path) -> Transform:
    """Read a transform file; refuses anything but a finite 4×4 similarity without reflection."""
    content = read_json(path, 'a transform file {"from", "to", "matrix", ...}')
    try:
        matrix = np.array(content["matrix"], dtype=np.float64)
        source, target = str(content["from"]), str(content["to"])
        covariance = content.get("covariance")
        covariance = None if covariance is None else np.array(covariance, dtype=np.float64)
        residuals_m = np.array(content.get("residuals_m") or [], dtype=np.float64)
    except (KeyError, TypeError, ValueError) as error:
        raise HandbenchError(
            f'{path}: is not a transform file ({error!r}); expected keys "from", "to", "matrix" (4×4)'
        ) from None
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
        raise HandbenchError(f"{path}: 'matrix' has shape {matrix.shape}; expected 4×4 finite numbers in row order")
    linear = matrix[:3, :3]
    scale2 = np.trace(linear @ linear.T) / 3
    if np.linalg.det(linear) <= 0 or np.abs(linear @ linear.T / scale2 - np.eye(3)).max() > 1e-6:
        raise HandbenchError(f"{path}: 'matrix' is not a rotation with one scale; reflections and shears are refused")
    return Transform(source, target, matrix, covariance, residuals_m)
