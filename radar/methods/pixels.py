"""Functions of the pixels of a depth map: averaging filter, growth of the path along z."""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from handbench.radar.data.arrays import Aperture
from handbench.radar.data.grid import bounding_box


def masked_mean(values: np.ndarray, size_px: int, weight: np.ndarray | None = None) -> np.ndarray:
    """Average a map [ny, nx] over a window of size_px × size_px around each pixel, leaving out NaN
    (normalised convolution); NaN stays NaN. weight [ny, nx]: weight of each pixel; None for equal
    weights."""
    if size_px == 1 or not np.isfinite(values).any():
        return values.copy()
    whole, box = np.full(values.shape, np.nan), bounding_box(np.isfinite(values))
    inner, known = values[box], np.isfinite(values[box])
    weight = np.where(known, 1.0 if weight is None else weight[box], 0.0)
    weight = (weight / weight.max()).astype(np.float64)
    offset = inner[known].mean()  # keeps the sums small, so that they lose no digits
    weighted = weight * np.where(known, inner - offset, 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        means = offset + _window_sums(weighted, size_px) / _window_sums(weight, size_px)
    whole[box] = np.where(known, means, np.nan)
    return whole


def _window_sums(values: np.ndarray, size_px: int) -> np.ndarray:
    """Sum a map over the window around each pixel: [ny, nx]. Each window is summed by itself, since
    a running sum would carry the rounding errors of strong pixels to weak ones."""
    for axis in (1, 0):
        padding = [(0, 0), (0, 0)]
        padding[axis] = (size_px // 2, (size_px - 1) // 2)
        windows = sliding_window_view(np.pad(values, padding), size_px, axis)
        values = sum((windows[..., i] for i in range(size_px)), np.zeros(values.shape))
    return values


def path_gradient_z(points_m: np.ndarray, aperture: Aperture) -> np.ndarray:
    """Compute the derivative ∂(|p − t| + |p − r|)/∂z of the path from transmitter to point to
    receiver at points p [n, 3], averaged over the channels: [n], at most 2, its value on the axis
    far away."""
    from handbench.radar.imaging.cpu.steering import mean_rise  # numba

    points = np.ascontiguousarray(points_m, np.float64)
    rises = (leg.passes * mean_rise(leg.position_m, leg.channels, points) for leg in aperture.legs)
    return np.asarray(sum(rises))
