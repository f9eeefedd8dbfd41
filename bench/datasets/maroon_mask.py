"""Mask of the pixels of a depth map that MAROON scores: those in the object's box, away from the map's edges."""

import numpy as np

FEWEST_PX = 10  # an erosion that leaves no more than these is tried again with a smaller kernel
RADAR_KERNEL = 4  # the radar's kernel is this many times smaller than metadata.json's `mask_erosion`


def radar_kernel_px(mask_erosion: float) -> int:
    """Side of the radar mask's kernel for the `mask_erosion` of a metadata.json (code/main.py)."""
    return round(mask_erosion / RADAR_KERNEL)


def eroded(mask: np.ndarray, pixels: int) -> np.ndarray:
    """A mask [ny, nx] eroded by a square of `pixels` × `pixels`, or by the largest smaller one that leaves more than
    FEWEST_PX pixels (their `SensorVisualizer.add_sensor`); of y upwards and our x, as all maps here are.

    The map's border erodes nothing. Their images are ours turned by 180°, which an even kernel minds.
    """
    import cv2

    theirs = np.ascontiguousarray(mask[::-1, ::-1], np.uint8)
    for side in range(pixels, 1, -1):
        smaller = cv2.erode(theirs, np.ones((side, side), np.uint8)) > 0
        if np.count_nonzero(smaller) > FEWEST_PX:
            return smaller[::-1, ::-1]
    return mask.astype(bool)
