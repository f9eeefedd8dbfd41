"""Initial plane of every pixel, from plane sweeps at half the resolution.

Gallup et al., "Real-time plane-sweeping stereo with multiple sweeping directions", CVPR 2007. A
sweep of planes that face the camera fails on surfaces seen at a low angle, such as a floor, and
PatchMatch does not recover from such a start. So planes in several directions can be swept, and
each pixel takes the plane that matches best.
"""

import cv2
import numpy as np

from handbench.groundtruth.dense import patchmatch, planesweep
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
# tangents of the angles, 56° and 76°, under which the planes of the other sweeps are seen
INCIDENCES = (1.5, 4.0)
SLANTS = tuple(
    (a * tangent, b * tangent)
    for tangent in INCIDENCES
    for a, b in ((1, 0), (-1, 0), (0, 1), (0, -1))
)
MERIT_PX = 5  # side of the window of the mean cost by which sweeps are compared


def planes_swept(half: View, unit: float) -> tuple[float, float, int]:
    """Choose the planes of a sweep that covers all depths of a view at half the resolution.

    unit: inverse depth (1/m) of one step of disparity. Returns the first and the last disparity,
    and the number of planes.
    """
    first, last = (1 / (z * unit) for z in (np.nanmax(half.far_m), np.nanmin(half.near_m)))
    return first, last, int(np.clip(np.ceil(last - first), FEWEST_PLANES, MOST_PLANES))


def first_guess(
    view: View, half: View, sources: list[View], unit: float, slanted: bool
) -> np.ndarray:
    """Compute an initial plane at each pixel of a view by plane sweeps at half the resolution.

    half, sources: the view and its source views at half the resolution. unit: inverse depth (1/m)
    of one step of disparity in the full view. slanted: also sweep planes that are tilted to four
    sides, and keep the best-matching plane at each pixel. Returns [h, w, 3] float32 for the full
    view: disparity, slope per column and slope per row.
    """
    stereo = Stereo.of(half, sources)
    scale, (h, w) = stereo.unit / unit, view.gray.shape
    facing = _sweep(half, stereo, (0.0, 0.0), unit)
    if not slanted:
        disparity = cv2.resize(facing, (w, h), interpolation=cv2.INTER_LINEAR)
        return _raised(_planes(disparity, *_slopes(disparity, SLOPE_PX)))
    candidates = [_planes(facing / scale, *_slopes(facing / scale, SLOPE_PX / 2))]
    depth_m = 2 / np.nanmedian(1 / half.near_m + 1 / half.far_m)
    slope = 1 / (half.K[0, 0] * depth_m * stereo.unit)  # of the disparity, per pixel, at 45°
    for a, b in SLANTS:
        candidates.append(
            _planes(_sweep(half, stereo, (a * slope, b * slope), stereo.unit), a * slope, b * slope)
        )
    y, x = np.mgrid[:h, :w]  # of the full view, whose pixels are half as wide
    planes = _best(half, stereo, candidates)[y // 2, x // 2] * np.array([1, 0.5, 0.5]) * scale
    planes[..., 0] += planes[..., 1] * (x % 2 - 0.5) + planes[..., 2] * (y % 2 - 0.5)
    return planes.astype(np.float32)


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


def _best(half: View, stereo: Stereo, candidates: list[np.ndarray]) -> np.ndarray:
    """Choose at each pixel the best-matching of several planes.

    candidates: maps [h, w, 3] of disparity and its slopes, whose disparities are limited in place
    to the view's depth range. Matching costs are averaged over a small window before they are
    compared. Returns one such map.
    """
    low, high = 1 / (half.far_m * stereo.unit), 1 / (half.near_m * stereo.unit)
    merits = []
    for planes in candidates:
        planes[..., 0] = np.fmin(np.fmax(planes[..., 0], low), high)
        cost, _ = patchmatch.refine(stereo, planes, low, high, 0, 0)
        merits.append(cv2.blur(np.minimum(cost, 1), (MERIT_PX, MERIT_PX)))
    best = np.argmin(merits, axis=0)[None, ..., None]
    return np.take_along_axis(np.stack(candidates), best, axis=0)[0]


def _planes(
    disparity: np.ndarray, slope_x: np.ndarray | float, slope_y: np.ndarray | float
) -> np.ndarray:
    parts = np.broadcast_arrays(disparity, slope_x, slope_y)
    return np.ascontiguousarray(np.stack(parts, axis=-1), dtype=np.float32)


def _slopes(disparity: np.ndarray, smooth_px: float) -> tuple[np.ndarray, np.ndarray]:
    """Compute the slopes of a disparity map [h, w] per column and per row, each [h, w].

    The map is first smoothed by a Gaussian with standard deviation smooth_px. Steeper slopes than
    STEEPEST (disparities per pixel) are clipped to it.
    """
    slope_y, slope_x = np.gradient(cv2.GaussianBlur(disparity, (0, 0), smooth_px))
    return np.clip(slope_x, -STEEPEST, STEEPEST), np.clip(slope_y, -STEEPEST, STEEPEST)


def _sweep(half: View, stereo: Stereo, slope: tuple[float, float], unit: float) -> np.ndarray:
    """Find the disparity at each pixel of a view by a sweep of parallel planes.

    half: the view at half the resolution; stereo: its picture with the source views. slope: the
    planes' common slopes per column and row, in disparities of `stereo` per pixel. Returns
    disparity [h, w] float32, converted to steps of `unit` (inverse depth, 1/m).
    """
    h, w = half.gray.shape
    first, last, count = planes_swept(half, stereo.unit)
    step = (last - first) / (count - 1)
    # of the disparity, as a function of x
    row = np.array([*slope, -slope[0] * w / 2 - slope[1] * h / 2])
    swept = stereo._replace(A=stereo.A + stereo.b[:, :, None] * row, b=stereo.b * step)
    found = cv2.medianBlur(planesweep.swept_disparity(swept, first / step, count), MEDIAN_PX) * (
        step * stereo.unit / unit
    )
    y, x = np.mgrid[:h, :w]
    return (found + row[0] * x + row[1] * y + row[2]).astype(np.float32)


def planes_through(
    view: View, depth_m: np.ndarray, normals: np.ndarray, unit: float, steepest: float = STEEPEST
) -> np.ndarray:
    """Convert depths [h, w] (metres) and unit normals [h, w, 3] (camera frame) to each pixel's
    plane.

    unit: inverse depth (1/m) of one step of disparity. steepest: slopes are clipped to ± this
    value. Returns [h, w, 3] float32: disparity, slope per column and slope per row; NaN for depths
    outside the view's range and for normals that face away. The plane n·X = d has 1/z = (n·K⁻¹x)/d
    at pixel x.
    """
    depth_m = depth_m.astype(np.float64)
    towards = (normals * view.rays()).sum(axis=-1)
    known = (view.near_m <= depth_m) & (depth_m <= view.far_m) & (towards < 0)
    depth_m, towards = np.where(known, depth_m, np.nan), np.where(known, towards, np.nan)
    slopes = normals[..., :2] / view.K[[0, 1], [0, 1]] / (depth_m * towards * unit)[..., None]
    planes = np.concatenate(
        [1 / (depth_m * unit)[..., None], np.clip(slopes, -steepest, steepest)], axis=-1
    )
    return np.ascontiguousarray(planes, dtype=np.float32)
