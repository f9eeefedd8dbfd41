"""Drawings of boards (single ArUco markers, ChArUco boards) for printing at true scale: OpenCV's
pictures, each stretched to its place."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.transforms import Affine2D

from handbench.reports.drawings.sheets import STYLE, sheet
from handbench.reports.figures.style import styled
from handbench.support.errors import HandbenchError

if TYPE_CHECKING:
    from handbench.groundtruth.board import Board

MILLIMETRES = 1e3
# how far a marker may differ from a square, relative: a measured board's corners are not exact
SQUARE = 0.02
MARKER_PX = 504  # side of a marker's picture: a multiple of every dictionary's modules
SQUARE_PX = 128  # side of a chessboard's square; with powers of two, OpenCV's corners are exact
CORNERS = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])  # of a picture, clockwise from the top left


@styled(STYLE)
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
