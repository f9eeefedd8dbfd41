"""Small photographs of a textured corner of a room, three planes at right angles, by casting a ray
per pixel."""

from functools import cache

import cv2
import numpy as np
from PIL import Image

from handbench.groundtruth.cameras.cameras import Camera

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


def look(centre_m, towards_m=(0.0, 0.0, 0.0), size=(400, 300), room=0):
    """8-bit picture [height, width] of room number `room` (its corner is the origin, it fills x, y,
    z > 0)."""
    width, height = size
    u, v = np.meshgrid(np.arange(width) + 0.5 - width / 2, np.arange(height) + 0.5 - height / 2)
    R = camera_rotation(np.subtract(towards_m, centre_m))
    rays = np.stack([u, v, np.full(u.shape, FOCAL_PER_WIDTH * max(size))], axis=-1) @ R
    with np.errstate(divide="ignore"):
        reach = np.where(
            rays < 0, -np.array(centre_m) / rays, np.inf
        )  # of the planes x = 0, y = 0, z = 0
    plane = reach.argmin(axis=-1)
    points_m = centre_m + rays * reach.min(axis=-1)[..., None]
    picture = np.zeros(u.shape, dtype=np.float32)
    for axis in range(3):
        a, b = np.moveaxis(np.delete(points_m, axis, axis=-1) / SIDE_M * TEXELS, -1, 0).astype(
            np.float32
        )
        seen = cv2.remap(
            _texture(10 * room + axis), a, b, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT
        )
        picture = np.where(plane == axis, seen, picture)
    noise = np.random.default_rng(int(1e3 * sum(centre_m))).normal(0, 0.01, picture.shape)
    return ((picture + noise).clip(0, 1) * 255).round().astype(np.uint8)


def around(count, spread_rad=0.6, distance_m=1.2):
    """`count` camera centres [3] on an arc about the corner."""
    angles = np.pi / 4 + np.linspace(-spread_rad / 2, spread_rad / 2, count)
    return [
        distance_m * np.array((np.cos(a), np.sin(a), 0.6 + 0.1 * (i % 2)))
        for i, a in enumerate(angles)
    ]


def true_camera(name, centre_m, params=(440.0, 440.0, 200.0, 150.0), size=(400, 300)):
    """The camera at a place that looks at the origin."""
    R = camera_rotation(-np.array(centre_m))
    return Camera(
        name=name,
        width=size[0],
        height=size[1],
        model="PINHOLE",
        params=params,
        R=tuple(map(tuple, R.tolist())),
        t=tuple((-R @ centre_m).round(12).tolist()),  # nothing below 1e-30 is accepted
    )


def photograph(folder, count=4, **options):
    """Write p0.png, p1.png, … of the room."""
    for i, centre_m in enumerate(around(count)):
        Image.fromarray(look(centre_m, **options)).save(folder / f"p{i}.png")
