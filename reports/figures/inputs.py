"""Pictures of what a benchmark begins with: recordings, and boards (single ArUco markers, ChArUco
boards) and calibration targets as drawings to print at true scale.

A drawing is one page, as large as it needs, as PDF. Below it are lines of text, and a scale bar
that checks the printer. A board is made of OpenCV's pictures, each stretched to its place. The
front view of a target shows it from the radar, so that x grows to the left; it is the template for
the carrier. The side view, with the holes, is from the viewer's right, with the radar on its left.
"""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
from matplotlib.transforms import Affine2D
from matplotlib.typing import RcKeyType

from handbench.reports.figures.style import COLOURS, STYLE, styled
from handbench.support.errors import HandbenchError

if TYPE_CHECKING:
    from handbench.calibration.target import Target
    from handbench.groundtruth.board import Board

MILLIMETRES = 1e3
INCH_MM = 25.4
MARGIN_MM = 10.0  # white around the drawing; printers leave up to 6.4 mm
LINE_MM = 2.8  # height of a line of text
BAR_MM = 100.0
LEAST_WIDTH_MM = 180.0  # of the lines of text
PRINTED: dict[RcKeyType, object] = {
    "font.family": "DejaVu Sans Mono",  # comes with matplotlib
    "font.size": 6.5,
    "lines.linewidth": 0.5,
    "patch.linewidth": 0.5,
    "text.parse_math": False,  # a file's name is no formula
}
# how far a marker may differ from a square, relative: a measured board's corners are not exact
SQUARE = 0.02
MARKER_PX = 504  # side of a marker's picture: a multiple of every dictionary's modules
SQUARE_PX = 128  # side of a chessboard's square; with powers of two, OpenCV's corners are exact
CORNERS = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])  # of a picture, clockwise from the top left
GAP_MM = 5.0  # between the views of a target
SHARES = (10, 50, 90)  # percentiles over the channels of a recording


def sheet(width_mm: float, height_mm: float, *footer: str) -> tuple[Figure, Axes]:
    """Return a page for a drawing, and axes in mm on it, with the origin at the drawing's lower
    left corner and y up. footer: lines of text below the drawing."""
    text = "\n".join([*footer, f"measure me: {BAR_MM:.0f} mm; print at 100 %"])
    bar_mm = -MARGIN_MM - LINE_MM * (text.count("\n") + 2)
    right_mm = max(width_mm, LEAST_WIDTH_MM) + MARGIN_MM
    low_mm, high_mm = bar_mm - MARGIN_MM, height_mm + MARGIN_MM
    figure = Figure(((right_mm + MARGIN_MM) / INCH_MM, (high_mm - low_mm) / INCH_MM))
    axes = figure.add_axes((0, 0, 1, 1), xlim=(-MARGIN_MM, right_mm), ylim=(low_mm, high_mm))
    axes.set_axis_off()
    axes.plot([0, BAR_MM], [bar_mm, bar_mm], "k|-", gid="scale-bar")
    axes.text(0, bar_mm + LINE_MM, text)
    return figure, axes


@styled(PRINTED)
def board_sheet(board: "Board", title: str) -> Figure:
    """Return the printable page of a board (ArUco markers, ChArUco) at true scale, with the board's
    x axis to the right. title: printed at its foot. Raises HandbenchError for a marker that the
    dictionary does not have and for a board that is not flat."""
    pictures, places_mm = zip(*_tiles(board), strict=True)
    low_mm = np.min(places_mm, axis=(0, 1))
    width_mm, height_mm = np.max(places_mm, axis=(0, 1)) - low_mm
    note = f"{board.describe()}: {width_mm:.1f} × {height_mm:.1f} mm"
    figure, axes = sheet(width_mm, height_mm, title, note)
    for picture, (origin, right, _, below) in zip(pictures, places_mm - low_mm, strict=True):
        place = np.vstack([np.transpose([right - origin, below - origin, origin]), (0, 0, 1)])
        axes.imshow(
            picture,
            "gray",
            interpolation="none",
            extent=(0, 1, 1, 0),
            transform=Affine2D(place) + axes.transData,
        )
    return figure


def _tiles(board: "Board") -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield the pictures that make up a board, and their CORNERS on the print [4, 2] in mm, with x
    to the right and y up. A board whose z axis points into the print (y downwards) is turned about
    its x axis."""
    import cv2

    dictionary = board.cv_dictionary()
    count = len(dictionary.bytesList)
    into = -1.0 if board.charuco else 0.0  # 1 if z points into the print
    for marker in board.marker:
        if marker.id >= count:
            raise HandbenchError(
                f"board: the dictionary '{board.dictionary}' has no marker {marker.id}; use an id "
                f"from 0 to {count - 1}"
            )
        x, y, z = MILLIMETRES * np.transpose(marker.corners_m)
        right, _, below = (x + 1j * y)[1:] - (x[0] + 1j * y[0])
        into = into or np.sign((right.conj() * below).imag)
        square = x[0] + 1j * y[0] + right * (CORNERS @ (1, into * 1j))
        if not np.hypot(np.abs(x + 1j * y - square), z).max() < SQUARE * abs(right):
            raise HandbenchError(
                f"board: marker {marker.id} is not a square in the plane z = 0 with clockwise "
                "corners; correct its corners_m, and describe each plane as a board of its own"
            )
        picture = cv2.aruco.generateImageMarker(dictionary, marker.id, MARKER_PX)
        yield picture, np.stack([x, -into * y], axis=1)
    if (charuco := board.charuco) is not None:
        ratio = charuco.marker_m / charuco.square_m
        unit = charuco.model_copy(update={"square_m": 1.0, "marker_m": ratio})
        size = np.array([charuco.columns, charuco.rows])
        place_mm = MILLIMETRES * charuco.square_m * size * CORNERS * (1, -1)
        yield unit.cv_board().generateImage(SQUARE_PX * size), place_mm


@styled(PRINTED)
def target_sheet(target: "Target", title: str) -> Figure:
    """Return the printable page of the calibration target (metal balls in foam spheres) at true
    scale. title: printed at its foot."""
    centres_mm = pd.DataFrame(MILLIMETRES * target.centres_m, columns=["x", "y", "z"])
    foam_mm = MILLIMETRES * pd.Series([e.sphere_radius_m for e in target.element])
    ball_mm = MILLIMETRES * pd.Series([e.ball_radius_m for e in target.element])
    low_mm = centres_mm.sub(foam_mm, axis=0).min()
    high_mm = centres_mm.add(foam_mm, axis=0).max()
    parts_mm = centres_mm.assign(foam=2 * foam_mm, ball=2 * ball_mm, hole=foam_mm + ball_mm)
    parts_mm["spacer"] = high_mm.z - centres_mm.z - foam_mm
    parts_mm.index += 1
    side_mm = high_mm.x - low_mm.x + GAP_MM  # where the side view begins
    figure, axes = sheet(
        side_mm + high_mm.z - low_mm.z,
        high_mm.y - low_mm.y,
        title,
        "left: from the radar, the template of the carrier; right: the holes, drilled from behind",
        f"mm; foam (permittivity {target.foam_permittivity:g}), steel ball: diameters; hole: depth",
        parts_mm.to_string(float_format="{:.2f}".format),
    )
    rows = parts_mm.to_numpy()
    for number, (x_mm, y_mm, z_mm, foam, ball, hole, _) in enumerate(rows, 1):
        front, side, y = high_mm.x - x_mm, side_mm + z_mm - low_mm.z, y_mm - low_mm.y
        for x in (front, side):
            axes.add_patch(Circle((x, y), foam / 2, fill=False))
            axes.add_patch(Circle((x, y), ball / 2, fc="0.88", ec="black"))
            axes.plot(x, y, "k+", ms=40, mew=0.25)
        axes.text(front + ball / 2, y + ball / 2, str(number), size=9, weight="bold")
        # from the ball's far end to the sphere's back
        corner = side - ball / 2, y - ball / 2
        axes.add_patch(Rectangle(corner, hole, ball, fill=False, ls="--"))
    return figure


def echoes_figure(
    title: str,
    frequencies_hz: np.ndarray,
    levels_db: np.ndarray,
    places_m: Mapping[str, np.ndarray],
    profile: tuple[np.ndarray, np.ndarray] | None,
) -> Figure:
    """Plot a radar recording: level over frequency, positions of the antennas as seen from behind
    the array and, if given, level over range.

    Args:
        title: of the figure.
        frequencies_hz: [f].
        levels_db: [3, f], the 10th, 50th and 90th percentile over the channels (SHARES).
        places_m: group of antennas, such as "receivers" → positions [n, 3].
        profile: ranges [n] in metres up to the unambiguous range, and levels [n] in dB.
    """
    order = np.argsort(frequencies_hz)
    ghz, (low, middle, high) = frequencies_hz[order] / 1e9, levels_db[:, order]
    with styled(STYLE):
        figure = Figure(figsize=(10 if profile else 7, 3.2), layout="constrained")
        figure.suptitle(title)
        spectrum, places, *more = figure.subplots(1, 3 if profile else 2)
        spectrum.fill_between(
            ghz, low, high, color=COLOURS[0], alpha=0.2, linewidth=0, label="10 to 90 % of channels"
        )
        spectrum.plot(
            ghz,
            middle,
            color=COLOURS[0],
            marker="." if len(ghz) <= 64 else "",
            label="median channel",
        )
        spectrum.set(
            xlabel="frequency in GHz",
            ylabel="level in dB below the largest sample",
            title="spectrum",
        )
        spectrum.margins(y=0.4)  # for the legend
        spectrum.legend(loc="lower left")
        for (name, of_m), colour, marker in zip(places_m.items(), COLOURS, "os", strict=False):
            x_mm, y_mm = 1e3 * of_m[:, :2].T
            size = 12 if len(of_m) <= 300 else 2
            places.scatter(x_mm, y_mm, size, color=colour, marker=marker, linewidth=0, label=name)
        places.set(xlabel="x in mm, growing to the left", ylabel="y in mm", title="antennas")
        places.set_aspect("equal", adjustable="datalim")
        places.invert_xaxis()
        places.legend(loc="center")
        if profile:
            more[0].plot(1e3 * profile[0], profile[1], color=COLOURS[0])
            more[0].set(
                xlabel="half the path in mm;\nwhat is farther folds back",
                ylabel="dB below the maximum",
                title="range, mean of channels",
            )
    return figure
