"""The box in which depth maps and surface are computed, and the plane of the board.

A box saves the time for matching the background. It is given, or found around the target's points:
all points, or those that rise above the plane of the board.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from handbench.groundtruth.board import load_board
from handbench.groundtruth.dense.fusion import Cloud
from handbench.groundtruth.sparse.sparse import Sparse
from handbench.support.progress import say

FLATTEST = 0.04  # of a board's radius: one with farther corners has several planes
FINEST_M = 1e-3  # least deviation of a board from its plane
REACH_M = 0.3  # from a board's edge to its target's points
ABOVE_M = 1e-2  # least height of these points, beside the deviation
FEWEST_POINTS = 30  # that locate the target
FEWEST_VIEWS = 3  # of a sparse point
BETWEEN = (0.005, 0.995)  # quantiles of the points along each axis
# of the points' diagonal, on each side: smooth skin has few features (a fingertip's was 47 mm off)
ROOM = 0.5
ROOM_OF_MAPS = 0.15  # the same where coarse depth maps show the skin
AT_SIDE = 0.01  # distance from a side of the box, relative to its size
CUT = 0.002  # share of the points there that indicates a cut


class Plane(NamedTuple):
    """The plane of a board in the mesh's frame.

    origin_m [3]: mean of the board's corners. normal [3]: unit vector towards the cameras. reach_m:
    distance from the origin up to which points may be the target's. rough_m: distance from the
    plane up to which a point may belong to the board.
    """

    origin_m: np.ndarray
    normal: np.ndarray
    reach_m: float
    rough_m: float

    def height_m(self, points_m: np.ndarray) -> np.ndarray:
        """Return the height [n] of points [n, 3] above the board, metres."""
        return np.asarray((points_m - self.origin_m) @ self.normal)


def board_plane(photos: Path, board: Path | None, sparse: Sparse) -> Plane | None:
    """Fit the plane of the board that gave the scale.

    photos: folder of the photographs. board: file of the board's description (None: board.toml in
    that folder). Returns None if the scale is not from a board, or if the board's corners do not
    lie in one plane.
    """
    if sparse.scale.source != "board":
        return None
    corners = load_board(board or photos / "board.toml").corners_m()
    centres_m = np.array([camera.centre_m for camera in sparse.cameras()])
    return plane_through(
        np.concatenate(list(corners.values())), centres_m, sparse.scale.residual_m or 0.0
    )


def plane_through(corners_m: np.ndarray, centres_m: np.ndarray, residual_m: float) -> Plane | None:
    """Fit a plane to a board's corners [n, 3], with its normal towards the cameras' centres [m, 3].

    residual_m: root mean square error of the corners. Returns None if the corners do not lie in one
    plane.
    """
    origin_m = corners_m.mean(axis=0)
    normal = np.linalg.svd(corners_m - origin_m)[2][2]
    if np.median((centres_m - origin_m) @ normal) < 0:
        normal = -normal
    radius_m = float(np.linalg.norm(corners_m - origin_m, axis=1).max())
    plane = Plane(origin_m, normal, radius_m + REACH_M, max(FINEST_M, 4 * residual_m))
    return plane if np.abs(plane.height_m(corners_m)).max() <= FLATTEST * radius_m else None


@dataclass(frozen=True)
class Volume:
    """The box in which depth maps and surface are computed.

    box_m: xmin, ymin, zmin, xmax, ymax, zmax in the mesh's frame (None: no limits). source: how the
    box was found, in words, such as "given" or "sparse points".
    """

    box_m: tuple[float, ...] | None
    source: str

    def box(self) -> np.ndarray | None:
        """Return the lowest and highest corner [2, 3] of the box; None for a volume without
        limits."""
        return None if self.box_m is None else np.reshape(self.box_m, (2, 3))

    def describe(self) -> str:
        """Describe the volume in one line: how it was found, and its limits."""
        size = "" if self.box_m is None else f": {', '.join(f'{side:.3f}' for side in self.box_m)}"
        return f"volume ({self.source}){size}"


def volume(given: tuple[float, ...] | None, plane: Plane | None, sparse: Sparse) -> Volume:
    """Choose the volume to reconstruct: the given box (xmin, ymin, zmin, xmax, ymax, zmax), or one
    around the sparse points of the target. If these are too few, it is around the board, or without
    limits."""
    if given is not None:
        return Volume(given, "given")
    features_m = _features_m(sparse, plane)
    if len(features_m) >= FEWEST_POINTS:
        return _around([features_m], ROOM, "sparse points")
    if plane is not None:
        ends_m = plane.origin_m + np.array([[-1.0], [1.0]]) * plane.reach_m
        return Volume(tuple(ends_m.ravel().tolist()), "the board")
    return Volume(None, "everything")


def narrow_volume(found: Volume, cloud: Cloud, plane: Plane | None, sparse: Sparse) -> Volume:
    """Narrow a volume that was found automatically to the target's points, both of `cloud`, which
    was fused from depth maps of low resolution without the thinnest fingers, and sparse ones. It is
    unchanged if the cloud has too few."""
    both_m = [_of_target(cloud.points_m, plane), _features_m(sparse, plane)]
    if len(both_m[0]) < FEWEST_POINTS:
        return found
    return _around(both_m, ROOM_OF_MAPS, "sparse points and coarse depth maps")


def _features_m(sparse: Sparse, plane: Plane | None) -> np.ndarray:
    """Return the sparse points [n, 3] of the target that at least three photographs show."""
    points = sparse.model.points3D.values()
    shown_m = [point.xyz for point in points if point.track.length() >= FEWEST_VIEWS]
    return _of_target(np.reshape(shown_m, (-1, 3)), plane)


def _of_target(points_m: np.ndarray, plane: Plane | None) -> np.ndarray:
    """Return the points that may be the target's: all, or those above a board and near it."""
    if plane is None:
        return points_m
    above = plane.height_m(points_m) > ABOVE_M + plane.rough_m
    return points_m[above & (np.linalg.norm(points_m - plane.origin_m, axis=1) < plane.reach_m)]


def _around(sets_m: list[np.ndarray], room: float, source: str) -> Volume:
    """Make a volume around those sets of points [n, 3] that are large enough, without each one's
    extremes. room: margin on each side, relative to the diagonal. source: what the points are
    from."""
    large_m = [points_m for points_m in sets_m if len(points_m) >= FEWEST_POINTS]
    ends_m = np.concatenate([np.quantile(points_m, BETWEEN, axis=0) for points_m in large_m])
    low, high = ends_m.min(axis=0), ends_m.max(axis=0)
    room_m = room * np.linalg.norm(high - low)
    return Volume(tuple(np.round([*(low - room_m), *(high + room_m)], 6).tolist()), source)


def warn_of_cuts(found: Volume, cloud: Cloud, plane: Plane | None) -> None:
    """Print a warning if an automatically found volume seems to cut the target, because many points
    of the cloud lie close to its sides. plane: of the board, whose own points are ignored."""
    box_m = found.box()
    if box_m is None or found.source == "given":
        return
    points_m = _of_target(cloud.points_m, plane)
    near = np.abs(points_m - box_m[:, None]) < AT_SIDE * np.ptp(box_m, axis=0)
    share = near.any(axis=(0, 2)).mean() if len(points_m) else 0
    if share > CUT:
        say(
            f"volume: {share:.1%} of the points are at the sides of the box, so it may cut the "
            "surface; give a larger --box, such as a simulated capture's box_m in capture.toml"
        )
