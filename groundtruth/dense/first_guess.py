"""Initial plane of every pixel, from a sweep of planes that face the camera, at half the
resolution."""

import cv2
import numpy as np

from handbench.groundtruth.dense import planesweep
from handbench.groundtruth.dense.views import Stereo, View

FEWEST_PLANES, MOST_PLANES = 16, 320
STEEPEST = 1.5  # disparities per pixel, of slopes that are read off the disparities
MEDIAN_PX = 5
# standard deviation, in the full view, of the smoothing before disparities are differentiated
SLOPE_PX = 3.0
# the same, of the smoothing before slopes are differentiated; largest sum of second derivatives
CURVED_PX, MOST_CURVED = 5.0, 0.05
# mean square distance, along each axis of the full view, of the pixels in a sweep's window and in
# the median's
FLATTENED_PX2 = ((2 * planesweep.WINDOW_RADIUS + 1) ** 2 - 1 + MEDIAN_PX**2 - 1) / 12 * 2**2


def planes_swept(half: View, unit: float) -> tuple[float, float, int]:
    """Choose the planes of a sweep that covers all depths of a view at half the resolution.

    unit: inverse depth (1/m) of one step of disparity. Returns the first and the last disparity,
    and the number of planes.
    """
    first, last = (1 / (z * unit) for z in (np.nanmax(half.far_m), np.nanmin(half.near_m)))
    return first, last, int(np.clip(np.ceil(last - first), FEWEST_PLANES, MOST_PLANES))


def first_guess(view: View, half: View, sources: list[View], unit: float) -> np.ndarray:
    """Compute an initial plane at each pixel of a view by a plane sweep at half the resolution.

    half, sources: the view and its source views at half the resolution. unit: inverse depth (1/m)
    of one step of disparity in the full view. Returns [h, w, 3] float32 for the full view:
    disparity, slope per column and slope per row.
    """
    h, w = view.gray.shape
    swept = _sweep(half, Stereo.of(half, sources), unit)
    disparity = cv2.resize(swept, (w, h), interpolation=cv2.INTER_LINEAR)
    planes = np.stack([disparity, *_slopes(disparity)], axis=-1)
    return _raised(np.ascontiguousarray(planes, dtype=np.float32))


def _raised(planes: np.ndarray) -> np.ndarray:
    """Correct the disparities of planes, in place, for the bias of flat windows on a convex
    surface: half the second derivatives times the window's mean square distances. Returns the
    planes.

    Where the texture is weak, PatchMatch keeps part of the error of its start: on fingers, some
    hundredths of a millimetre of an error of a tenth.
    """
    slope_x, slope_y = (cv2.GaussianBlur(planes[..., k], (0, 0), CURVED_PX) for k in (1, 2))
    second = np.gradient(slope_x, axis=1) + np.gradient(slope_y, axis=0)
    planes[..., 0] -= FLATTENED_PX2 / 2 * np.clip(second, -MOST_CURVED, MOST_CURVED)
    return planes


def _slopes(disparity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compute the slopes of a disparity map [h, w] per column and per row, each [h, w].

    The map is smoothed first. Slopes steeper than STEEPEST (disparities per pixel) are clipped to
    it.
    """
    slope_y, slope_x = np.gradient(cv2.GaussianBlur(disparity, (0, 0), SLOPE_PX))
    return np.clip(slope_x, -STEEPEST, STEEPEST), np.clip(slope_y, -STEEPEST, STEEPEST)


def _sweep(half: View, stereo: Stereo, unit: float) -> np.ndarray:
    """Find the disparity at each pixel of a view by a sweep of planes that face the camera.

    half: the view at half the resolution; stereo: its picture with the source views. Returns
    disparity [h, w] float32, converted to steps of `unit` (inverse depth, 1/m).
    """
    first, last, count = planes_swept(half, stereo.unit)
    step = (last - first) / (count - 1)
    swept = planesweep.swept_disparity(stereo._replace(b=stereo.b * step), first / step, count)
    disparity = cv2.medianBlur(swept, MEDIAN_PX) * (step * stereo.unit / unit)
    return disparity.astype(np.float32)


def planes_through(view: View, depth_m: np.ndarray, normals: np.ndarray, unit: float) -> np.ndarray:
    """Convert depths [h, w] (metres) and unit normals [h, w, 3] (camera frame) to each pixel's
    plane.

    unit: inverse depth (1/m) of one step of disparity. Slopes are clipped to ± STEEPEST. Returns
    [h, w, 3] float32: disparity, slope per column and slope per row; NaN for depths outside the
    view's range and for normals that face away. The plane n·X = d has 1/z = (n·K⁻¹x)/d at pixel x.
    """
    depth_m = depth_m.astype(np.float64)
    towards = (normals * view.rays()).sum(axis=-1)
    known = (view.near_m <= depth_m) & (depth_m <= view.far_m) & (towards < 0)
    depth_m, towards = np.where(known, depth_m, np.nan), np.where(known, towards, np.nan)
    slopes = normals[..., :2] / view.K[[0, 1], [0, 1]] / (depth_m * towards * unit)[..., None]
    planes = np.concatenate(
        [1 / (depth_m * unit)[..., None], np.clip(slopes, -STEEPEST, STEEPEST)], axis=-1
    )
    return np.ascontiguousarray(planes, dtype=np.float32)
