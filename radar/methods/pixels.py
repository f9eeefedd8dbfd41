"""Functions of the pixels of a depth map: averages over windows, growth of the path along z."""

import numpy as np

from handbench.radar.data.arrays import Aperture


def masked_mean(values: np.ndarray, size_px: int, weight: np.ndarray | None = None) -> np.ndarray:
    """Average a map [ny, nx] over a window of size_px × size_px around each pixel, leaving out NaN
    (normalised convolution); NaN stays NaN. weight [ny, nx]: weight of each pixel; None for equal
    weights."""
    means, seen = values.flatten(), np.flatnonzero(np.isfinite(values))
    if size_px > 1 and len(seen):
        pixels = np.unravel_index(seen, values.shape)
        of_seen = None if weight is None else weight.ravel()[seen]
        means[seen] = window_mean(means[seen], pixels, size_px, of_seen)
    return means.reshape(values.shape)


def window_mean(
    values: np.ndarray,
    pixels: tuple[np.ndarray, ...],
    size_px: int,
    weight: np.ndarray | None = None,
) -> np.ndarray:
    """Average values [n] of the pixels (rows [n], columns [n]) over a window of size_px × size_px
    around each, with weights [n] (None: equal ones): [n]."""
    from scipy.ndimage import correlate1d  # which settings do not need

    rows, columns = (place - place.min() for place in pixels)
    weight = np.ones(len(values)) if weight is None else (weight / weight.max()).astype(np.float64)
    offset = values.mean()  # keeps the sums small, so that they lose no digits
    maps = np.zeros((2, rows.max() + 1, columns.max() + 1))
    maps[:, rows, columns] = weight * (values - offset), weight
    # each window by itself: a running sum would carry rounding errors of strong pixels to weak ones
    for axis in (1, 2):
        maps = correlate1d(maps, np.ones(size_px), axis, mode="constant")
    sums = maps[:, rows, columns]
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(offset + sums[0] / sums[1])


def path_gradient_z(points_m: np.ndarray, aperture: Aperture) -> np.ndarray:
    """Compute the derivative ∂(|p − t| + |p − r|)/∂z of the path from transmitter to point to
    receiver at points p [n, 3], averaged over the channels: [n], at most 2, its value on the axis
    far away."""
    from handbench.radar.imaging.steering import mean_rise  # numba, which settings do not need

    points = np.ascontiguousarray(points_m, np.float64)
    rises = (leg.passes * mean_rise(leg.position_m, leg.channels, points) for leg in aperture.legs)
    return np.asarray(sum(rises))
