"""Bundle adjustment and the board's frame where geometry tells little: photographs from one place,
plane scenes, wrong corners, a board that is seen from places that draw together.

Five photographs of loose points before a board of five markers, with seeded noise. A pose is judged
by its own standard deviation, which has to grow where the geometry tells less: of 340 normal
numbers one is beyond 4.8 σ once in 1800 times.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from handbench.groundtruth.board.board import Board, Marker
from handbench.groundtruth.cameras.cameras import load_pycolmap
from handbench.groundtruth.sparse.adjust import adjust, camera_covariance
from handbench.groundtruth.sparse.bundle import Bundle
from handbench.groundtruth.sparse.frame import Scale, board_from_model
from handbench.support.errors import HandbenchError

SIZE_PX = (400, 300)
PARAMS = (440.0, 440.2, 201.0, 149.0, -0.05, 0.01, 3e-4, -3e-4)  # of COLMAP's camera OPENCV
LENSES = {"known": (), "free": tuple(range(len(PARAMS)))}  # parameters that are adjusted too
FEATURE_PX, CORNER_PX = 0.4, 0.05
VIEWS, POINTS, DISTANCE_M, BOARD_M = 5, 40, 0.6, -0.05
MARKERS_M = ((-0.10, -0.07), (0.07, -0.07), (0.07, 0.05), (-0.10, 0.05), (0.0, 0.0))
SQUARE_M = 0.03 * np.array([(0, 1, 0), (1, 1, 0), (1, 0, 0), (0, 0, 0)])
CORNERS_M = {i: SQUARE_M + (*at, BOARD_M) for i, at in enumerate(MARKERS_M)}


@dataclass(frozen=True)
class Scene:
    """A COLMAP model whose poses and points are a little off, the corners that its photographs
    show, and the true poses (R, t) by photograph."""

    model: Any
    corners: dict[str, dict[tuple[int, int], np.ndarray]]
    poses: dict[str, tuple[np.ndarray, np.ndarray]]

    def errors(self, bundle: Bundle) -> np.ndarray:
        """Errors of a bundle's parameters [d], in its own terms: x → x + τ + ω × x, then
        intrinsics."""
        error = np.zeros(bundle.size)
        for image in bundle.images:
            R, t = self.poses[image.name]
            pose = image.cam_from_world()
            turn = pose.rotation.matrix() @ R.T
            lens = (np.array(image.camera.params) - PARAMS)[list(bundle.free)]
            step = pose.translation - turn @ t, Rotation.from_matrix(turn).as_rotvec(), lens
            error[bundle.place[image.name]] = np.concatenate(step)
        return error


def photographed(
    spread: float = 1.0, depth: float = 1.0, off: float = 1e-3, seed: int = 0
) -> Scene:
    """spread: of the cameras' places, 1: over 70°, 0: all in one place, turned about themselves;
    depth: of the points, 1: 160 mm, 0: on the board's plane; off: of the poses and points at the
    start, radians and metres."""
    colmap, random = load_pycolmap(), np.random.default_rng(seed)
    points_m = np.random.default_rng(99).uniform(
        (-0.12, -0.10, -0.08), (0.12, 0.10, 0.08), (POINTS, 3)
    )
    points_m[:, 2] = BOARD_M + depth * (points_m[:, 2] - BOARD_M)
    model, corners, poses = colmap.Reconstruction(), {}, {}
    camera = colmap.Camera(
        camera_id=1, model="OPENCV", width=SIZE_PX[0], height=SIZE_PX[1], params=PARAMS
    )
    model.add_camera_with_trivial_rig(camera)

    def pixels(at_m: np.ndarray, noise_px: float) -> np.ndarray:
        exact = np.asarray(camera.img_from_cam(at_m @ R.T + t))
        return exact + random.normal(0, noise_px, exact.shape)

    for i, along in enumerate(np.linspace(-1, 1, VIEWS)):
        angle = 0.2 + 0.6 * spread * along
        centre_m = DISTANCE_M * np.array(
            [np.sin(angle), spread * (0.35 * np.cos(3 * i) - 0.3), np.cos(angle)]
        )
        towards = Rotation.align_vectors([(0, 0, 1), (0, 1, 0)], [-centre_m, (0, -1, 0)])[0]
        R = (
            Rotation.from_rotvec([0.1 * np.cos(2 * i), 0.1 * np.sin(2 * i), 0.1 * i]) * towards
        ).as_matrix()
        t, name = -R @ centre_m, f"p{i}.png"
        poses[name] = R, t
        seen = [colmap.Point2D(pixel) for pixel in pixels(points_m, FEATURE_PX)]
        turn = Rotation.from_rotvec(random.normal(0, off, 3)).as_matrix()
        start = colmap.Rigid3d(colmap.Rotation3d(turn @ R), t + random.normal(0, off / 3, 3))
        model.add_image_with_trivial_frame(colmap.Image(name, seen, 1, i + 1), start)
        corners[name] = {
            (marker, k): pixel
            for marker, places_m in CORNERS_M.items()
            for k, pixel in enumerate(pixels(places_m, CORNER_PX))
        }
    for n, point_m in enumerate(points_m):
        track = colmap.Track([colmap.TrackElement(i + 1, n) for i in range(VIEWS)])
        model.add_point3D(point_m + random.normal(0, off, 3), track, np.zeros(3, np.uint8))
    return Scene(model, corners, poses)


def off_in_sigmas(scene: Scene, free: tuple[int, ...]) -> float:
    """Largest error of a camera's parameter after the adjustment, in its own standard
    deviations."""
    adjust(scene.model, scene.corners, CORNERS_M, free)
    bundle = Bundle(scene.model, scene.corners, CORNERS_M, free)
    variance = np.diag(camera_covariance(bundle, Scale("board")).matrix)
    return float((np.abs(scene.errors(bundle)) / np.sqrt(variance)).max())


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("spread", [1.0, 1e-2, 1e-4, 1e-8, 0.0])
def test_photographs_from_one_place_say_how_far_they_are_off(spread, lens):
    """The board holds them though no point has a depth."""
    assert off_in_sigmas(photographed(spread), LENSES[lens]) < 4.8


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("depth", [1e-2, 1e-5, 0.0])
def test_a_plane_seen_from_five_sides_holds_poses_and_lens(depth, lens):
    assert off_in_sigmas(photographed(1.0, depth), LENSES[lens]) < 4.8


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_plane_from_one_place_is_as_uncertain_as_it_says(seed, lens):
    """Distance and focal length trade."""
    assert off_in_sigmas(photographed(0.0, 0.0, seed=seed), LENSES[lens]) < 4.8


@pytest.mark.parametrize("size_px", [0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0])
def test_misread_corners_of_a_marker_in_five_pull_no_further_than_their_weight(size_px):
    """With Cauchy's weights a wrong number pulls by 1.2 σ at most: 4 of them beside 16 add 0.36 to
    the variance."""
    scene, rng = photographed(), np.random.default_rng(7)
    for corners in scene.corners.values():
        for k in range(4):
            way = rng.standard_normal(2)
            corners[4, k] = corners[4, k] + size_px * way / np.linalg.norm(way)
    assert off_in_sigmas(scene, ()) < 4.8 * (1 + 4 * 1.2**2 / 16) ** 0.5


def board() -> Board:
    return Board(
        marker=tuple(
            Marker(id=i, corners_m=tuple(map(tuple, c.tolist()))) for i, c in CORNERS_M.items()
        )
    )


@pytest.mark.parametrize("spread", np.logspace(0, -3, 13))
def test_a_board_seen_from_places_that_draw_together_has_the_right_scale_or_none(spread):
    """σ = stated residual over the root of the corners' squared extents, at most: all errors lie
    along one axis."""
    extent_m = np.concatenate(list(CORNERS_M.values()))
    lever_m = np.sqrt(((extent_m - extent_m.mean(axis=0)) ** 2).sum())
    scene = photographed(float(spread), off=0.0)
    try:
        matrix, scale = board_from_model(scene.model, scene.corners, board())
    except HandbenchError:
        assert spread < 0.1
    else:
        factor = np.cbrt(np.linalg.det(matrix[:3, :3]))
        assert abs(factor - 1) * lever_m / scale.residual_m < 5


@pytest.mark.parametrize("spread", [1e-3, 1e-4, 1e-6, 0.0])
def test_a_board_seen_from_one_place_is_refused(spread):
    """Without a base no corner has a depth: its triangulated corners miss the board by over 3 %."""
    scene = photographed(spread, off=0.0)
    with pytest.raises(HandbenchError, match="places apart"):
        board_from_model(scene.model, scene.corners, board())
