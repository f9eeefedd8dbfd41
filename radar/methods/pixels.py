"""Functions of the pixels of a depth map: averaging filter, growth of the path along z."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, Aperture
from handbench.radar.data.grid import PixelGrid

if TYPE_CHECKING:
    from handbench.radar.methods.fsk import FskEchoes

PER_CELL = 5  # pixels along x and y of a resolution cell that show a peak to 3 %


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
    from handbench.radar.methods.windows import window_sums  # numba

    rows, columns = (place - place.min() for place in pixels)
    weight = np.ones(len(values)) if weight is None else (weight / weight.max()).astype(np.float64)
    offset = values.mean()  # keeps the sums small, so that they lose no digits
    ny, nx = rows.max() + size_px, columns.max() + size_px
    maps, sums = np.zeros((2, ny, nx)), np.zeros((2, len(values)))
    maps[:, rows + size_px // 2, columns + size_px // 2] = weight * (values - offset), weight
    window_sums(maps, rows, columns, size_px, np.empty((ny, nx - size_px + 1)), sums)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(offset + sums[0] / sums[1])


def thinned(echoes: FskEchoes, z_m: float) -> PixelGrid:
    """Return every n-th pixel of the echoes' grid along x and along y, about PER_CELL in a
    resolution cell λz/2D of the plane at depth z_m, with the extent D of the antennas."""
    grid = echoes.grid
    extent_m = max(np.ptp(leg.position_m, axis=0).max() for leg in echoes.aperture.legs)
    per_m = PER_CELL * 2 * extent_m * echoes.frequencies_hz[0] / SPEED_OF_LIGHT_M_S / z_m
    axes = grid.x_m, grid.y_m
    every = [max(1, round(len(axis) / max(1, per_m * np.ptp(axis)))) for axis in axes]
    return PixelGrid(grid.x_m[:: every[0]], grid.y_m[:: every[1]])


def path_gradient_z(points_m: np.ndarray, aperture: Aperture) -> np.ndarray:
    """Compute the derivative ∂(|p − t| + |p − r|)/∂z of the path from transmitter to point to
    receiver at points p [n, 3], averaged over the channels: [n], at most 2, its value on the axis
    far away."""
    from handbench.radar.imaging.cpu.steering import mean_rise  # numba

    points = np.ascontiguousarray(points_m, np.float64)
    rises = (leg.passes * mean_rise(leg.position_m, leg.channels, points) for leg in aperture.legs)
    return np.asarray(sum(rises))
