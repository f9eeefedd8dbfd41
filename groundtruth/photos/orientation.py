"""What was made for a photograph's upright picture, carried to its stored pixels.

A viewer turns a picture as EXIF says (1: not at all, 3: by 180°, 6: by 90° clockwise, 8: by 90° counter-clockwise);
handbench and COLMAP take the stored pixels. A mask or a camera whose sides are swapped against the stored ones belongs
to the upright picture. What has equal sides is taken to belong to the stored one: sizes cannot tell.
"""

from __future__ import annotations

import numpy as np

from groundtruth.photos.photos import Photo

QUARTER_TURNS = {1: 0, 3: 2, 6: 1, 8: 3}  # clockwise, from the stored to the upright picture


def sides_swapped(photo: Photo, width: int, height: int) -> bool:
    """Whether a size is that of the photograph's upright picture and not that of its stored pixels."""
    turned = QUARTER_TURNS[photo.orientation] % 2 == 1 and photo.width != photo.height
    return turned and (width, height) == (photo.height, photo.width)


def stored_picture(photo: Photo, upright: np.ndarray) -> np.ndarray:
    """The upright picture [width, height, ...] turned back to the stored pixels [height, width, ...]."""
    return np.rot90(upright, QUARTER_TURNS[photo.orientation])
