"""Printed boards: what OpenCV finds on the sheets is what board.toml says; and `handbench show` of
a board."""

import re

import cv2
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from handbench.bench.scenes.stand import stand_board
from handbench.calibration.target import default_target, load_target
from handbench.cli.main import main
from handbench.groundtruth.board import Board, Charuco, Marker, load_board
from handbench.reports.figures.inputs import INCH_MM, PRINTED, board_sheet
from tests.refusals import refuse

PIXELS_PER_MM = 8
BAR_M = 1e-4  # turned pictures are drawn to whole pixels, 0.125 mm


def raster(figure):
    """The sheet's grey values [height, width]."""
    figure.set_dpi(PIXELS_PER_MM * INCH_MM)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., 0].copy()


def square(number, centre, side=0.03, turn=0.0):
    """A marker in the plane z = 0, turned about z."""
    corners = side / 2 * np.array([(-1, 1), (1, 1), (1, -1), (-1, -1)])
    rotation = np.array([(np.cos(turn), -np.sin(turn)), (np.sin(turn), np.cos(turn))])
    return Marker(id=number, corners_m=np.c_[corners @ rotation.T + centre, np.zeros(4)].tolist())


def markers(board):
    """The corners and numbers of the markers that OpenCV finds on a board's sheet."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    detector = cv2.aruco.ArucoDetector(board.cv_dictionary(), parameters)
    corners, numbers, _ = detector.detectMarkers(raster(board_sheet(board, "")))
    return corners, numbers.ravel()


def metres(pixels):
    """Pixels [n, 2] → metres, y up."""
    return np.asarray(pixels, np.float64).reshape(-1, 2) / PIXELS_PER_MM / 1000 * (1, -1)


def centred(points):
    return points - points.mean(axis=0)


@pytest.mark.parametrize(
    "board",
    [
        stand_board(),
        Board(
            dictionary="DICT_6X6_250",
            marker=(
                square(249, (0, 0)),
                square(7, (0.1, 0.03), 0.05, 0.4),
                square(31, (0.02, 0.08), 0.02, -2.0),
            ),
        ),
    ],
    ids=["stand", "turned"],
)
def test_opencv_finds_every_marker_where_the_file_says(board):
    corners, numbers = markers(board)
    assert sorted(numbers) == sorted(marker.id for marker in board.marker)
    wanted = np.concatenate([board.corners_m()[number][:, :2] for number in numbers])
    assert np.abs(centred(metres(corners)) - centred(wanted)).max() < BAR_M


def test_a_board_of_which_y_points_down_is_turned():
    """With z into the print."""
    down = Marker(id=3, corners_m=((0, 0, 0), (0.03, 0, 0), (0.03, 0.03, 0), (0, 0.03, 0)))
    assert markers(Board(marker=(down,)))[1].tolist() == [3]


@pytest.mark.parametrize(
    ("number", "corners", "places"),
    [
        (2, [(0, 0, 1), (1, 0, 1), (1, -1, 1), (0, -1, 1)], ["marker 2", "z = 0"]),
        (2, [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, -1, 0)], ["marker 2"]),
        (2, [(0, 0, 0), (1, 0, 0), (1.5, -1, 0), (0, -1, 0)], ["marker 2"]),
        (50, [(0, 0, 0), (1, 0, 0), (1, -1, 0), (0, -1, 0)], ["'DICT_4X4_50'", "50", "0 to 49"]),
    ],
)
def test_what_cannot_be_printed_is_refused(number, corners, places):
    other = Marker(id=number, corners_m=0.03 * np.array(corners))
    refuse(lambda: board_sheet(Board(marker=(square(1, (0.1, 0)), other)), "wrong"), *places)


def test_descriptions_are_written_and_drawn(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(PRINTED, "pdf.compression", 0)
    for command in ("target -o target.toml", "stand -o board.toml"):
        assert main(["show", *command.split()]) == 0
    assert load_target("target.toml") == default_target()
    assert load_board("board.toml") == stand_board()
    for kind in ("target", "board"):
        assert main(["show", f"{kind}.toml", "-o", f"{kind}.pdf"]) == 0
    content = (tmp_path / "board.pdf").read_bytes()
    placed = re.findall(rb"\s([.\d]+)\s0\s0\s-([.\d]+)\s0\s[.\d]+\scm\s/I\d+\sDo", content)
    assert len(placed) == len(stand_board().marker)
    assert np.array(placed, float) == pytest.approx(30 * 72 / INCH_MM)  # points: 30 mm


@pytest.mark.parametrize("legacy", [False, True])
def test_opencv_finds_every_charuco_corner_where_the_file_says(legacy):
    """The legacy pattern differs where rows are even."""
    charuco = Charuco(columns=7, rows=6, square_m=0.03, marker_m=0.021, legacy=legacy)
    figure = board_sheet(Board(charuco=charuco), "charuco")
    detector = cv2.aruco.CharucoDetector(charuco.cv_board())
    corners, numbers, _, _ = detector.detectBoard(raster(figure))
    assert len(numbers) == 6 * 5
    wanted = charuco.corners_m()[numbers.ravel(), :2]
    assert np.abs(centred(metres(corners)) - centred(wanted)).max() < BAR_M
