"""Board files, and ChArUco boards in photographs."""

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from handbench.groundtruth.board.board import (
    CHESSBOARD,
    Board,
    Charuco,
    Marker,
    load_board,
    save_board,
)
from handbench.groundtruth.board.markers import detect_corners, focal_length_px, require_board
from handbench.groundtruth.cameras.cameras import Camera
from handbench.groundtruth.photos.photos import Photo
from handbench.support.errors import HandbenchError

CORNERS = ((0.0, 0.03, 0.0), (0.03, 0.03, 0.0), (0.03, 0.0, 0.0), (0.0, 0.0, 0.0))
CHARUCO = {
    "columns": 7,
    "rows": 6,
    "square_m": 0.03,
    "marker_m": 0.022,
    "dictionary": "DICT_5X5_50",
}


def test_round_trip_through_a_file(tmp_path):
    for board in (
        Board(dictionary="DICT_5X5_100", marker=(Marker(id=4, corners_m=CORNERS),)),
        Board(charuco=Charuco(**CHARUCO, legacy=True)),
        Board(marker=(Marker(id=4, corners_m=CORNERS),), charuco=Charuco(**CHARUCO)),
    ):
        save_board(tmp_path / "board.toml", board)
        assert load_board(tmp_path / "board.toml") == board


def test_mistakes_are_named(tmp_path):
    path = tmp_path / "board.toml"
    marker = f"[[marker]]\nid = 1\ncorners_m = {[list(c) for c in CORNERS]}\n"
    charuco = "[charuco]\ncolumns = 7\nrows = 5\nsquare_m = 0.03\nmarker_m = 0.02\n"
    for text, complaint in (
        (marker * 2, "two markers have the same id"),
        ("[[marker]]\nid = 1\ncorners_m = [[0.0, 0.0, 0.0]]\n", r"corners_m.*at least 4"),
        ('dictionary = "DICT_4X4_50"\n', "names neither a"),
        (charuco.replace("0.02", "0.05"), "a marker is smaller than its square"),
        (charuco.replace("rows", "row"), "did you mean 'rows'"),
        (marker + charuco, "marker 1 is in the charuco board too"),
    ):
        path.write_text(text)
        with pytest.raises(HandbenchError, match=complaint):
            load_board(path)
    path.write_text('dictionary = "APRIL"\n' + marker)
    with pytest.raises(HandbenchError, match="unknown dictionary 'APRIL'"):
        load_board(path).cv_dictionary()
    with pytest.raises(
        HandbenchError, match="charuco has 200 markers, the dictionary 'DICT_4X4_50' 50"
    ):
        Charuco(columns=20, rows=20, square_m=0.03, marker_m=0.02).cv_board()


def photograph_of(board, path, legacy=False):
    """A slanted photograph [600, 800] of a ChArUco board, blurred by a pixel, and its camera."""
    texels = 60  # a square
    print_ = board.charuco.cv_board()
    print_.setLegacyPattern(legacy)
    columns, rows = board.charuco.columns, board.charuco.rows
    picture = print_.generateImage((columns * texels, rows * texels))
    R = Rotation.from_euler("xyz", (150, 20, 10), degrees=True).as_matrix()
    t = np.array([0, 0, 0.45]) - R @ (columns * 0.015, -rows * 0.015, 0)
    camera = Camera(
        name="a.png",
        width=800,
        height=600,
        model="PINHOLE",
        params=(900, 900, 400, 300),
        R=R.tolist(),
        t=tuple(t),
    )
    outline = (
        np.array([(0, 0), (columns, 0), (columns, -rows), (0, -rows)]) * board.charuco.square_m
    )
    there = camera.project(np.c_[outline, np.zeros(4)]) - 0.5
    here = np.array([(0, 0), (columns, 0), (columns, rows), (0, rows)]) * texels - 0.5
    warp = cv2.getPerspectiveTransform(here.astype(np.float32), there.astype(np.float32))
    large = cv2.warpPerspective(picture, warp, (800, 600), flags=cv2.INTER_AREA, borderValue=255)
    cv2.imwrite(str(path), cv2.GaussianBlur(large, (0, 0), 1.0))
    return Photo(path, path.name, 800, 600), camera


@pytest.mark.parametrize("legacy", [False, True])
def test_charuco_corners_are_found_in_colmaps_pixels(tmp_path, legacy):
    board = Board(charuco=Charuco(**CHARUCO, legacy=legacy))
    photo, camera = photograph_of(board, tmp_path / "a.png", legacy)
    found = detect_corners(photo, board)
    known = board.corners_m()
    assert len(found) == 30 == len(known[CHESSBOARD])
    error = np.array(
        [pixel - camera.project(known[name][k][None])[0] for (name, k), pixel in found.items()]
    )
    assert np.linalg.norm(error, axis=1).max() < 0.2 and np.abs(error.mean(axis=0)).max() < 0.05
    assert focal_length_px(photo, found, board) == pytest.approx(900, rel=0.02)
    mistaken = detect_corners(photo, Board(charuco=Charuco(**CHARUCO, legacy=not legacy)))
    assert len(mistaken) < 15  # rows are even: the other pattern has its markers elsewhere


def test_a_charuco_board_seen_once_is_refused(tmp_path):
    board = Board(charuco=Charuco(**CHARUCO))
    photo, _ = photograph_of(board, tmp_path / "a.png")
    found = detect_corners(photo, board)
    with pytest.raises(
        HandbenchError, match=r"7 × 6 squares with DICT_5X5_50.*found in 1 of 2 photographs"
    ):
        require_board({"a.png": found, "b.png": {}}, board)
    assert require_board({"a.png": found, "b.png": found}, board)


def test_the_corners_of_a_chessboard_run_row_by_row_from_the_top_left():
    corners_m = Charuco(columns=4, rows=3, square_m=0.03, marker_m=0.02).corners_m()
    expected = [(x, y, 0) for y in (-0.03, -0.06) for x in (0.03, 0.06, 0.09)]
    np.testing.assert_allclose(corners_m, expected, atol=1e-15)


def test_a_dictionary_and_single_markers_may_be_used_to_their_last_number():
    """A board of 10 × 10 squares has the 50 markers of its dictionary; one of 4 × 5 has the numbers
    0 to 9."""
    full = Charuco(columns=10, rows=10, square_m=0.03, marker_m=0.02)
    assert len(full.cv_board().getIds()) == 50
    with pytest.raises(
        HandbenchError, match="charuco has 55 markers, the dictionary 'DICT_4X4_50' 50"
    ):
        Charuco(columns=11, rows=10, square_m=0.03, marker_m=0.02).cv_board()
    small = Charuco(columns=4, rows=5, square_m=0.03, marker_m=0.02)
    assert Board(marker=(Marker(id=10, corners_m=CORNERS),), charuco=small).corners_m().keys() == {
        10,
        CHESSBOARD,
    }
    assert Board(dictionary="DICT_5X5_50", marker=(Marker(id=9, corners_m=CORNERS),), charuco=small)
    with pytest.raises(ValueError, match="marker 9 is in the charuco board too"):
        Board(marker=(Marker(id=9, corners_m=CORNERS),), charuco=small)
    with pytest.raises(ValueError, match="a marker is smaller than its square"):
        Charuco(columns=4, rows=5, square_m=0.03, marker_m=0.03)


def test_sixteen_corners_in_a_plane_give_a_focal_length():
    board = Board(charuco=Charuco(columns=5, rows=5, square_m=0.03, marker_m=0.02))
    R = Rotation.from_euler("xyz", (150, 20, 10), degrees=True).as_matrix()
    camera = Camera(
        name="a",
        width=800,
        height=600,
        model="PINHOLE",
        params=(900, 900, 400, 300),
        R=R.tolist(),
        t=(0, 0, 0.5),
    )
    pixels = camera.project(board.corners_m()[CHESSBOARD])
    seen, photo = (
        {(CHESSBOARD, k): pixel for k, pixel in enumerate(pixels)},
        Photo(None, "a", 800, 600),
    )
    assert focal_length_px(photo, seen, board) == pytest.approx(900, rel=1e-4)
    assert len(seen) == 16 and focal_length_px(photo, dict(list(seen.items())[:15]), board) is None
