"""The metric frame: markers in a picture, one similarity to the whole board."""

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from handbench.groundtruth.markers import detect_corners
from handbench.groundtruth.photos import Photo
from handbench.groundtruth.sparse.frame import apply, board_from_model, trimmed_similarity
from tests.groundtruth.noisy_model import board_of, noisy_model, poses_of
from tests.refusals import refuse


@pytest.mark.parametrize(
    "points_m", [np.zeros((0, 3)), np.eye(3)[:2], np.outer(np.arange(5.0), (1, 2, 3))]
)
def test_too_few_points_and_points_on_a_line_are_refused(points_m):
    refuse(
        lambda: trimmed_similarity(points_m, points_m, "corners"), f"only {len(points_m)} corners"
    )


def test_a_model_is_carried_to_the_board_despite_a_wrong_corner():
    """Which four others still show."""
    pinhole = (440, 440, 200, 150, 0, 0, 0, 0)  # bends no edge
    scene, similarity = noisy_model(noise=0, off=0, params=pinhole), np.eye(4)
    turn = Rotation.from_euler("xyz", (40, -25, 110), degrees=True)
    similarity[:3] = np.c_[3.7 * turn.as_matrix(), (0.3, -1.2, 2.0)]
    poses = poses_of(scene.model)
    apply(scene.model, np.linalg.inv(similarity))
    scene.corners["p2.png"][3, 1] += (25.0, -10.0)
    matrix, scale = board_from_model(scene.model, scene.corners, board_of(scene.corners_m))
    np.testing.assert_allclose(matrix, similarity, rtol=1e-6, atol=1e-7)
    assert scale.source == "board" and scale.features == 20 and scale.residual_m < 1e-7
    apply(scene.model, matrix)
    np.testing.assert_allclose(poses_of(scene.model), poses, atol=1e-7)


def test_markers_are_found_in_colmaps_pixels(tmp_path):
    """Their outlines run along pixel borders; half a pixel would show."""
    picture, middle_px = np.full((1000, 1200), 255, np.uint8), (500, 500)
    corners_px = {
        marker: middle_px + 4000 * corners_m[:, :2] * (1, -1)
        for marker, corners_m in noisy_model().corners_m.items()
    }
    board = board_of(noisy_model().corners_m)
    for marker, corners in corners_px.items():
        left, top = corners[0].round().astype(int)
        drawn = cv2.aruco.generateImageMarker(board.cv_dictionary(), marker, 120)
        picture[top : top + 120, left : left + 120] = drawn
    cv2.imwrite(str(tmp_path / "a.png"), picture)
    found = detect_corners(Photo(tmp_path / "a.png", "a.png", 1200, 1000), board)
    assert len(found) == 20
    for (marker, k), pixel in found.items():
        np.testing.assert_allclose(pixel, corners_px[marker][k], atol=0.15)


def test_points_off_a_plane_tell_its_mirror_image():
    """A majority in a plane fits either way; points off the plane, on the wrong side, are
    reported as a reflection."""
    random = np.random.default_rng(4)
    target_m = random.uniform(-1, 1, (16, 3)) * [1, 1, 0]
    target_m[12:, 2] = random.uniform(0.5, 2.5, 4)
    matrix, _, residuals_m = trimmed_similarity(2 * target_m, target_m, "corners")
    assert residuals_m.max() < 1e-9 and matrix[0, 0] == pytest.approx(0.5)
    mirrored_m = target_m * (1, 1, -1)
    refuse(lambda: trimmed_similarity(mirrored_m, target_m, "corners"), "4 of 16 corners")
    wrong_m = target_m + np.where(np.arange(16)[:, None] < 12, 0, random.uniform(-1, 1, (16, 3)))
    assert not trimmed_similarity(wrong_m, target_m, "corners")[1][12:].any()  # merely wrong
