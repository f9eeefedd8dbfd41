"""Functions of the pixels of a depth map: averages over windows, growth of the path along z."""

import numpy as np

from handbench.radar.data.arrays import Aperture


def masked_mean(values: np.ndarray, size_px: int, weight: np.ndarray | None = None) -> np.ndarray:
    """Average a map [ny, nx] as `window_mean` does the values of its pixels. weight [ny, nx]."""
    pixels = tuple(np.indices(values.shape).reshape(2, -1))
    flat = None if weight is None else weight.ravel()
    return window_mean(values.ravel(), pixels, size_px, flat).reshape(values.shape)


def window_mean(
    values: np.ndarray,
    pixels: tuple[np.ndarray, ...],
    size_px: int,
    weight: np.ndarray | None = None,
) -> np.ndarray:
    """Average values [n] of the pixels (rows [n], columns [n]) over a window of size_px × size_px
    around each, with weights [n] (None: equal ones), leaving out NaN (normalised convolution): [n];
    NaN stays NaN."""
    from scipy.ndimage import correlate1d  # which settings do not need

    seen = np.isfinite(values)
    if size_px == 1 or not seen.any():
        return values
    rows, columns = (place - place.min() for place in pixels)
    weight = np.where(seen, 1.0 if weight is None else weight / np.float64(weight[seen].max()), 0.0)
    offset = values[seen].mean()  # keeps the sums small, so that they lose no digits
    maps = np.zeros((2, rows.max() + 1, columns.max() + 1))
    maps[:, rows, columns] = weight * np.where(seen, values - offset, 0.0), weight
    # each window by itself: a running sum would carry rounding errors of strong pixels to weak ones
    for axis in (1, 2):
        maps = correlate1d(maps, np.ones(size_px), axis, mode="constant")
    sums = maps[:, rows, columns]
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(seen, offset + sums[0] / sums[1], np.nan)


def path_gradient_z(points_m: np.ndarray, aperture: Aperture) -> np.ndarray:
    """Compute the derivative ∂(|p − t| + |p − r|)/∂z of the path from transmitter to point to
    receiver at points p [n, 3], averaged over the channels: [n], at most 2, its value on the axis
    far away."""
    from handbench.radar.imaging.steering import mean_rise  # numba, which settings do not need

    points = np.ascontiguousarray(points_m, np.float64)
    rises = (leg.passes * mean_rise(leg.position_m, leg.channels, points) for leg in aperture.legs)
    return np.asarray(sum(rises))
