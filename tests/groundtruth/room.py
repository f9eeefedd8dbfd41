"""Small photographs of a textured corner of a room, three planes at right angles."""

from functools import cache

import cv2
import numpy as np
from PIL import Image

from handbench.groundtruth.cameras import Camera

FOCAL_PER_WIDTH = 1.1
SIDE_M, TEXELS = 2.0, 1024


def camera_rotation(forward):
    """Camera-from-room rotation [3, 3] that looks along `forward`, the room's z upwards in the
    picture."""
    z = np.array(forward, dtype=float) / np.linalg.norm(forward)
    x = np.cross(z, (0, 0, 1))
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z])


@cache
def _texture(seed):
    random = np.random.default_rng(seed)
    coarse = (random.normal(size=(cells, cells)) for cells in (12, 50, 200))
    pattern = sum(
        cv2.resize(layer, (TEXELS, TEXELS), interpolation=cv2.INTER_CUBIC) for layer in coarse
    )
    return (0.5 + 0.18 * pattern / pattern.std()).clip(0, 1).astype(np.float32)


def look(centre_m, size=(400, 300), room=0):
    """8-bit picture [height, width] of room number `room`, whose corner is the origin and which
    fills x, y, z > 0, from a place that looks at the corner: no part of a wall hides another."""
    f = FOCAL_PER_WIDTH * max(size)
    K = np.array([[f, 0, size[0] / 2 - 0.5], [0, f, size[1] / 2 - 0.5], [0, 0, 1]])
    R, texel_m = camera_rotation(-np.array(centre_m)), SIDE_M / TEXELS
    picture = np.random.default_rng(int(1e3 * sum(centre_m))).normal(0, 0.01, size[::-1])
    for axis in range(3):
        to_camera = np.c_[texel_m * np.delete(R, axis, axis=1), -R @ centre_m]
        picture += cv2.warpPerspective(_texture(10 * room + axis), K @ to_camera, size)
    return (picture.clip(0, 1) * 255).round().astype(np.uint8)


def around(count):
    """`count` camera centres [3] on an arc about the corner, over 0.6 rad, metres."""
    angles = np.pi / 4 + np.linspace(-0.3, 0.3, count)
    return [
        1.2 * np.array((np.cos(a), np.sin(a), 0.6 + 0.1 * (i % 2))) for i, a in enumerate(angles)
    ]


def true_camera(name, centre_m):
    """The camera at a place that looks at the origin."""
    R = camera_rotation(-np.array(centre_m))
    return Camera(
        name=name,
        width=400,
        height=300,
        model="PINHOLE",
        params=(440.0, 440.0, 200.0, 150.0),
        R=tuple(map(tuple, R.tolist())),
        t=tuple((-R @ centre_m).round(12).tolist()),  # nothing below 1e-30 is accepted
    )


def photograph(folder, count=4):
    """Write p0.png, p1.png, … of the room."""
    for i, centre_m in enumerate(around(count)):
        Image.fromarray(look(centre_m)).save(folder / f"p{i}.png")
