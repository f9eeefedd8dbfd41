"""A first plane for every pixel, from plane sweeps at half the resolution.

Gallup et al., "Real-time plane-sweeping stereo with multiple sweeping directions", CVPR 2007:
windows on planes that face the camera do not match on a floor seen at a low angle, and PatchMatch
does not recover from such a guess. Each pixel takes the planes of the best-matching of several
sweeps.
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
# tangents of the angles, 56° and 76°, under which the planes of the other sweeps are seen
INCIDENCES = (1.5, 4.0)
SLANTS = tuple(
    (a * tangent, b * tangent)
    for tangent in INCIDENCES
    for a, b in ((1, 0), (-1, 0), (0, 1), (0, -1))
)
MERIT_PX = 5  # side of the window of the mean cost by which sweeps are compared


def planes_swept(half: View, unit: float) -> tuple[float, float, int]:
    """Return the first and last disparity of a sweep that covers the depths of a view, and the
    number of planes. unit: inverse depth (1/m) of one step of disparity."""
    first, last = (1 / (z * unit) for z in (np.nanmax(half.far_m), np.nanmin(half.near_m)))
    return first, last, int(np.clip(np.ceil(last - first), FEWEST_PLANES, MOST_PLANES))


def first_guess(
    view: View, half: View, sources: list[View], unit: float, slanted: bool
) -> np.ndarray:
    """Guess the plane of each pixel of a view by plane sweeps at half the resolution.

    half, sources: the view and its sources at half the resolution; unit: inverse depth (1/m) of one
    disparity of the full view. slanted: also sweep planes that are tilted to each of four sides,
    and keep the best-matching plane at each pixel. Returns [h, w, 3] float32 for the full view:
    disparity, slope per column and slope per row.
    """
    stereo = Stereo.of(half, sources)
    scale, (h, w) = stereo.unit / unit, view.gray.shape
    facing = _sweep(half, stereo, (0.0, 0.0), unit)
    if not slanted:
        disparity = cv2.resize(facing, (w, h), interpolation=cv2.INTER_LINEAR)
        return _planes(disparity, *_slopes(disparity, SLOPE_PX))
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


def _best(half: View, stereo: Stereo, candidates: list[np.ndarray]) -> np.ndarray:
    """Choose, at each pixel, the plane that matches best among several maps of planes [h, w, 3];
    costs are averaged over a small window first."""
    low, high = 1 / (half.far_m * stereo.unit), 1 / (half.near_m * stereo.unit)
    merits = []
    for planes in candidates:
        planes[..., 0] = np.fmin(np.fmax(planes[..., 0], low), high)
        cost = patchmatch.refine(stereo, planes, low, high, 0, 0)
        merits.append(cv2.blur(np.minimum(cost, 1), (MERIT_PX, MERIT_PX)))
    best = np.argmin(merits, axis=0)[None, ..., None]
    return np.take_along_axis(np.stack(candidates), best, axis=0)[0]


def _planes(
    disparity: np.ndarray, slope_x: np.ndarray | float, slope_y: np.ndarray | float
) -> np.ndarray:
    parts = np.broadcast_arrays(disparity, slope_x, slope_y)
    return np.ascontiguousarray(np.stack(parts, axis=-1), dtype=np.float32)


def _slopes(disparity: np.ndarray, smooth_px: float) -> tuple[np.ndarray, np.ndarray]:
    """Compute the slopes of a disparity map [h, w] per column and per row, each [h, w], after
    smoothing with a standard deviation of smooth_px; steep ones are clipped."""
    slope_y, slope_x = np.gradient(cv2.GaussianBlur(disparity, (0, 0), smooth_px))
    return np.clip(slope_x, -STEEPEST, STEEPEST), np.clip(slope_y, -STEEPEST, STEEPEST)


def _sweep(half: View, stereo: Stereo, slope: tuple[float, float], unit: float) -> np.ndarray:
    """Sweep planes that all have the same slope (disparities of `stereo` per column and row).
    Returns the disparity [h, w] float32 in steps of `unit` (1/m)."""
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
    """Compute each pixel's plane [h, w, 3] (disparity, slope per column, slope per row) from depths
    [h, w] and unit normals [h, w, 3] in the camera frame.

    unit: inverse depth (1/m) of one disparity; steepest: limit of the slopes. NaN for depths
    outside the view's range and for normals that face away. The plane n·X = d is 1/z = (n·K⁻¹x)/d.
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
