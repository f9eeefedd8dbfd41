"""The box in which depth maps and surface are computed, and the plane of the board.

A box saves the time for matching the background. It is given, or found from the board, the cameras'
common field of view and the sparse points. The plane separates the target from the surface that
carries the board.
"""

from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np

from handbench.groundtruth.board.board import load_board
from handbench.groundtruth.cameras.cameras import Camera
from handbench.groundtruth.dense.fusion import Cloud
from handbench.groundtruth.sparse.sparse import Sparse
from handbench.support.progress import say

# of a board's extent: one whose corners lie farther from their plane has several planes
FLATTEST = 0.02
FINEST_M = 1e-3  # least deviation of a board from its plane


class Plane(NamedTuple):
    """The plane of a board in the mesh's frame.

    origin_m [3]: mean of the board's corners. axes [3, 3]: unit vectors as rows, first two in the
    plane, then its normal towards the cameras. extent_m [2, 2]: smallest and largest coordinates of
    the corners along the first two axes. rough_m: distance from the plane up to which a point may
    belong to the board.
    """

    origin_m: np.ndarray
    axes: np.ndarray
    extent_m: np.ndarray
    rough_m: float

    def local(self, points_m: np.ndarray) -> np.ndarray:
        """Convert points [n, 3] of the mesh's frame to coordinates [n, 3] along the board's axes;
        the last column is the height above the board."""
        return (points_m - self.origin_m) @ self.axes.T

    def around(self, box_m: np.ndarray) -> np.ndarray:
        """Compute the smallest axis-parallel box [2, 3] in the mesh's frame that contains box_m [2,
        3], which is given along the board's axes."""
        corners_m = np.array(list(product(*box_m.T))) @ self.axes + self.origin_m
        return np.stack([corners_m.min(axis=0), corners_m.max(axis=0)])


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
    _, _, axes = np.linalg.svd(corners_m - origin_m, full_matrices=False)
    axes[2] = np.cross(axes[0], axes[1])
    if np.median((centres_m - origin_m) @ axes[2]) < 0:
        axes[1:] *= -1
    local = (corners_m - origin_m) @ axes.T
    extent_m = np.stack([local[:, :2].min(axis=0), local[:, :2].max(axis=0)])
    if np.abs(local[:, 2]).max() > FLATTEST * np.linalg.norm(extent_m[1] - extent_m[0]):
        return None
    return Plane(origin_m, axes, extent_m, max(FINEST_M, 4 * residual_m))


FEWEST_POINTS = 30  # that tell where the target is; of fewer, the whole surroundings are taken
BETWEEN = (0.005, 0.995)  # quantiles of the points along each axis
# of the points' diagonal, on each side: smooth skin has few features (a fingertip's was 47 mm off)
GROWN = 0.5
REACH_M = 0.3  # of a board's surroundings, or its diagonal where that is longer
STANDS_M = 5e-3  # above the board: no point of the board
BELOW_M = 1e-2  # depth of the volume below the plane, so that the board itself is inside
NEAREST = 0.9  # of the lowest camera's height, where surroundings end
CELLS, FEWEST_VIEWS = 12, 3  # of the volume along each axis; photographs that must show a cell
COARSE_BETWEEN = (0.002, 0.998)  # quantiles of a coarse cloud's points on each axis
COARSE_ROOM, COARSE_ROOM_PX = 0.1, 6.0  # on each side: of their diagonal, and of the coarse pixels
# distance from a side relative to the volume's size; share of the cloud there that indicates a cut
AT_SIDE, CUT = 0.01, 0.002


@dataclass(frozen=True)
class Volume:
    """The box in which depth maps and surface are computed.

    box_m: xmin, ymin, zmin, xmax, ymax, zmax in the mesh's frame (None: no limits). source: how the
    box was found, in words, such as "given" or "the board and cameras".
    """

    box_m: tuple[float, ...] | None
    source: str

    @classmethod
    def found(cls, box_m: np.ndarray, source: str) -> "Volume":
        """Make a volume from a box [2, 3] (lowest and highest corner), rounded to micrometres."""
        return cls(tuple(box_m.ravel().round(6).tolist()), source)

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
    found around the photographed scene.

    With a board's plane, the found box surrounds the sparse points that rise above the plane near
    the board. Without a plane, it surrounds all sparse points, or has no limits if there are few
    points. A found box is cut to the part that enough photographs show.
    """
    if given is not None:
        return Volume(given, "given")
    points_m = _seen(sparse)
    if plane is None:
        if len(points_m) < FEWEST_POINTS:
            return Volume(None, "everything")
        box_m, source = _about(points_m), "cameras and sparse points"
    else:
        centres_m = np.array([camera.centre_m for camera in sparse.cameras()])
        local, source = off_plane(plane, points_m, centres_m)
        box_m = plane.around(local)
    return Volume.found(in_common_field(box_m, sparse.cameras()), source)


def _seen(sparse: Sparse) -> np.ndarray:
    """Return the sparse points [n, 3] that at least three photographs (FEWEST_VIEWS) show."""
    seen = [
        point.xyz
        for point in sparse.model.points3D.values()
        if point.track.length() >= FEWEST_VIEWS
    ]
    return np.array(seen).reshape(-1, 3)


def off_plane(plane: Plane, points_m: np.ndarray, centres_m: np.ndarray) -> tuple[np.ndarray, str]:
    """Find the box of the target above a board: around the points [n, 3] that rise above the board
    or, if these are too few, the board's whole surroundings.

    centres_m [m, 3]: the cameras' centres, which limit the height. Returns the box [2, 3] along the
    board's axes, and a phrase that says what it was found from.
    """
    reach_m = max(REACH_M, float(np.linalg.norm(plane.extent_m[1] - plane.extent_m[0])))
    lowest_camera_m = float(plane.local(centres_m)[:, 2].min())
    ceiling_m = (
        min(reach_m, NEAREST * lowest_camera_m) if lowest_camera_m > 2 * STANDS_M else reach_m
    )
    low, high = np.array(
        [[*(plane.extent_m[0] - reach_m), -BELOW_M], [*(plane.extent_m[1] + reach_m), ceiling_m]]
    )
    local = plane.local(points_m)
    stands = ((local > low) & (local < high)).all(axis=1) & (local[:, 2] > STANDS_M + plane.rough_m)
    if stands.sum() < FEWEST_POINTS:
        return np.stack([low, high]), "the board and cameras"
    about = _about(local[stands])
    return np.stack([[*np.maximum(low, about[0])[:2], -BELOW_M], np.minimum(high, about[1])]), (
        "the board, cameras and sparse points"
    )


def narrow_volume(found: Volume, cloud: Cloud, plane: Plane, sparse: Sparse) -> Volume:
    """Narrow a volume that was found automatically to the target, with a margin.

    The target is taken to be all points above the board, both of `cloud` (fused from depth maps of
    low resolution) and of the sparse points. The volume is returned unchanged if it has no limits,
    or if cloud or sparse points have too few points above the board.
    """
    box = found.box()
    if box is None:
        return found
    least_m = max(STANDS_M + plane.rough_m, COARSE_ROOM_PX * cloud.pixel_m)
    features_m = _seen(sparse)
    features_m = features_m[((features_m > box[0]) & (features_m < box[1])).all(axis=1)]
    dense, few = (
        local[local[:, 2] > least_m] for local in map(plane.local, (cloud.points_m, features_m))
    )
    if min(len(dense), len(few)) < FEWEST_POINTS:
        return found
    sides = np.stack(
        [np.quantile(dense, COARSE_BETWEEN, axis=0), np.quantile(few, BETWEEN, axis=0)]
    )
    low, high = sides[:, 0].min(axis=0), sides[:, 1].max(axis=0)
    room_m = COARSE_ROOM * np.linalg.norm(high - low) + COARSE_ROOM_PX * cloud.pixel_m
    sides = np.stack([[*(low - room_m)[:2], -BELOW_M], high + room_m])
    return Volume.found(
        np.clip(plane.around(sides), *box), f"{found.source}, and coarse depth maps"
    )


def _about(points_m: np.ndarray) -> np.ndarray:
    """Compute a box [2, 3] around points [n, 3] without their extremes, with a margin for parts of
    the target that have no features."""
    low, high = np.quantile(points_m, BETWEEN, axis=0)
    room_m = GROWN * np.linalg.norm(high - low)
    return np.stack([low - room_m, high + room_m])


def in_common_field(box_m: np.ndarray, cameras: tuple[Camera, ...]) -> np.ndarray:
    """Shrink a box [2, 3] to the part that at least three photographs (FEWEST_VIEWS) show, tested
    on a coarse lattice of points. The whole box is returned if there is no such part."""
    steps = (np.arange(CELLS) + 0.5) / CELLS
    cells_m = box_m[0] + np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(
        -1, 3
    ) * np.ptp(box_m, axis=0)
    shown = np.zeros(len(cells_m), dtype=int)
    for camera in cameras:
        ahead = (cells_m @ camera.rotation.T + camera.translation_m)[:, 2] > 0
        pixels = np.full((len(cells_m), 2), -1.0)
        if ahead.any():
            pixels[ahead] = camera.project(cells_m[ahead])
        shown += ((pixels >= 0) & (pixels <= (camera.width, camera.height))).all(axis=1)
    common_m = cells_m[shown >= FEWEST_VIEWS]
    if not len(common_m):
        return box_m
    # a half of it, and as much again for what is cut by a picture's edge
    cell_m = np.ptp(box_m, axis=0) / CELLS
    return np.clip(np.stack([common_m.min(axis=0) - cell_m, common_m.max(axis=0) + cell_m]), *box_m)


def warn_of_cuts(found: Volume, cloud: Cloud, plane: Plane | None) -> None:
    """Print a warning for each side of an automatically found volume that seems to cut the surface,
    because many points of the cloud lie close to that side.

    plane: of the board, whose own points are ignored, since they always reach the sides.
    """
    box_m = found.box()
    if box_m is None or found.source == "given":
        return
    points_m = cloud.points_m
    if plane is not None:
        points_m = points_m[plane.local(points_m)[:, 2] > STANDS_M + plane.rough_m]
    side_m = AT_SIDE * np.ptp(box_m, axis=0)
    near = np.abs(points_m[None] - box_m[:, None]) < side_m
    shares = near.sum(axis=1) / max(len(points_m), 1)
    for side, axis in zip(*np.nonzero(shares > CUT), strict=True):
        say(
            f"volume: {shares[side, axis]:.1%} of the points are at the side {'xyz'[axis]} = "
            f"{box_m[side, axis]:.3f} m of the box, so it may cut the surface; give a larger "
            "--box"
        )
