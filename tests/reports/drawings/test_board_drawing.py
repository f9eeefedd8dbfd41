"""Printed boards: what OpenCV finds on the sheets is what board.toml says; and `handbench show` of
a board."""

import cv2
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from handbench.bench.scenes.stand import stand_board
from handbench.calibration.spheres.description import default_target, load_target
from handbench.cli import show
from handbench.cli.main import parser
from handbench.groundtruth.board.board import Board, Charuco, Marker, load_board
from handbench.reports.drawings.board_drawing import board_drawing, board_sheets
from handbench.reports.drawings.sheets import INCH_MM, sheets, tiles
from handbench.support.errors import HandbenchError

PIXELS_PER_MM = 8
BAR_M = 5e-5  # half a pixel is 0.06 mm; sharp edges are found to a fraction of it
CHARUCO = {
    "columns": 7,
    "rows": 5,
    "square_m": 0.03,
    "marker_m": 0.021,
    "dictionary": "DICT_5X5_50",
}


def raster(figure, pixels_per_mm=PIXELS_PER_MM):
    """The sheet's grey values [height, width]."""
    figure.set_dpi(pixels_per_mm * INCH_MM)
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
    [figure] = board_sheets(board, "markers", "fit")
    found, numbers, _ = detector(board.cv_dictionary()).detectMarkers(raster(figure))
    assert sorted(numbers.ravel()) == sorted(marker.id for marker in board.marker)
    known = board.corners_m()
    wanted = np.concatenate([known[number][:, :2] for number in numbers.ravel()])
    assert np.abs(centred(metres(found)) - centred(wanted)).max() < BAR_M


@pytest.mark.parametrize("legacy", [False, True])
@pytest.mark.parametrize("rows", [5, 6])  # the legacy pattern differs where rows are even
def test_opencv_finds_every_charuco_corner_and_draws_the_same(legacy, rows):
    charuco = Charuco(**CHARUCO | {"rows": rows}, legacy=legacy)
    [figure] = board_sheets(Board(charuco=charuco), "charuco", "fit")
    image = raster(figure)
    corners, numbers, _, _ = cv2.aruco.CharucoDetector(charuco.cv_board()).detectBoard(image)
    assert len(numbers) == 6 * (rows - 1)
    wanted = charuco.corners_m()[numbers.ravel(), :2]
    assert np.abs(centred(metres(corners)) - centred(wanted)).max() < BAR_M

    opencv = charuco.cv_board().generateImage(
        (700, 100 * rows)
    )  # a module is 10 texels: nothing is rounded
    origin = 1000 * PIXELS_PER_MM * (metres(corners)[0] - wanted[0])  # the board's, on the sheet
    texel = 0.3 * PIXELS_PER_MM
    columns, lines = (
        ((np.arange(n) + 0.5) * texel + start).round().astype(int)
        for n, start in ((700, origin[0]), (100 * rows, -origin[1]))
    )
    ours = image[np.ix_(lines, columns)]
    edge = (
        cv2.morphologyEx(opencv, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8)) > 0
    )  # a pixel more or less
    assert np.array_equal(ours[~edge] > 127, opencv[~edge] > 127) and edge.mean() < 0.2


def test_a_frame_with_y_downwards_is_turned_and_not_mirrored():
    up = Board(marker=(square(3, (0, 0)), square(4, (0.07, 0.05))))
    down = Board(
        marker=[
            Marker(id=m.id, corners_m=(np.array(m.corners_m) * (1, -1, -1)).tolist())
            for m in up.marker
        ]
    )
    images = [raster(board_sheets(board, "same", "fit")[0]) for board in (up, down)]
    assert np.array_equal(*images)


def test_neighbouring_modules_leave_no_hairline():
    """At 97 dpi no edge between rows falls on a pixel's edge; rectangles painted one by one would
    show through."""
    [figure] = board_sheets(Board(marker=(square(0, (0, 0)),)), "one", "fit")
    image = raster(figure, 97 / INCH_MM)
    dark = np.argwhere(image < 128)
    top, left = dark[dark[:, 0] < 160].min(axis=0)
    border = image[
        top + 3 : top + int(30 * 97 / INCH_MM) - 3, left + 3 : left + int(5 * 97 / INCH_MM) - 3
    ]
    assert border.shape[0] > 100 and border.shape[1] > 10 and border.max() == 0


@pytest.mark.parametrize("paper", ["A4", "A3", "letter"])
def test_tiles_laid_on_each_others_ticks_are_the_board(paper):
    """Each tile's pixels at its window's place; sheets differ from the whole by where the pixels'
    edges fall."""
    scale = 4
    drawing = board_drawing(stand_board(), "stand")
    canvas = np.full(
        (round(drawing.height_mm * scale) + 2, round(drawing.width_mm * scale) + 2), np.nan
    )
    _, windows = tiles(drawing, paper)
    figures = sheets([drawing], paper)
    assert len(figures) == len(windows) > 1
    for figure, window in zip(figures, windows, strict=True):
        piece = cut_out(raster(figure, scale), figure, scale)
        row, column = (
            round((drawing.height_mm - window[1] - window[3]) * scale),
            round(window[0] * scale),
        )
        canvas[row : row + len(piece), column : column + piece.shape[1]] = piece
        assert ticks_mm(figure) == pytest.approx(neighbours_mm(figure, window, windows), abs=1e-6)
    canvas = canvas[:-2, :-2]
    assert not np.isnan(canvas).any()
    [whole] = sheets([drawing], "fit")
    whole = cut_out(raster(whole, scale), whole, scale)[: len(canvas), : canvas.shape[1]]
    canvas = canvas[: len(whole), : whole.shape[1]]
    edges = cv2.morphologyEx(whole, cv2.MORPH_GRADIENT, np.ones((5, 5), np.uint8)) > 0
    assert np.abs(canvas - whole)[~edges].max() == 0 and edges.mean() < 0.1


def cut_out(image, figure, scale):
    """The window's pixels; a sheet's second axes are its window."""
    box = figure.axes[1].get_position()
    width, height = figure.get_size_inches() * INCH_MM * scale
    top, bottom = round(height * (1 - box.y1)), round(height * (1 - box.y0))
    return image[top:bottom, round(width * box.x0) : round(width * box.x1)]


def ticks_mm(figure):
    """Places of a sheet's ticks, the lines of 0.8 points: x of the upright, y of the level ones."""
    lines = [line for line in figure.axes[0].lines if line.get_linewidth() == 0.8]
    upright = {
        round(line.get_xdata()[0], 9)
        for line in lines
        if line.get_xdata()[0] == line.get_xdata()[1]
    }
    level = {
        round(line.get_ydata()[0], 9)
        for line in lines
        if line.get_ydata()[0] == line.get_ydata()[1]
    }
    return [*sorted(upright), *sorted(level)]


def neighbours_mm(figure, window, windows):
    """Places on the sheet of the right neighbour's left edge and of the lower one's upper edge."""
    box = figure.axes[1].get_position()
    width, height = figure.get_size_inches() * INCH_MM
    right = sorted({w[0] for w in windows if w[0] > window[0]})[:1]
    lower = sorted({w[1] for w in windows if w[1] < window[1]})[-1:]
    return [box.x0 * width + x - window[0] for x in right] + [
        box.y0 * height + y + window[3] - window[1] for y in lower
    ]


def test_what_cannot_be_printed_is_refused():
    raised = Marker(
        id=2, corners_m=(np.array(square(2, (0.1, 0)).corners_m) + (0, 0, 0.001)).tolist()
    )
    turned = Marker(id=2, corners_m=(np.array(square(2, (0.1, 0)).corners_m) * (1, -1, 1)).tolist())
    kite = Marker(id=2, corners_m=((0, 0, 0), (0.03, 0, 0), (0.05, -0.03, 0), (0, -0.03, 0)))
    for other, complaint in (
        (raised, "are not in one plane"),
        (turned, "facing one way"),
        (kite, "marker 2 has sides of 30.00, 30.00, 36.06, 50.00 mm; expected a square"),
        (
            square(50, (0.1, 0)),
            "marker 50 is not in the dictionary 'DICT_4X4_50', which has 0 to 49",
        ),
        (square(2, (30.0, 0)), "are all lengths metres"),
    ):
        with pytest.raises(HandbenchError, match=complaint):
            board_sheets(Board(marker=(square(1, (0, 0)), other)), "wrong", "A4")


def draw(*arguments):
    show.run(parser().parse_args(["show", *map(str, arguments)]))


def test_descriptions_are_written_and_drawn(tmp_path):
    draw("target", "-o", tmp_path / "target.toml")
    draw("stand", "-o", tmp_path / "board.toml")
    assert load_target(tmp_path / "target.toml") == default_target()
    assert load_board(tmp_path / "board.toml") == stand_board()
    for drawing in ("target.svg", "board.svg", "board.pdf"):
        draw((tmp_path / drawing).with_suffix(".toml"), "-o", tmp_path / drawing)
    assert (tmp_path / "board.pdf").read_bytes().count(b"/MediaBox") == 4
    assert b'width="410mm" height="322mm"' in (tmp_path / "board.svg").read_bytes()


def test_a_folder_named_as_a_built_in_thing_is_shown_itself(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    draw("target")
    assert (tmp_path / "target.pdf").read_bytes().startswith(b"%PDF")
    (tmp_path / "target").mkdir()
    with pytest.raises(HandbenchError, match="target"):
        draw("target", "-o", "folder.pdf")
    assert not (tmp_path / "folder.pdf").exists()


def test_mistakes_are_one_line_and_leave_no_file(tmp_path):
    kept, strange = tmp_path / "kept.pdf", tmp_path / "strange.toml"
    kept.write_text("kept")
    strange.write_text("name = 1\n")
    for arguments, complaint in (
        (("target", "-o", kept), "exists already"),
        (("target", "-o", tmp_path / "a.png"), r"ends in '\.png'; expected \.svg, \.pdf, \.toml"),
        (("stand", "-o", tmp_path / "a.svg", "--paper", "A4"), "one page, the drawing 4 sheets"),
        (("tarjet", "-o", tmp_path / "a.pdf"), "tarjet: is nothing .* board.toml or target.toml"),
        (("target", "--3d", "-o", tmp_path / "a.html"), "leave out --3d"),
        ((strange.parent, "--paper", "A4"), "is neither target nor board"),
        ((strange, "-o", tmp_path / "a.pdf"), "is nothing that can be shown"),
    ):
        with pytest.raises(HandbenchError, match=complaint) as caught:
            draw(*arguments)
        assert "\n" not in str(caught.value)
    assert sorted(tmp_path.iterdir()) == [kept, strange] and kept.read_text() == "kept"
    draw("stand", "-o", kept, "--overwrite")
    assert kept.read_bytes().startswith(b"%PDF")
