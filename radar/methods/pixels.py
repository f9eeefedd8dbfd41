"""Pixels of a depth map: averages over windows around them, growth of the path along z."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from handbench.radar.data.arrays import Aperture
from handbench.radar.data.grid import PixelGrid


@dataclass(frozen=True, eq=False)
class Pixels:
    """The n pixels of a grid with the flat indices index [n]."""

    grid: PixelGrid
    index: np.ndarray

    def where(self, chosen: np.ndarray) -> Pixels:
        """Return the pixels chosen [k], positions among the n."""
        return Pixels(self.grid, self.index[chosen])

    def points_m(self, z_m: np.ndarray) -> np.ndarray:
        """Return the points [n, 3] of the pixels, metres, at depths z_m [n]."""
        return self.grid.points_at_m(self.index, z_m)

    def on_map(self, values: np.ndarray, elsewhere: float = np.nan) -> np.ndarray:
        """Return the map [ny, nx] of the pixels' values [n], and `elsewhere` at all others."""
        return self.grid.on_map(self.index, values, elsewhere)

    def means(
        self, values: np.ndarray, size_px: int, weight: np.ndarray | None = None
    ) -> np.ndarray:
        """Average values [n] over a window of size_px × size_px around each pixel, with weights [n]
        (None: equal ones), leaving out NaN (normalised convolution): [n]; NaN stays NaN."""
        seen = np.isfinite(values)
        if size_px == 1 or not seen.any():
            return values
        offset = values[seen].mean()  # keeps the sums small, so that they lose no digits
        if weight is None and seen.all():
            sums, total = self._sums(values - offset, size_px), self._counts(size_px)
        else:
            share = 1.0 if weight is None else weight / np.float64(weight[seen].max())
            share = np.where(seen, share, 0.0)
            sums = self._sums(share * np.where(seen, values - offset, 0.0), size_px)
            total = self._sums(share, size_px)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(seen, offset + sums / total, np.nan)

    def _counts(self, size_px: int) -> np.ndarray:
        if size_px not in self._counted:
            self._counted[size_px] = self._sums(np.ones(len(self.index)), size_px)
        return self._counted[size_px]

    @cached_property
    def _counted(self) -> dict[int, np.ndarray]:
        return {}

    @cached_property
    def _places(self) -> tuple[np.ndarray, ...]:
        """Rows [n] and columns [n], counted from the first ones."""
        places = np.unravel_index(self.index, self.grid.shape)
        return tuple(place - place.min() for place in places)

    def _sums(self, values: np.ndarray, size_px: int) -> np.ndarray:
        """Add up values [n] over the windows. Each window is summed by itself: a running sum would
        carry rounding errors of strong pixels to weak ones."""
        rows, columns = self._places
        ny, nx = rows.max() + 1, columns.max() + 1
        padded = np.zeros((ny + size_px - 1, nx + size_px - 1))
        padded[rows + size_px // 2, columns + size_px // 2] = values
        along_x, sums = np.zeros((len(padded), nx)), np.zeros((ny, nx))
        for i in range(size_px):
            along_x += padded[:, i : i + nx]
        for i in range(size_px):
            sums += along_x[i : i + ny]
        return np.asarray(sums[rows, columns])


def masked_mean(values: np.ndarray, size_px: int, weight: np.ndarray | None = None) -> np.ndarray:
    """Average a map [ny, nx] as `Pixels.means` does. weight [ny, nx]."""
    ny, nx = values.shape
    every = Pixels(PixelGrid(np.arange(nx), np.arange(ny)), np.arange(values.size))
    flat = None if weight is None else weight.ravel()
    return every.means(values.ravel(), size_px, flat).reshape(values.shape)


def path_gradient_z(points_m: np.ndarray, aperture: Aperture) -> np.ndarray:
    """Compute the derivative ∂(|p − t| + |p − r|)/∂z of the path from transmitter to point to
    receiver at points p [n, 3], averaged over the channels: [n], at most 2, its value on the axis
    far away."""
    from handbench.radar.imaging.steering import mean_rise  # numba, which settings do not need

    points = np.ascontiguousarray(points_m, np.float64)
    rises = (leg.passes * mean_rise(leg.position_m, leg.channels, points) for leg in aperture.legs)
    return np.asarray(sum(rises))
