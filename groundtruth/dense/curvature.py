"""Curvature of a disparity map, which turns PatchMatch's planes into paraboloids."""

from __future__ import annotations

import numpy as np

BEND_PX = 3.0  # standard deviation of the slopes' smoothing before they are differentiated
MOST_BENT = 0.08  # disparities per pixel²: a third of a disparity at the ends of the window's middle row


def bends(planes: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Second derivatives [h, w, 3] of the disparity (per column², column and row, row²), from the slopes of planes
    [h, w, 3] around each pixel.

    A plane that is matched over a window on a convex surface lies below its middle, by half the curvature times the
    window's mean square: some hundredths of a millimetre on a finger. A paraboloid does not.
    """
    import cv2

    weight = cv2.GaussianBlur(wanted.astype(np.float32), (0, 0), BEND_PX)
    smooth = [
        cv2.GaussianBlur(np.where(wanted, slope, 0), (0, 0), BEND_PX) / np.maximum(weight, 1e-6)
        for slope in np.moveaxis(planes[..., 1:], -1, 0)
    ]
    (xy, xx), (yy, yx) = (np.gradient(slope) for slope in smooth)
    return np.clip(np.stack([xx, (xy + yx) / 2, yy], axis=-1), -MOST_BENT, MOST_BENT).astype(np.float32)
