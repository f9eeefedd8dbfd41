"""The plane of a board, which tells the target from what it stands before or lies on."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from groundtruth.board.board import load_board
from groundtruth.sparse.sparse import Sparse

FLATTEST = 0.02  # of a board's extent: one whose corners lie farther from their plane has several planes
FINEST_M = 1e-3  # no board is flatter, and known better


class Plane(NamedTuple):
    """A board's plane in the mesh's frame. axes [3, 3]: unit vectors along rows, two in the plane and its normal on the
    cameras' side. extent_m [2, 2]: lowest and highest corner along the first two. rough_m: how far the board may lie
    from the plane."""

    origin_m: np.ndarray
    axes: np.ndarray
    extent_m: np.ndarray
    rough_m: float

    def local(self, points_m: np.ndarray) -> np.ndarray:
        """Points [n, 3] along the axes; the last column is their height above the board."""
        return (points_m - self.origin_m) @ self.axes.T

    def world(self, points_m: np.ndarray) -> np.ndarray:
        """Points [n, 3] along the axes in the mesh's frame."""
        return points_m @ self.axes + self.origin_m


def board_plane(photos: Path, board: Path | None, sparse: Sparse) -> Plane | None:
    """The plane of the board that gave the scale: the one given, or that beside the photographs. None without a board,
    and for one whose corners lie in several planes."""
    if sparse.scale.source != "board":
        return None
    corners = load_board(board or photos / "board.toml").corners_m()
    centres_m = np.array([camera.centre_m for camera in sparse.cameras()])
    return plane_through(np.concatenate(list(corners.values())), centres_m, sparse.scale.residual_m or 0.0)


def plane_through(corners_m: np.ndarray, centres_m: np.ndarray, residual_m: float) -> Plane | None:
    """The plane of corners [n, 3] (None: they do not lie in one), its normal towards the cameras' centres [m, 3];
    residual_m: how far the corners are from where they were found."""
    origin_m = corners_m.mean(axis=0)
    _, _, axes = np.linalg.svd(corners_m - origin_m, full_matrices=False)
    axes[2] = np.cross(axes[0], axes[1])
    if np.median((centres_m - origin_m) @ axes[2]) < 0:
        axes[1:] *= -1
    local = (corners_m - origin_m) @ axes.T
    extent_m = np.stack([local[:, :2].min(axis=0), local[:, :2].max(axis=0)])
    if np.abs(local[:, 2]).max() > FLATTEST * np.linalg.norm(extent_m[1] - extent_m[0]):
        return None
    return Plane(origin_m, axes, extent_m, max(FINEST_M, 4 * residual_m))
