"""A camera of a photograph's upright picture, carried to its stored pixels."""

from __future__ import annotations

import numpy as np

from groundtruth.cameras.cameras import Camera
from groundtruth.photos.orientation import QUARTER_TURNS
from groundtruth.photos.photos import Photo
from radar.support.errors import HandbenchError

TURNABLE = {"f", "fx", "fy", "cx", "cy", "k", "k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"}


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
