"""Averaging filters for maps with holes."""

from __future__ import annotations

import numpy as np

from handbench.support.compiled import FAST, njit


def masked_mean(values: np.ndarray, size_px: int, weight: np.ndarray | None = None) -> np.ndarray:
    """Averaging filter over the finite neighbours in a size × size window (normalised convolution), with a weight for
    each pixel if given; NaN stays NaN. values, weight: [ny, nx]."""
    known = np.isfinite(values)
    if size_px == 1 or not known.any():
        return values.copy()
    weight = known.astype(np.float64) if weight is None else np.where(known, weight, 0.0)
    offset = values[known].mean()  # keeps the sums small, so that they lose no digits
    return np.where(known, offset + _window_means(values - offset, weight / weight.max(), size_px), np.nan)


@njit(**FAST)
def _window_means(values, weight, size_px):  # type: ignore[no-untyped-def]
    """Σ weight · values / Σ weight over each window, [ny, nx], where weights are above 0. Each window by itself: a
    running sum would carry the rounding of strong pixels on to weak ones."""
    ny, nx = values.shape
    before, behind = size_px // 2, (size_px - 1) // 2
    along, means, total = np.zeros((2, ny, nx)), np.empty((ny, nx)), np.empty((2, nx))
    weighted = np.zeros(nx)
    for j in range(ny):
        for i in range(nx):
            weighted[i] = weight[j, i] * values[j, i] if weight[j, i] > 0 else 0.0
        for shift in range(-before, behind + 1):
            for i in range(max(-shift, 0), nx - max(shift, 0)):
                along[0, j, i] += weighted[i + shift]
                along[1, j, i] += weight[j, i + shift]
    for j in range(ny):
        total[:] = 0
        for row in range(max(j - before, 0), min(j + behind + 1, ny)):
            for i in range(nx):
                total[0, i] += along[0, row, i]
                total[1, i] += along[1, row, i]
        for i in range(nx):
            means[j, i] = total[0, i] / total[1, i]
    return means
