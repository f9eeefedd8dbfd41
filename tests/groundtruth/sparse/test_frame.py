"""The metric frame: markers in a picture, one similarity to the whole board."""

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from handbench.groundtruth.board.board import Board, Marker
from handbench.groundtruth.board.markers import detect_corners
from handbench.groundtruth.cameras.cameras import load_pycolmap, registered_images
from handbench.groundtruth.photos.photos import Photo
from handbench.groundtruth.sparse.frame import (
    apply,
    board_from_model,
    check_fit,
    trimmed_similarity,
)
from handbench.support.errors import HandbenchError

SIDE_M = 0.03
MARKERS = {7: (0.0, 0.0), 3: (0.10, 0.0), 11: (0.10, 0.08), 5: (0.0, 0.08), 9: (0.04, 0.05)}


@pytest.fixture
def board():
    square = np.array([(0, SIDE_M, 0), (SIDE_M, SIDE_M, 0), (SIDE_M, 0, 0), (0, 0, 0)])
    return Board(
        marker=tuple(
            Marker(id=i, corners_m=tuple(map(tuple, (square + (*at, 0)).tolist())))
            for i, at in MARKERS.items()
        )
    )


@pytest.fixture
def similarity():
    matrix = np.eye(4)
    matrix[:3, :3] = 3.7 * Rotation.from_euler("xyz", (40, -25, 110), degrees=True).as_matrix()
    matrix[:3, 3] = (0.3, -1.2, 2.0)
    return matrix


def model_of(board, focal_px=900.0, views=4):
    """A COLMAP model in the board's frame, without points, and the exact corner pixels of every
    view."""
    colmap = load_pycolmap()
    model, seen = colmap.Reconstruction(), {}
    model.add_camera_with_trivial_rig(
        colmap.Camera(
            camera_id=1,
            model="PINHOLE",
            width=800,
            height=600,
            params=[focal_px, focal_px, 400, 300],
        )
    )
    for i in range(views):
        R = Rotation.from_euler(
            "xyz", (180 - 25 + 10 * i, 30 - 15 * i, 5 * i), degrees=True
        ).as_matrix()
        pose = colmap.Rigid3d(colmap.Rotation3d(R), np.array([0, 0, 0.4]) - R @ (0.06, 0.05, 0))
        model.add_image_with_trivial_frame(
            colmap.Image(name=f"{i}.png", camera_id=1, image_id=i + 1), pose
        )
        seen[f"{i}.png"] = {
            (marker, k): model.cameras[1].img_from_cam((pose * corner)[None])[0]
            for marker, corners in board.corners_m().items()
            for k, corner in enumerate(corners)
        }
    return model, seen


@pytest.mark.parametrize(
    "points_m", [np.zeros((0, 3)), np.eye(3)[:2], np.outer(np.arange(5.0), (1, 2, 3))]
)
def test_too_few_points_and_points_on_a_line_are_refused(points_m):
    with pytest.raises(HandbenchError, match="at least three that are not on a line"):
        trimmed_similarity(points_m, points_m, "board corners")


def test_a_model_is_carried_to_the_board_despite_a_wrong_corner(board, similarity):
    model, seen = model_of(board)
    centres_m = np.array([image.projection_center() for image in registered_images(model)])
    apply(model, np.linalg.inv(similarity))
    seen["2.png"][(3, 1)] = seen["2.png"][(3, 1)] + (25.0, -10.0)  # seen by three others still
    matrix, scale = board_from_model(model, seen, board)
    np.testing.assert_allclose(matrix, similarity, rtol=1e-6, atol=1e-7)
    assert scale.source == "board" and scale.features == 20 and scale.residual_m < 1e-7
    apply(model, matrix)
    np.testing.assert_allclose(
        [image.projection_center() for image in registered_images(model)], centres_m, atol=1e-7
    )


def test_markers_are_found_in_colmaps_pixels(board, tmp_path):
    picture = np.full((600, 800), 255, np.uint8)
    scale = 4000  # pixels a metre, so that a marker's outline runs along pixel borders
    for marker, (x, y) in MARKERS.items():
        top, left = round(500 - scale * (y + SIDE_M)), round(100 + scale * x)
        picture[top : top + 120, left : left + 120] = cv2.aruco.generateImageMarker(
            board.cv_dictionary(), marker, 120
        )
    cv2.imwrite(str(tmp_path / "a.png"), picture)
    found = detect_corners(Photo(tmp_path / "a.png", "a.png", 800, 600), board)
    assert {marker for marker, _ in found} == set(MARKERS)
    for (marker, k), pixel in found.items():
        x, y, _ = board.corners_m()[marker][k]
        np.testing.assert_allclose(
            pixel, (100 + scale * x, 500 - scale * y), atol=0.15
        )  # half a pixel would show


def test_points_off_a_plane_tell_its_mirror_image():
    """A majority in a plane fits either way; what lies off it, on the wrong side, is said to be a
    reflection."""
    random = np.random.default_rng(4)
    target_m = np.concatenate(
        [
            random.uniform((-1, -1, 0), (1, 1, 0), (12, 3)),
            random.uniform(-1, 1, (4, 3)) + (0, 0, 1.5),
        ]
    )
    matrix, _, residuals_m = trimmed_similarity(2 * target_m, target_m, "corners")
    assert residuals_m.max() < 1e-9 and matrix[0, 0] == pytest.approx(0.5)
    with pytest.raises(
        HandbenchError, match=r"4 of 16 corners lie where the mirror image .* right-handed"
    ):
        trimmed_similarity(target_m * (1, 1, -1), target_m, "corners")
    wrong_m = target_m + np.where(np.arange(16)[:, None] < 12, 0, random.uniform(-1, 1, (16, 3)))
    assert not trimmed_similarity(wrong_m, target_m, "corners")[1][
        12:
    ].any()  # neither way: merely wrong


def test_a_misfit_of_three_per_cent_is_the_last_that_passes():
    check_fit(0.03, 1.0, "board corners")
    with pytest.raises(
        HandbenchError, match=r"board corners are 30\.4 mm off after the best fit, 3%"
    ):
        check_fit(0.0304, 1.0, "board corners")
