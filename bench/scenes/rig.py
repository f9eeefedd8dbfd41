"""Eight calibrated cameras on the radar's side, around the radar."""

import numpy as np

from handbench.calibration.transforms import Transform
from handbench.groundtruth.cameras.cameras import Camera

OFF_AXIS_DEG = (24.0, 30.0)  # alternate, seen from the target; clear of the aperture and its housing
DISTANCE_M = (0.46, 0.50)
FOCAL_PER_WIDTH = 1.18  # focal length over image width: about 0.17 mm per pixel of 2400 at the target


def rig(
    count: int, width: int, height: int, aim_m: np.ndarray, radar_from_photo: Transform, seed: int
) -> tuple[Camera, ...]:
    """`count` cameras on a ring, all aimed at `aim_m` [3] (radar frame); their R and t are from the photo frame."""
    random = np.random.default_rng([seed, 2])

    def camera(number: int) -> Camera:
        off_axis = np.radians(OFF_AXIS_DEG[number % 2] + random.uniform(-1, 1))
        around = 2 * np.pi * (number + 0.5) / count + random.uniform(-0.05, 0.05)
        distance_m = DISTANCE_M[number % 2] + random.uniform(-0.01, 0.01)
        back = np.array([np.sin(off_axis) * np.cos(around), np.sin(off_axis) * np.sin(around), -np.cos(off_axis)])
        centre_m = aim_m + distance_m * back
        forward = aim_m + random.uniform(-0.006, 0.006, 3) - centre_m
        camera_from_radar = _look(forward, roll_rad=random.uniform(-0.1, 0.1))
        rotation = camera_from_radar @ radar_from_photo.rotation
        focal_px = FOCAL_PER_WIDTH * width * random.uniform(0.99, 1.01)
        principal_px = np.array([width, height]) / 2 + 0.005 * width * random.uniform(-1, 1, 2)
        distortion = (random.uniform(-0.06, -0.04), random.uniform(0.02, 0.05), *random.uniform(-4e-4, 4e-4, 2))
        return Camera(
            name=f"cam{number:02d}.jpg",
            width=width,
            height=height,
            params=(focal_px, focal_px * random.uniform(0.999, 1.001), *principal_px, *distortion),
            R=tuple(map(tuple, rotation.tolist())),
            t=tuple((-rotation @ radar_from_photo.inverse().points(centre_m)).tolist()),
        )

    return tuple(camera(number) for number in range(count))


def _look(forward: np.ndarray, roll_rad: float) -> np.ndarray:
    """Camera-from-radar rotation: z along `forward`, the image upright but for `roll_rad`."""
    z = forward / np.linalg.norm(forward)
    x = np.cross(z, [0.0, 1.0, 0.0])
    x /= np.linalg.norm(x)
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec([0, 0, roll_rad]).as_matrix() @ np.stack([x, np.cross(z, x), z])
