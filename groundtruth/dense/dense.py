"""Depth maps of all views, computed on the CPU.

Every threshold is in pixels of the working resolution, never in millimetres, so that a hand, a
façade and a scene without metric scale need the same thresholds.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from handbench.groundtruth.cameras.cameras import camera_in, pycolmap, registered_images
from handbench.groundtruth.dense import patchmatch
from handbench.groundtruth.dense.first_guess import first_guess
from handbench.groundtruth.dense.views import Stereo, View, open_view
from handbench.groundtruth.photos.masks import read_mask
from handbench.groundtruth.photos.photos import Photo
from handbench.support.cost import require_memory
from handbench.support.errors import HandbenchError
from handbench.support.progress import track

FEWEST_VIEWS = 3
PIXEL_BYTES = 70  # of a view with its depths, normals and points
DEPTH_QUANTILES, DEPTH_MARGIN = (0.01, 0.99), 0.15  # of the sparse points a view sees
SOURCES = 4
# between a view and a good source
BEST_ANGLE_RAD, SPREAD_BELOW_RAD, SPREAD_ABOVE_RAD = np.deg2rad([12, 6, 25])
HIGHEST_COST = 0.3  # 1 − NCC, of a pixel that a depth map keeps
LOWEST_COSINE = 0.35  # of the angle between its surface normal and line of sight
# share of its neighbours that are on its surface: drops borders and parts thinner than five pixels
LEAST_SUPPORT = 0.67
JUMP_PX = 1.0  # of disparity, between a pixel and its neighbour on another surface


@dataclass(frozen=True)
class ViewDepth:
    """The depth map of one view.

    depth_m [h, w]: depth along the camera's z axis, metres, NaN if unknown. normals [h, w, 3]: unit
    normals of the surface in the world frame.
    """

    view: View
    depth_m: np.ndarray
    normals: np.ndarray


def open_views(
    photos: tuple[Photo, ...],
    model: "pycolmap.Reconstruction",
    shrink: int,
    box_m: np.ndarray | None,
    masks: Path | None,
) -> tuple[list[View], list[list[int]]]:
    """Prepare the registered photographs for dense matching, and choose which views each is matched
    with (its sources).

    model: COLMAP's, with cameras and sparse points. shrink: divisor of the resolution. box_m [2,
    3]: region of interest; photographs that do not show it are left out. masks: folder of the
    photographs' masks (None: all pixels that are not transparent are matched). Returns the views
    and, for each, the indices of its sources among them. Raises HandbenchError if fewer than three
    photographs show the box, or if their depth maps do not fit into memory.
    """
    by_name = {photo.name: photo for photo in photos}
    images = registered_images(model)
    points = list(model.points3D.values())
    points_m = np.array([point.xyz for point in points])
    column = {image.image_id: i for i, image in enumerate(images)}
    tracks = np.zeros((len(points), len(images)), dtype=bool)
    for row, point in zip(tracks, points, strict=True):
        row[[column[element.image_id] for element in point.track.elements]] = True
    views: list[View | None] = []
    for image, seen in zip(track(images, "undistorting"), tracks.T, strict=True):
        photo, camera, pose = by_name[image.name], camera_in(image), image.cam_from_world()
        near, far = np.quantile((pose * points_m[seen])[:, 2], DEPTH_QUANTILES)
        range_m = float(near * (1 - DEPTH_MARGIN)), float(far * (1 + DEPTH_MARGIN))
        mask = read_mask(photo, masks)
        views.append(open_view(photo, camera, pose, shrink, range_m, box_m, mask))
    showing = [i for i, view in enumerate(views) if view is not None]
    if len(showing) < FEWEST_VIEWS:
        raise HandbenchError(
            f"box_m: only {len(showing)} of the {len(views)} registered photographs show this "
            f"box; expected at least {FEWEST_VIEWS}; check its numbers, which are metres in the "
            "frame of the board (or of the camera poses)"
        )
    shown = [view for view in views if view is not None]
    require_memory(
        PIXEL_BYTES * sum(view.gray.size for view in shown),
        f"dense: {len(shown)} depth maps",
        "choose a lower --quality, or fewer or smaller photographs",
    )
    return shown, choose_sources(shown, tracks[:, showing], points_m)


def depth_maps(
    views: list[View], sources: list[list[int]], iterations: int, seed: int
) -> list[ViewDepth]:
    """Compute the depth map of every view on the CPU, by matching it with its source views.

    sources: for each view, the indices of its sources in `views`. iterations: of PatchMatch; seed:
    of its random numbers.
    """
    coarse = [view.halved() for view in views]
    maps = []
    for i in track(range(len(views)), "depth maps"):
        stereo = Stereo.of(views[i], [views[s] for s in sources[i]])
        planes = first_guess(views[i], coarse[i], [coarse[s] for s in sources[i]], stereo.unit)
        maps.append(refine_planes(views[i], stereo, planes, iterations, seed))
    return maps


def choose_sources(views: list[View], tracks: np.ndarray, points_m: np.ndarray) -> list[list[int]]:
    """Choose up to four source views to match each view with: those that share the most sparse
    points with it under a useful angle (Yao et al., ECCV 2018).

    tracks [n, views]: True where a view sees one of the n sparse points; points_m [n, 3]: these
    points. Returns for each view the indices of its sources, best first.
    """
    rays = np.stack([points_m - view.centre_m for view in views])
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    chosen = []
    for i in range(len(views)):
        angle = np.arccos(np.clip((rays * rays[i]).sum(axis=-1), -1, 1))
        spread = np.where(angle < BEST_ANGLE_RAD, SPREAD_BELOW_RAD, SPREAD_ABOVE_RAD)
        use = np.exp(-(((angle - BEST_ANGLE_RAD) / spread) ** 2) / 2)
        score = (use * (1e-3 + tracks.T * tracks[:, i])).sum(axis=1)
        score[i] = -1
        chosen.append(
            [int(s) for s in np.argsort(-score, kind="stable")[: min(SOURCES, len(views) - 1)]]
        )
    return chosen


def refine_planes(
    view: View, stereo: Stereo, planes: np.ndarray, iterations: int, seed: int = 0
) -> ViewDepth:
    """Turn an initial plane at each pixel of a view into a depth map.

    Three steps: PatchMatch, a refinement with curved windows, and the removal of poor matches,
    grazing surfaces and pixels next to depth jumps. With 0 iterations, the first step is skipped.

    stereo: the view's picture with its sources. planes [h, w, 3]: disparity (scaled inverse depth)
    and its slopes per column and row, NaN where unknown; changed in place. seed: of PatchMatch's
    random numbers.
    """
    known = np.isfinite(planes[..., 0])
    low, high = (np.where(known, 1 / (z * stereo.unit), np.nan) for z in (view.far_m, view.near_m))
    planes[..., 0] = np.clip(planes[..., 0], low, high)
    cost, support = patchmatch.refine(stereo, planes, low, high, iterations, seed)
    normals, cosine = _normals(view, planes)
    good = (cost < HIGHEST_COST) & (cosine > LOWEST_COSINE) & (support >= LEAST_SUPPORT)
    good &= (low <= high) & ~_beside_jump(planes)
    depth_m = np.where(good, 1 / (planes[..., 0].astype(np.float64) * stereo.unit), np.nan)
    return ViewDepth(view, depth_m, normals @ view.R)


def _normals(view: View, planes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compute the surface's normals from planes [h, w, 3] (disparity and its slopes per column and
    row).

    Returns unit normals [h, w, 3] in the camera frame, towards the camera, and the cosine [h, w] of
    the angle between normal and line of sight. Where inverse depth is ω(x) = m·x over the pixels x
    = K X / z, the surface is the plane (Kᵀ m)·X = 1.
    """
    h, w = view.gray.shape
    v, u = np.mgrid[:h, :w]
    slope_x, slope_y = planes[..., 1].astype(np.float64), planes[..., 2].astype(np.float64)
    m = np.stack([slope_x, slope_y, planes[..., 0] - slope_x * u - slope_y * v], axis=-1)
    normals = -m @ view.K
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    rays = view.rays()
    return normals, -(normals * rays).sum(axis=-1) / np.linalg.norm(rays, axis=-1)


def _beside_jump(planes: np.ndarray) -> np.ndarray:
    """Mark the pixels next to a jump in depth, where a matching window covers two surfaces and
    biases the depth.

    planes [h, w, 3]: disparity and its slopes per column and row. Returns True [h, w] where a
    neighbour's disparity differs by more than JUMP_PX (one pixel) from the continued plane.
    """
    disparity, slope_x, slope_y = np.moveaxis(planes, -1, 0)
    beside = np.zeros(disparity.shape, dtype=bool)
    for axis, slope in ((1, slope_x), (0, slope_y)):
        here, there = (
            (slice(None),) * axis + (part,) for part in (slice(None, -1), slice(1, None))
        )
        jump = np.abs(np.diff(disparity, axis=axis) - (slope[here] + slope[there]) / 2) > JUMP_PX
        beside[here] |= jump
        beside[there] |= jump
    return beside
