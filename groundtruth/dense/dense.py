"""Depth maps of all views, computed on the CPU.

Every threshold is in pixels of the working resolution, never in millimetres, so that a hand, a
façade and a scene without metric scale need the same thresholds.
"""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from handbench.groundtruth.cameras import camera_in, pycolmap, registered_images
from handbench.groundtruth.dense import patchmatch
from handbench.groundtruth.dense.views import Stereo, View, open_view
from handbench.groundtruth.photos import Photo, read_mask
from handbench.support.cost import require_memory
from handbench.support.errors import HandbenchError
from handbench.support.progress import track

FEWEST_VIEWS = 3
PIXEL_BYTES = 70  # of a view with its depths, normals and points
DEPTH_QUANTILES, DEPTH_MARGIN = (0.01, 0.99), 0.15  # of the sparse points a view sees
SOURCES = 4
HALVINGS = 2  # of the resolution, at which the search begins
# largest variation of the disparity in each iteration at the other resolutions
REACHES_PX = (1.0, 1.0, 0.5)
# a pixel is matched where a match at half the resolution is as good, so many pixels around
HOPEFUL_COST = 0.4
HOPEFUL_PX = 5
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
    views, tracks_of_views = [], []
    for image, seen in zip(track(images, "undistorting"), tracks.T, strict=True):
        photo, camera, pose = by_name[image.name], camera_in(image), image.cam_from_world()
        near, far = np.quantile((pose * points_m[seen])[:, 2], DEPTH_QUANTILES)
        range_m = float(near * (1 - DEPTH_MARGIN)), float(far * (1 + DEPTH_MARGIN))
        mask = read_mask(photo, masks)
        view = open_view(photo, camera, pose, shrink, range_m, box_m, mask)
        if view is not None:
            views.append(view)
            tracks_of_views.append(seen)
    if len(views) < FEWEST_VIEWS:
        raise HandbenchError(
            f"box_m: only {len(views)} of the {len(images)} registered photographs show this "
            f"box; expected at least {FEWEST_VIEWS}; check its numbers, which are metres in the "
            "frame of the board (or of the camera poses)"
        )
    require_memory(
        PIXEL_BYTES * sum(view.gray.size for view in views),
        f"dense: {len(views)} depth maps",
        "choose a lower --quality, or fewer or smaller photographs",
    )
    return views, choose_sources(views, np.transpose(tracks_of_views), points_m)


def depth_maps(views: list[View], sources: list[list[int]], seed: int) -> list[ViewDepth]:
    """Compute the depth map of every view on the CPU, by matching it with its source views.

    Planes are drawn at random at a quarter of the resolution; they are refined there, at half of
    the resolution, and at the whole. sources: for each view, the indices of its sources in `views`.
    seed: of random numbers.
    """
    pyramid = [views]
    for _ in range(HALVINGS):
        pyramid.insert(0, [view.halved() for view in pyramid[0]])
    return [
        _depth_map([(level[i], [level[s] for s in sources[i]]) for level in pyramid], seed)
        for i in track(range(len(views)), "depth maps")
    ]


def _depth_map(pyramid: list[tuple[View, list[View]]], seed: int) -> ViewDepth:
    """Compute the depth map of a view from the view and its sources at growing resolutions."""
    view, others = pyramid[0]
    stereo = Stereo.of(view, others)
    low, high = disparity_range(view, stereo.unit)
    noise = np.random.default_rng(seed).random(low.shape, np.float32)
    planes = np.stack([low + noise * (high - low), 0 * low, 0 * low])
    widest = np.nanmax(high - low, initial=0)
    reaches = (widest * 0.5 ** np.arange(1 + np.log2(1 + widest))).tolist()
    planes, cost, support = patchmatch.refine(stereo, planes, low, high, reaches, seed)
    for view, others in pyramid[1:]:
        coarse, stereo = stereo, Stereo.of(view, others)
        low, high = disparity_range(view, stereo.unit)
        size = low.shape[::-1]
        cost = cv2.erode(cost, np.ones((HOPEFUL_PX, HOPEFUL_PX)))
        *doubled, cost = (
            cv2.resize(part, size, interpolation=cv2.INTER_NEAREST) for part in (*planes, cost)
        )
        low[cost > HOPEFUL_COST] = np.nan
        finer = coarse.unit / stereo.unit * np.array([1, 0.5, 0.5])
        planes = np.stack(doubled) * finer.astype(np.float32)[:, None, None]
        planes[0] = np.clip(planes[0], low, high)
        planes, cost, support = patchmatch.refine(stereo, planes, low, high, REACHES_PX, seed)
    return depth_of(view, stereo, planes, cost, support)


def disparity_range(view: View, unit: float) -> tuple[np.ndarray, np.ndarray]:
    """Compute the lowest and highest disparity [h, w] of a view's depth range; unit: inverse depth
    (1/m) of one step of disparity."""
    return 1 / (view.far_m * np.float32(unit)), 1 / (view.near_m * np.float32(unit))


def depth_of(
    view: View, stereo: Stereo, planes: np.ndarray, cost: np.ndarray, support: np.ndarray
) -> ViewDepth:
    """Turn what `patchmatch.refine` returns into a depth map, without poor matches, grazing
    surfaces and pixels next to depth jumps."""
    normals, cosine = _normals(view, planes)
    good = (cost < HIGHEST_COST) & (cosine > LOWEST_COSINE) & (support >= LEAST_SUPPORT)
    good &= ~_beside_jump(planes)
    depth_m = np.where(good, 1 / (planes[0].astype(np.float64) * stereo.unit), np.nan)
    return ViewDepth(view, depth_m, normals @ view.R)


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
        best = np.argsort(-score, kind="stable")[: min(SOURCES, len(views) - 1)]
        chosen.append(best.tolist())
    return chosen


def _normals(view: View, planes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compute the surface's normals from planes [3, h, w] (disparity and its slopes per column and
    row).

    Returns unit normals [h, w, 3] in the camera frame, towards the camera, and the cosine [h, w] of
    the angle between normal and line of sight. Where inverse depth is ω(x) = m·x over the pixels x
    = K X / z, the surface is the plane (Kᵀ m)·X = 1.
    """
    h, w = view.gray.shape
    v, u = np.mgrid[:h, :w]
    disparity, slope_x, slope_y = planes.astype(np.float64)
    m = np.stack([slope_x, slope_y, disparity - slope_x * u - slope_y * v], axis=-1)
    normals = -m @ view.K
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    rays = view.rays()
    return normals, -(normals * rays).sum(axis=-1) / np.linalg.norm(rays, axis=-1)


def _beside_jump(planes: np.ndarray) -> np.ndarray:
    """Mark the pixels next to a jump in depth, where a matching window covers two surfaces and
    biases the depth.

    planes [3, h, w]: disparity and its slopes per column and row. Returns True [h, w] where a
    neighbour's disparity differs by more than JUMP_PX (one pixel) from the continued plane.
    """
    disparity, slope_x, slope_y = planes
    beside = np.zeros(disparity.shape, dtype=bool)
    for axis, slope in ((1, slope_x), (0, slope_y)):
        here, there = (
            (slice(None),) * axis + (part,) for part in (slice(None, -1), slice(1, None))
        )
        jump = np.abs(np.diff(disparity, axis=axis) - (slope[here] + slope[there]) / 2) > JUMP_PX
        beside[here] |= jump
        beside[there] |= jump
    return beside
