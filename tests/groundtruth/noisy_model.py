"""A COLMAP model of photographs of loose points and of a board, with its truth and with seeded
noise."""

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from handbench.groundtruth.board import Board, Marker
from handbench.groundtruth.cameras import load_pycolmap, registered_images
from handbench.groundtruth.markers import crossings_of_edges
from handbench.groundtruth.photos import Photo
from handbench.groundtruth.sparse.adjust import adjust, camera_covariance
from handbench.groundtruth.sparse.frame import Scale
from handbench.groundtruth.sparse.normal import parameter_places

WIDTH, HEIGHT = 400, 300
PARAMS = (
    440.0,
    440.2,
    201.0,
    149.0,
    -0.05,
    0.01,
    3e-4,
    -3e-4,
)  # OPENCV's; all within what is known of any lens
FEATURE_PX, CORNER_PX = 0.4, 0.05  # noise
SIDE_M, BOARD_M = 0.03, -0.05
MARKERS_M = ((-0.10, -0.07), (0.07, -0.07), (0.07, 0.05), (-0.10, 0.05), (0.0, 0.0))


class Noisy(NamedTuple):
    """A model whose poses and points are a little off; corners as `adjust` takes them; the true
    poses (R, t), points [n, 3] and intrinsics."""

    model: object
    corners: dict
    corners_m: dict
    poses: dict
    points_m: np.ndarray
    params: tuple

    def covariance(self, lens=0):
        """The covariance of the cameras as they stand."""
        return camera_covariance(self.model, self.corners, self.corners_m, lens, Scale("board"))

    def error(self, lens=0):
        """Errors [d] of the parameters, `lens` of them intrinsics: x → x + τ + ω × x."""
        images = registered_images(self.model)
        places = parameter_places(images, lens)
        error = np.zeros(1 + max(place.max() for place in places))
        for image, place in zip(images, places, strict=True):
            R, t = self.poses[image.name]
            pose = image.cam_from_world()
            turn = pose.rotation.matrix() @ R.T
            omega = Rotation.from_matrix(turn).as_rotvec()
            params = np.array(image.camera.params) - self.params
            error[place] = np.r_[pose.translation - turn @ t, omega, params[:lens]]
        return error


def noisy_model(
    seed=0,
    *,
    points=40,
    seen_by=None,
    noise=1.0,
    off=1e-3,
    shared=False,
    params=PARAMS,
    spread=1.0,
    depth=1.0,
    centres=(),
):
    """Five cameras on an arc 0.6 m before the points, which all of them see (or `seen_by` of them,
    by turns), and a board of five markers behind. noise: times FEATURE_PX and CORNER_PX. off: of
    the poses at the start, radians and 1/3 m. spread: of the cameras' places, 1: over 70°, less:
    turned about themselves too, 0: all in one place. depth: of the points, 1: 160 mm, 0: on the
    board. centres: of the cameras, in place of the arc."""
    colmap, random = load_pycolmap(), np.random.default_rng(seed)
    model = colmap.Reconstruction()
    points_m = np.random.default_rng(99).uniform(
        (-0.12, -0.10, -0.08), (0.12, 0.10, 0.08), (points, 3)
    )
    points_m[:, 2] = BOARD_M + depth * (points_m[:, 2] - BOARD_M)
    square = np.array([(0, SIDE_M, 0), (SIDE_M, SIDE_M, 0), (SIDE_M, 0, 0), (0, 0, 0)])
    corners_m = {i: square + (*at, BOARD_M) for i, at in enumerate(MARKERS_M)}
    tracks, corners, poses = [[] for _ in points_m], {}, {}
    for i, angle in enumerate(np.linspace(-0.6, 0.6, len(centres) or 5)):
        camera = colmap.Camera(
            camera_id=1 if shared else i + 1,
            model="OPENCV",
            width=WIDTH,
            height=HEIGHT,
            params=params,
        )
        if camera.camera_id not in model.cameras:
            model.add_camera_with_trivial_rig(camera)
        angle = spread * angle + 0.2 * (spread < 1)
        height = spread * (0.35 * np.cos(3 * i) - 0.3)
        centre = 0.6 * np.array([np.sin(angle), height, np.cos(angle)])
        centre = np.array(centres[i]) if len(centres) else centre
        towards = Rotation.align_vectors([(0, 0, 1), (0, 1, 0)], [-centre, (0, -1, 0)])[0]
        roll = (spread < 1) * 0.1 * np.array([np.cos(2 * i), np.sin(2 * i), i])
        R = (Rotation.from_rotvec(roll) * towards).as_matrix()
        t, name = -R @ centre, f"p{i}.png"

        def look(at_m, camera=camera, R=R, t=t):
            return np.asarray(camera.img_from_cam(at_m @ R.T + t))

        def noisy(exact, noise_px):
            return exact + random.normal(0, noise * noise_px, exact.shape)

        pixels = noisy(look(points_m), FEATURE_PX)
        for k, track in enumerate(tracks):
            if seen_by is None or (i - k) % 5 < seen_by:
                track.append(colmap.TrackElement(i + 1, k))
        turn = Rotation.from_rotvec(random.normal(0, off, 3)).as_matrix()
        start = colmap.Rigid3d(colmap.Rotation3d(turn @ R), t + random.normal(0, off / 3, 3))
        image = colmap.Image(name, [*map(colmap.Point2D, pixels)], camera.camera_id, i + 1)
        model.add_image_with_trivial_frame(image, start)
        poses[name] = (R, t)
        corners[name] = {
            (m, k): pixel
            for m, square_m in corners_m.items()
            for k, pixel in enumerate(noisy(crossings_of_edges(look, square_m), CORNER_PX))
        }
    for point, elements in zip(points_m, tracks, strict=True):
        model.add_point3D(
            point + random.normal(0, off, 3), colmap.Track(elements), np.zeros(3, np.uint8)
        )
    return Noisy(model, corners, corners_m, poses, points_m, params)


def exact_model(centres, points=60):
    """A model whose cameras at `centres` [n, 3] look at points about the origin; all see all."""
    return noisy_model(noise=0, off=0, shared=True, centres=centres, points=points).model


def photos_of(model, width=WIDTH, height=HEIGHT):
    """Photographs of the model's names, without files."""
    names = sorted(image.name for image in model.images.values())
    return tuple(Photo(None, name, width, height) for name in names)


def adjusted(scene, lens=0):
    """The covariance of the cameras after the adjustment."""
    adjust(scene.model, scene.corners, scene.corners_m, lens)
    return scene.covariance(lens)


def off_in_sigmas(scene, lens=0):
    """Largest error of a camera's parameter after the adjustment, in its own standard
    deviations."""
    covariance = adjusted(scene, lens)
    return (np.abs(scene.error(lens)) / np.sqrt(np.diag(covariance))).max()


def poses_of(model):
    """All poses [n, 3, 4] as they stand, by name."""
    images = sorted(model.images.values(), key=lambda image: image.name)
    return np.array([image.cam_from_world().matrix() for image in images])


def board_of(corners_m):
    """The description of a board with these corners, by marker."""
    markers = (Marker(id=i, corners_m=corners.tolist()) for i, corners in corners_m.items())
    return Board(marker=tuple(markers))
