"""The stand around the target in the photographs (a back plate with a printed ArUco board, and a
block), and the calibrated cameras around the radar.

The photo frame is the board's frame: origin at the plate's centre, print in the x-y plane, z
towards the cameras. Metres.
"""

import numpy as np

from handbench.bench.scenes.scene_file import Photos
from handbench.calibration.transforms import Transform
from handbench.groundtruth.board import Board, Marker
from handbench.groundtruth.cameras import Camera

PLATE_M = (0.400, 0.300)  # width, height
MARKER_M = 0.030
PLATE_BOX_M = np.array([[-0.200, -0.150, -0.020], [0.200, 0.150, 0.0]])  # in the photo frame
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
    corner = MARKER_M / 2 * np.array([(-1, 1, 0), (1, 1, 0), (1, -1, 0), (-1, -1, 0)])
    return Board(
        marker=tuple(
            Marker(id=i, corners_m=(corner + (*centre_m, 0)).tolist())
            for i, centre_m in enumerate(MARKER_CENTRES_M)
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
    tone = 0.5 + 0.5 * np.tanh(1.6 / cv2.meanStdDev(pattern)[1].item() * pattern)
    image = (INK + (0.9 * PAPER - INK) * tone).astype(np.float32)
    dictionary = stand_board().cv_dictionary()
    for number, centre_m in enumerate(MARKER_CENTRES_M):
        _patch(image, centre_m, MARKER_M + 2 * QUIET_M)[:] = PAPER
        modules = _patch(image, centre_m, MARKER_M)
        drawn = cv2.aruco.generateImageMarker(dictionary, number, len(modules))
        modules[:] = np.where(drawn > 0, PAPER, INK)
    return image


def _blots(random: np.random.Generator, shape: tuple[int, int], scale_m: float) -> np.ndarray:
    """Make smooth random noise, float32 of the given shape and unit variance, whose blots are about
    scale_m wide on the plate."""
    import cv2

    cells = [max(4, round(side * TEXEL_M / (0.4 * scale_m))) for side in shape]
    coarse = cv2.GaussianBlur(random.standard_normal(cells).astype(np.float32), (0, 0), 0.8)
    smooth = cv2.resize(coarse, shape[::-1], interpolation=cv2.INTER_CUBIC)
    return smooth / cv2.meanStdDev(smooth)[1].item()


def _patch(image: np.ndarray, centre_m: tuple[float, float], side_m: float) -> np.ndarray:
    """Return the square of the plate's picture around the point centre_m of the plate, with sides
    of side_m, as a view into `image`: writing to it changes the picture."""
    left = round((PLATE_M[0] / 2 + centre_m[0] - side_m / 2) / TEXEL_M)
    top = round((PLATE_M[1] / 2 - centre_m[1] - side_m / 2) / TEXEL_M)
    side = round(side_m / TEXEL_M)
    return image[top : top + side, left : left + side]


def cuboid(box_m: np.ndarray, step_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Make the surface of a box as vertices [n, 3] and outward triangles [m, 3], divided into a
    grid with steps of at most step_m. box_m [2, 3]: lower and upper corner."""
    vertices: list[np.ndarray] = []
    faces = []
    for axis in range(3):
        across = [(axis + 1) % 3, (axis + 2) % 3]
        ticks = [
            np.linspace(low_m, high_m, int(np.ceil((high_m - low_m) / step_m)) + 1)
            for low_m, high_m in box_m.T[across]
        ]
        places = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1)
        for bound, order in zip(box_m[:, axis], (-1, 1), strict=True):
            points = np.empty((*places.shape[:2], 3))
            points[..., axis], points[..., across] = bound, places
            triangles = cell_faces(*places.shape[:2]) + sum(map(len, vertices))
            faces.append(triangles[:, ::order])
            vertices.append(points.reshape(-1, 3))
    return np.concatenate(vertices), np.concatenate(faces)


def cell_faces(rows: int, columns: int) -> np.ndarray:
    """Return two triangles for each cell of a grid of points: numbers of the points [n, 3], in the
    order from the grid's first axis to its second."""
    index = np.arange(rows * columns).reshape(rows, columns)
    corners = (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:])
    a, b, c, d = (corner.ravel() for corner in corners)
    return np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


# alternate, seen from the target; clear of the aperture and its housing
OFF_AXIS_DEG = (24.0, 30.0)
DISTANCE_M = (0.46, 0.50)
# focal length over image width: about 0.17 mm per pixel of 2400 at the target
FOCAL_PER_WIDTH = 1.18


def rig(
    photos: Photos, aim_m: np.ndarray, radar_from_photo: Transform, seed: int
) -> tuple[Camera, ...]:
    """Return the cameras on a ring around the radar that look at about aim_m [3] (radar frame),
    with random deviations drawn from `seed`. The poses R, t of the cameras map the photo frame to
    the camera frame."""
    draw = np.random.default_rng([seed, 2]).uniform
    count, width, height = photos.cameras, photos.width, photos.height

    def camera(number: int) -> Camera:
        off_axis = np.radians(OFF_AXIS_DEG[number % 2] + draw(-1, 1))
        around = 2 * np.pi * (number + 0.5) / count + draw(-0.05, 0.05)
        distance_m = DISTANCE_M[number % 2] + draw(-0.01, 0.01)
        back = np.array(
            [
                np.sin(off_axis) * np.cos(around),
                np.sin(off_axis) * np.sin(around),
                -np.cos(off_axis),
            ]
        )
        centre_m = aim_m + distance_m * back
        forward = aim_m + draw(-0.006, 0.006, 3) - centre_m
        rotation = _look(forward, draw(-0.1, 0.1)) @ radar_from_photo.rotation
        focal_px = FOCAL_PER_WIDTH * width * draw(0.99, 1.01)
        principal_px = np.array([width, height]) / 2 + 0.005 * width * draw(-1, 1, 2)
        distortion = draw(-0.06, -0.04), draw(0.02, 0.05), *draw(-4e-4, 4e-4, 2)
        return Camera(
            name=f"cam{number:02d}.jpg",
            width=width,
            height=height,
            params=(focal_px, focal_px * draw(0.999, 1.001), *principal_px, *distortion),
            R=rotation.tolist(),
            t=(-rotation @ radar_from_photo.inverse().points(centre_m)).tolist(),
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
