"""Board files, and ChArUco boards in photographs."""

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from handbench.groundtruth.board import CHESSBOARD, Board, Charuco, Marker, load_board, save_board
from handbench.groundtruth.cameras import Camera
from handbench.groundtruth.markers import detect_corners, focal_length_px, require_board
from handbench.groundtruth.photos import Photo
from tests.refusals import refuse

CORNERS = ((0.0, 0.03, 0.0), (0.03, 0.03, 0.0), (0.03, 0.0, 0.0), (0.0, 0.0, 0.0))
CHARUCO = Charuco(columns=7, rows=6, square_m=0.03, marker_m=0.022, dictionary="DICT_5X5_50")
MARKER_FILE = f"[[marker]]\nid = 9\ncorners_m = {[list(c) for c in CORNERS]}\n"
CHARUCO_FILE = "[charuco]\ncolumns = 4\nrows = 5\nsquare_m = 0.03\nmarker_m = 0.02\n"


def test_round_trip_through_a_file(tmp_path):
    marker = (Marker(id=4, corners_m=CORNERS),)
    for board in (Board(dictionary="DICT_5X5_100", marker=marker), Board(charuco=CHARUCO)):
        save_board(tmp_path / "board.toml", board)
        assert load_board(tmp_path / "board.toml") == board


@pytest.mark.parametrize(
    ("text", "place"),
    [
        (MARKER_FILE * 2, "same id"),
        (MARKER_FILE + CHARUCO_FILE, "same id"),
        ('dictionary = "DICT_4X4_50"\n', "[[marker]]"),
        (CHARUCO_FILE.replace("0.02", "0.03"), "'charuco'"),
        ('dictionary = "APRIL"\n' + MARKER_FILE, "'APRIL'"),
        (CHARUCO_FILE.replace("4", "11").replace("5", "10"), "55 markers"),
    ],
)
def test_a_wrong_board_is_refused(tmp_path, text, place):
    (tmp_path / "board.toml").write_text(text)
    refuse(lambda: load_board(tmp_path / "board.toml").cv_dictionary(), place)


def slanted(width, height):
    """A camera that sees a board of this size, metres, at an angle."""
    R = Rotation.from_euler("xyz", (150, 20, 10), degrees=True).as_matrix()
    return Camera(
        name="a.png",
        width=800,
        height=600,
        model="PINHOLE",
        params=(900, 900, 400, 300),
        R=R.tolist(),
        t=tuple(np.array([0, 0, 0.45]) - R @ (width / 2, -height / 2, 0)),
    )


@pytest.mark.parametrize("legacy", [False, True])
def test_charuco_corners_are_found_in_colmaps_pixels(tmp_path, legacy):
    """In a slanted photograph of the print, blurred by a pixel. Rows are even: the other pattern
    has its markers elsewhere."""
    board, other = (
        Board(charuco=CHARUCO.model_copy(update={"legacy": old})) for old in (legacy, not legacy)
    )
    texels = 60  # a square
    picture = board.charuco.cv_board().generateImage((7 * texels, 6 * texels))
    corners = np.array([(0, 0), (7, 0), (7, 6), (0, 6)])
    camera = slanted(7 * 0.03, 6 * 0.03)
    there = camera.project(corners @ [(0.03, 0, 0), (0, -0.03, 0)]) - 0.5
    warp = cv2.getPerspectiveTransform(np.float32(corners * texels - 0.5), np.float32(there))
    large = cv2.warpPerspective(picture, warp, (800, 600), flags=cv2.INTER_AREA, borderValue=255)
    cv2.imwrite(str(tmp_path / "a.png"), cv2.GaussianBlur(large, (0, 0), 1.0))
    photo = Photo(tmp_path / "a.png", "a.png", 800, 600)
    found = detect_corners(photo, board)
    assert len(found) == 30 == len(board.corners_m()[CHESSBOARD])
    expected = camera.project(board.corners_m()[CHESSBOARD])
    error = np.array([pixel - expected[k] for (_, k), pixel in found.items()])
    assert np.linalg.norm(error, axis=1).max() < 0.2 and np.abs(error.mean(axis=0)).max() < 0.05
    assert len(detect_corners(photo, other)) < 15
    refuse(lambda: require_board({"a.png": found, "b.png": {}}, board), "7 × 6", "1 of 2")
    assert require_board({"a.png": found, "b.png": found}, board)


def test_sixteen_corners_in_a_plane_give_a_focal_length():
    board = Board(charuco=Charuco(columns=5, rows=5, square_m=0.03, marker_m=0.02))
    pixels = slanted(0.15, 0.15).project(board.corners_m()[CHESSBOARD])
    seen = {(CHESSBOARD, k): pixel for k, pixel in enumerate(pixels)}
    assert focal_length_px([seen, {}], (800, 600), board) == pytest.approx(900, rel=1e-2)
    assert len(seen) == 16
    assert focal_length_px([dict(list(seen.items())[:15])], (800, 600), board) is None
