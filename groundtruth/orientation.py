"""What was made for a photograph's upright picture, carried to its stored pixels.

A viewer turns a picture as EXIF says (1: not at all, 3: by 180°, 6: by 90° clockwise, 8: by 90° counter-clockwise);
handbench and COLMAP take the stored pixels. A mask or a camera whose sides are swapped against the stored ones belongs
to the upright picture. What has equal sides is taken to belong to the stored one: sizes cannot tell.
"""

from __future__ import annotations

import numpy as np

from calibration import HandbenchError
from groundtruth.cameras import Camera
from groundtruth.photos import Photo

QUARTER_TURNS = {1: 0, 3: 2, 6: 1, 8: 3}  # clockwise, from the stored to the upright picture
TURNABLE = {"f", "fx", "fy", "cx", "cy", "k", "k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"}


def sides_swapped(photo: Photo, width: int, height: int) -> bool:
    """Whether a size is that of the photograph's upright picture and not that of its stored pixels."""
    turned = QUARTER_TURNS[photo.orientation] % 2 == 1 and photo.width != photo.height
    return turned and (width, height) == (photo.height, photo.width)


def stored_picture(photo: Photo, upright: np.ndarray) -> np.ndarray:
    """The upright picture [width, height, ...] turned back to the stored pixels [height, width, ...]."""
    return np.rot90(upright, QUARTER_TURNS[photo.orientation])


def stored_camera(photo: Photo, upright: Camera) -> Camera:
    """The camera of the stored pixels, from that of the upright picture; a HandbenchError for a lens model that is not
    the same when turned."""
    for _ in range(QUARTER_TURNS[photo.orientation]):
        upright = _turned_back(upright)
    return upright


def _turned_back(camera: Camera) -> Camera:
    """The camera of a picture before it was turned by 90° clockwise: what was at (x, y) is now at (height − y, x)."""
    names = [name.strip() for name in camera.colmap().params_info.split(",")]
    if not TURNABLE.issuperset(names):
        raise HandbenchError(
            f"camera {camera.name}: is of the upright picture, and the model {camera.model} cannot be turned; "
            "calibrate at the stored pixels, without EXIF orientation"
        )
    value = dict(zip(names, camera.params, strict=True))
    turned = dict(value, cx=value["cy"], cy=camera.width - value["cx"])
    for name, source, sign in (("fx", "fy", 1), ("fy", "fx", 1), ("p1", "p2", -1), ("p2", "p1", 1)):
        if name in value:
            turned[name] = sign * value[source]
    update = {"width": camera.height, "height": camera.width, "params": tuple(turned[name] for name in names)}
    back = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    if camera.R is not None:
        update["R"] = tuple(map(tuple, (back @ camera.rotation).tolist()))
    if camera.t is not None:
        update["t"] = tuple((back @ camera.translation_m).tolist())
    return camera.model_copy(update=update)
