"""Averaging filters for maps with holes."""

from __future__ import annotations

import numpy as np


def masked_mean(values: np.ndarray, size_px: int, weight: np.ndarray | None = None) -> np.ndarray:
    """Averaging filter over the finite neighbours in a size × size window (normalised convolution), with a weight for
    each pixel if given; NaN stays NaN. values, weight: [ny, nx]."""
    from radar.methods.windows import window_means  # numba, which not every caller of this module waits for

    known = np.isfinite(values)
    if size_px == 1 or not known.any():
        return values.copy()
    weight = known.astype(np.float64) if weight is None else np.where(known, weight, 0.0)
    offset = values[known].mean()  # keeps the sums small, so that they lose no digits
    return np.where(known, offset + window_means(values - offset, weight / weight.max(), size_px), np.nan)


def bounding_box(mask: np.ndarray) -> tuple[slice, slice]:
    """The smallest rectangle that holds every true pixel: targets fill a small part of the image."""
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    return slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
