"""The stand around the target in the photographs (a back plate with a printed ArUco board, and a
block), and the calibrated cameras around the radar.

The photo frame is the board's frame: origin at the plate's centre, print in the x-y plane, z
towards the cameras. Metres.
"""

import numpy as np

from handbench.calibration.transforms import Transform
from handbench.groundtruth.board.board import Board, Marker
from handbench.groundtruth.cameras.cameras import Camera

PLATE_M = (0.400, 0.300, 0.020)  # width, height, thickness
MARKER_M = 0.030
QUIET_M = 0.005  # white margin around each marker
TEXEL_M = 1e-4
MARKER_CENTRES_M = (
    *((x, y) for x in (-0.178, 0.178) for y in (-0.126, -0.063, 0.0, 0.063, 0.126)),
    *((x, y) for x in (-0.124, 0.124) for y in (-0.096, -0.032, 0.096)),
    *((x, 0.128) for x in (-0.062, 0.0, 0.062)),
)
INK, PAPER = 0.04, 0.82  # reflectances


def stand_board() -> Board:
    """Return the ArUco board that is printed on the back plate."""
    half = MARKER_M / 2
    corner = np.array(
        [(-half, half, 0.0), (half, half, 0.0), (half, -half, 0.0), (-half, -half, 0.0)]
    )
    return Board(
        marker=tuple(
            Marker(id=i, corners_m=(corner + (x, y, 0.0)).tolist())
            for i, (x, y) in enumerate(MARKER_CENTRES_M)
        )
    )


def plate_print(seed: int) -> np.ndarray:
    """Make the reflectance [height, width] of the plate's front, one value per 0.1 mm, first row at
    the top: a high-contrast random pattern of blots from 0.5 to 12 mm, and the markers with a white
    margin. seed: of the pattern."""
    import cv2

    shape = round(PLATE_M[1] / TEXEL_M), round(PLATE_M[0] / TEXEL_M)
    random = np.random.default_rng([seed, 1])
    pattern = np.zeros(shape, np.float32)
    for scale_m in (12e-3, 5e-3, 2e-3, 0.8e-3):
        pattern += _blots(random, shape, scale_m)
    tone = 0.5 + 0.5 * np.tanh(1.6 * pattern / pattern.std())
    image = (INK + (0.9 * PAPER - INK) * tone).astype(np.float32)
    dictionary = stand_board().cv_dictionary()
    for number, centre_m in enumerate(MARKER_CENTRES_M):
        _patch(image, centre_m, MARKER_M + 2 * QUIET_M)[:] = PAPER
        bits = cv2.aruco.generateImageMarker(dictionary, number, 6)
        modules = _patch(image, centre_m, MARKER_M)
        modules[:] = np.kron(np.where(bits > 0, PAPER, INK), np.ones((modules.shape[0] // 6,) * 2))
    return image


def _blots(random: np.random.Generator, shape: tuple[int, int], scale_m: float) -> np.ndarray:
    """Make smooth random noise, float32 of the given shape and unit variance, whose blots are about
    scale_m wide on the plate."""
    import cv2

    cells = [max(4, round(side * TEXEL_M / (0.4 * scale_m))) for side in shape]
    coarse = cv2.GaussianBlur(random.standard_normal(cells).astype(np.float32), (0, 0), 0.8)
    smooth = cv2.resize(coarse, shape[::-1], interpolation=cv2.INTER_CUBIC)
    return smooth / smooth.std()


def _patch(image: np.ndarray, centre_m: tuple[float, float], side_m: float) -> np.ndarray:
    """Return the square of the plate's picture around the point centre_m of the plate, with sides
    of side_m, as a view into `image`: writing to it changes the picture."""
    left = round((PLATE_M[0] / 2 + centre_m[0] - side_m / 2) / TEXEL_M)
    top = round((PLATE_M[1] / 2 - centre_m[1] - side_m / 2) / TEXEL_M)
    side = round(side_m / TEXEL_M)
    return image[top : top + side, left : left + side]


def plate_box_m() -> np.ndarray:
    """Return the lower and upper corner [2, 3] of the back plate in the photo frame, metres."""
    width, height, thickness = PLATE_M
    return np.array([[-width / 2, -height / 2, -thickness], [width / 2, height / 2, 0.0]])


def cuboid(box_m: np.ndarray, step_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Make the surface of a box as vertices [n, 3] and outward triangles [m, 3], divided into a
    grid with steps of at most step_m. box_m [2, 3]: lower and upper corner."""
    (lower_m, upper_m), vertices, faces, total = box_m, [], [], 0
    for axis in range(3):
        for side, bound in ((-1, lower_m[axis]), (1, upper_m[axis])):
            u, v = (axis + 1) % 3, (axis + 2) % 3
            counts = {k: int(np.ceil((upper_m[k] - lower_m[k]) / step_m)) + 1 for k in (u, v)}
            ticks = [np.linspace(lower_m[k], upper_m[k], count) for k, count in counts.items()]
            points = np.empty((len(ticks[0]), len(ticks[1]), 3))
            points[..., axis], points[..., u], points[..., v] = (
                bound,
                ticks[0][:, None],
                ticks[1][None, :],
            )
            index = total + np.arange(points[..., 0].size).reshape(points.shape[:2])
            a, b, c, d = (
                part.ravel()
                for part in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:])
            )
            quads = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
            faces.append(quads if side > 0 else quads[:, ::-1])
            vertices.append(points.reshape(-1, 3))
            total += points[..., 0].size
    return np.concatenate(vertices), np.concatenate(faces)


# alternate, seen from the target; clear of the aperture and its housing
OFF_AXIS_DEG = (24.0, 30.0)
DISTANCE_M = (0.46, 0.50)
# focal length over image width: about 0.17 mm per pixel of 2400 at the target
FOCAL_PER_WIDTH = 1.18


def rig(
    count: int, width: int, height: int, aim_m: np.ndarray, radar_from_photo: Transform, seed: int
) -> tuple[Camera, ...]:
    """Return `count` cameras on a ring around the radar that look at about aim_m [3] (radar frame),
    with random deviations drawn from `seed`.

    width, height: of the pictures in pixels. The poses R, t of the cameras map the photo frame to
    the camera frame.
    """
    random = np.random.default_rng([seed, 2])

    def camera(number: int) -> Camera:
        off_axis = np.radians(OFF_AXIS_DEG[number % 2] + random.uniform(-1, 1))
        around = 2 * np.pi * (number + 0.5) / count + random.uniform(-0.05, 0.05)
        distance_m = DISTANCE_M[number % 2] + random.uniform(-0.01, 0.01)
        back = np.array(
            [
                np.sin(off_axis) * np.cos(around),
                np.sin(off_axis) * np.sin(around),
                -np.cos(off_axis),
            ]
        )
        centre_m = aim_m + distance_m * back
        forward = aim_m + random.uniform(-0.006, 0.006, 3) - centre_m
        camera_from_radar = _look(forward, roll_rad=random.uniform(-0.1, 0.1))
        rotation = camera_from_radar @ radar_from_photo.rotation
        focal_px = FOCAL_PER_WIDTH * width * random.uniform(0.99, 1.01)
        principal_px = np.array([width, height]) / 2 + 0.005 * width * random.uniform(-1, 1, 2)
        distortion = (
            random.uniform(-0.06, -0.04),
            random.uniform(0.02, 0.05),
            *random.uniform(-4e-4, 4e-4, 2),
        )
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
    """Return the rotation [3, 3] from the radar frame to a camera that looks along `forward` [3].
    The picture is upright except for a turn by roll_rad."""
    z = forward / np.linalg.norm(forward)
    x = np.cross(z, [0.0, 1.0, 0.0])
    x /= np.linalg.norm(x)
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec([0, 0, roll_rad]).as_matrix() @ np.stack([x, np.cross(z, x), z])
