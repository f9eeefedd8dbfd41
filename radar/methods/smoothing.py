"""Averaging filters for maps with holes."""

from __future__ import annotations

import numpy as np


def masked_mean(values: np.ndarray, size_px: int, weight: np.ndarray | None = None) -> np.ndarray:
    """Averaging filter over the finite neighbours in a size × size window (normalised convolution), with a weight for
    each pixel if given; NaN stays NaN. values, weight: [ny, nx]."""
    known = np.isfinite(values)
    if size_px == 1 or not known.any():
        return values.copy()
    box, mean = bounding_box(known), np.full(values.shape, np.nan)
    weight = np.ones(values.shape)[box] if weight is None else weight[box]
    values, known = values[box], known[box]
    offset = values[known].mean()  # keeps the sums small, so that they lose no digits
    weight = np.where(known, weight / weight[known].max(), 0.0)
    total = _window_sum(weight * np.where(known, values - offset, 0.0), size_px)
    count = _window_sum(weight, size_px)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean[box] = np.where(known, offset + total / count, np.nan)
    return mean


def _window_sum(values: np.ndarray, size_px: int) -> np.ndarray:
    """Each window's sum by itself: a running sum would carry the rounding of strong pixels on to weak ones."""
    from scipy.ndimage import correlate1d

    for axis in (0, 1):
        values = correlate1d(values, np.ones(size_px), axis, mode="constant")
    return values


def bounding_box(mask: np.ndarray) -> tuple[slice, slice]:
    """The smallest rectangle that holds every true pixel: targets fill a small part of the image."""
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    return slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
