"""Printed boards: what OpenCV finds on the sheets is what board.toml says; and `handbench show` of
a board."""

import re

import cv2
import numpy as np
import pytest
from matplotlib import rcParams
from matplotlib.backends.backend_agg import FigureCanvasAgg

from handbench.bench.scenes.stand import stand_board
from handbench.calibration.spheres.description import default_target, load_target
from handbench.cli import show
from handbench.cli.main import parser
from handbench.groundtruth.board.board import Board, Charuco, Marker, load_board
from handbench.reports.drawings.board_drawing import board_sheet
from handbench.reports.drawings.sheets import INCH_MM
from handbench.support.errors import HandbenchError

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


def detector(dictionary):
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    return cv2.aruco.ArucoDetector(dictionary, parameters)


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
    figure = board_sheet(board, "markers")
    found, numbers, _ = detector(board.cv_dictionary()).detectMarkers(raster(figure))
    assert sorted(numbers.ravel()) == sorted(marker.id for marker in board.marker)
    known = board.corners_m()
    wanted = np.concatenate([known[number][:, :2] for number in numbers.ravel()])
    assert np.abs(centred(metres(found)) - centred(wanted)).max() < BAR_M


def test_a_board_of_which_y_points_down_is_turned():
    """With z into the print."""
    down = Marker(id=3, corners_m=((0, 0, 0), (0.03, 0, 0), (0.03, 0.03, 0), (0, 0.03, 0)))
    figure = board_sheet(Board(marker=(down,)), "down")
    _, numbers, _ = detector(Board(marker=(down,)).cv_dictionary()).detectMarkers(raster(figure))
    assert numbers == [[3]]


def test_what_cannot_be_printed_is_refused():
    corners_m = np.array(square(2, (0.1, 0)).corners_m)
    kite = ((0, 0, 0), (0.03, 0, 0), (0.05, -0.03, 0), (0, -0.03, 0))
    for number, other_m, complaint in (
        (2, corners_m + (0, 0, 0.001), "marker 2 is not a square in the plane z = 0"),
        (2, corners_m * (1, -1, 1), "marker 2 is not a square"),
        (2, np.array(kite), "marker 2 is not a square"),
        (50, corners_m, "the dictionary 'DICT_4X4_50' has no marker 50; use an id from 0 to 49"),
    ):
        other = Marker(id=number, corners_m=other_m.tolist())
        with pytest.raises(HandbenchError, match=complaint):
            board_sheet(Board(marker=(square(1, (0, 0)), other)), "wrong")


def draw(*arguments):
    show.run(parser().parse_args(["show", *map(str, arguments)]))


def test_descriptions_are_written_and_drawn(tmp_path, monkeypatch):
    draw("target", "-o", tmp_path / "target.toml")
    draw("stand", "-o", tmp_path / "board.toml")
    assert load_target(tmp_path / "target.toml") == default_target()
    assert load_board(tmp_path / "board.toml") == stand_board()
    monkeypatch.setitem(rcParams, "pdf.compression", 0)
    for drawing in ("target.pdf", "board.pdf"):
        draw((tmp_path / drawing).with_suffix(".toml"), "-o", tmp_path / drawing)
    content = (tmp_path / "board.pdf").read_bytes()
    placed = re.findall(rb"\s([.\d]+)\s0\s0\s-([.\d]+)\s0\s[.\d]+\scm\s/I\d+\sDo", content)
    assert len(placed) == len(stand_board().marker)
    assert np.array(placed, float) == pytest.approx(30 * 72 / INCH_MM)  # points: 30 mm


@pytest.mark.parametrize("legacy", [False, True])
@pytest.mark.parametrize("rows", [5, 6])  # the legacy pattern differs where rows are even
def test_opencv_finds_every_charuco_corner_where_the_file_says(legacy, rows):
    charuco = Charuco(columns=7, rows=rows, square_m=0.03, marker_m=0.021, legacy=legacy)
    figure = board_sheet(Board(charuco=charuco), "charuco")
    detector = cv2.aruco.CharucoDetector(charuco.cv_board())
    corners, numbers, _, _ = detector.detectBoard(raster(figure))
    assert len(numbers) == 6 * (rows - 1)
    wanted = charuco.corners_m()[numbers.ravel(), :2]
    assert np.abs(centred(metres(corners)) - centred(wanted)).max() < BAR_M
