"""Drawings of boards (single ArUco markers, ChArUco boards) for printing at true scale.

All black parts are one path, so that viewers show no hairlines between neighbouring rectangles.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path

from handbench.reports.drawings.sheets import sheet
from handbench.support.errors import HandbenchError

if TYPE_CHECKING:
    from handbench.groundtruth.board.board import Board

MILLIMETRES = 1e3
FLAT_M = 5e-5  # largest distance of a corner from the plane of print: finer than paper is flat
# how far a marker's sides may differ, relative: a measured board's corners are not exact
SQUARE = 0.02
# white around the board, in sides of its largest marker: one module of the smallest dictionaries
QUIET = 1 / 6


def board_sheet(board: "Board", title: str) -> Figure:
    """Return the printable page of a board (ArUco markers, ChArUco) at true scale, inside a white
    border, with the board's x axis to the right. title: printed at its foot. Raises HandbenchError
    for a marker that the dictionary does not have and for a board that is not flat."""
    quads_mm = np.array(list(black_quads_mm(board)))
    charuco_m = [board.charuco.marker_m] if board.charuco else []
    quiet_mm = QUIET * MILLIMETRES * max(_sides_m(board) + charuco_m)
    low_mm = quads_mm.min(axis=(0, 1)) - quiet_mm
    width, height = quads_mm.max(axis=(0, 1)) + quiet_mm - low_mm

    def paint(axes: Axes) -> None:
        rings = [Path(np.r_[quad, quad[:1]], closed=True) for quad in quads_mm - low_mm]
        ink = Path.make_compound_path(*rings)
        axes.add_patch(PathPatch(ink, facecolor="black", edgecolor="none", snap=False, gid="ink"))

    note = f"{width:.1f} × {height:.1f} mm: {_sizes(board)}"
    return sheet((float(width), float(height)), title, note, paint)


def black_quads_mm(board: "Board") -> Iterator[np.ndarray]:
    """Yield all black parts of the board as quadrilaterals that do not overlap.
    Each is [4, 2]: its corners in mm from the origin of the board's frame, x to the right and y up
    on the print. A board whose z axis points into the print (y downwards) is turned about its x
    axis."""
    upward = _upward(board)
    for marker in board.marker:
        corners_mm = MILLIMETRES * np.array(marker.corners_m)[:, :2] * (1, upward)
        yield from _modules(board.cv_dictionary(), board.dictionary, marker.id, corners_mm)
    if board.charuco is None:
        return
    side_mm, inner = (
        MILLIMETRES * board.charuco.square_m,
        board.charuco.marker_m / board.charuco.square_m,
    )
    cv_board = board.charuco.cv_board()
    white = set()
    for number, corners_m in zip(cv_board.getIds().ravel(), cv_board.getObjPoints(), strict=True):
        column, row = (
            int(v) for v in np.floor(np.mean(corners_m, axis=0)[:2] / board.charuco.square_m)
        )
        white.add((column, row))
        # From the square, not from OpenCV's corners: these are float32.
        quad_mm = side_mm * _square(column, row, inner)
        yield from _modules(
            cv_board.getDictionary(), board.charuco.dictionary, int(number), quad_mm
        )
    for column in range(board.charuco.columns):
        for row in range(board.charuco.rows):
            if (column, row) not in white:
                yield side_mm * _square(column, row, 1.0)


def _square(column: int, row: int, side: float) -> np.ndarray:
    """Return the corners [4, 2], in OpenCV's order, of a square centred in a field of a chessboard.
    column, row: the field; side: length of the square's sides. All lengths are in units of a
    field's side, with y up."""
    return np.array([column + 0.5, -row - 0.5]) + side / 2 * np.array(
        [(-1, 1), (1, 1), (1, -1), (-1, -1)]
    )


def _modules(
    known: Any, dictionary: str, number: int, corners_mm: np.ndarray
) -> Iterator[np.ndarray]:
    """Yield the black parts of an ArUco marker as quadrilaterals [4, 2] in mm. There is one for
    each run of black modules (the marker's smallest squares) in a row.
    known: OpenCV's dictionary; dictionary: its name; number: of the marker; corners_mm [4, 2]: the
    marker's corners in OpenCV's order. Raises HandbenchError for a number that the dictionary does
    not have."""
    if number >= len(known.bytesList):
        raise HandbenchError(
            f"board: the dictionary '{dictionary}' has no marker {number}; use an id from 0 to "
            f"{len(known.bytesList) - 1}"
        )
    count = known.markerSize + 2  # a border of one module
    bits = cv2.aruco.generateImageMarker(known, number, count)
    for row in range(count):
        edges = np.flatnonzero(np.diff(bits[row] == 0, prepend=False, append=False))
        for start, stop in edges.reshape(-1, 2):
            u, v = (
                np.array([start, stop, stop, start]) / count,
                np.array([row, row, row + 1, row + 1]) / count,
            )
            weights = np.stack([(1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v], axis=1)
            yield weights @ corners_mm


def _upward(board: "Board") -> int:
    """Return 1 if the z axis of the board's frame points out of the print, −1 if it points into it.
    Raises HandbenchError for a board that cannot be printed: a marker that is not square, or
    markers that are not in one plane and facing the same way."""
    turns = set() if board.charuco is None else {1}
    heights_m = [0.0] * len(turns)
    for marker in board.marker:
        corners_m = np.array(marker.corners_m)
        heights_m += list(corners_m[:, 2])
        sides_m = np.linalg.norm(corners_m - np.roll(corners_m, 1, axis=0), axis=1)
        # and diagonals
        lengths_m = np.r_[
            sides_m, np.linalg.norm(corners_m[:2] - corners_m[2:], axis=1) / np.sqrt(2)
        ]
        if not np.ptp(lengths_m) < SQUARE * lengths_m.max():
            shown = ", ".join(f"{MILLIMETRES * side:.2f}" for side in sides_m)
            raise HandbenchError(
                f"board: marker {marker.id} has sides of {shown} mm; expected a square with its "
                "corners in clockwise order"
            )
        (ax, ay), (bx, by) = (corners_m[2] - corners_m[0])[:2], (corners_m[3] - corners_m[1])[:2]
        turns.add(-int(np.sign(ax * by - ay * bx)))
    if np.ptp(heights_m) > FLAT_M or len(turns) > 1:
        raise HandbenchError(
            "board: its markers are not in one plane of constant z, or do not all face the same "
            "way, so they cannot be drawn on one sheet; describe each plane as a board of its "
            "own, with z = 0"
        )
    return turns.pop()


def _sides_m(board: "Board") -> list[float]:
    """Return the side length of each single marker of the board, metres."""
    return [float(np.linalg.norm(np.subtract(*marker.corners_m[:2]))) for marker in board.marker]


def _sizes(board: "Board") -> str:
    """Describe the dictionaries and sizes of the board's markers in words, so that a print can be
    checked with a ruler."""
    parts = []
    if board.marker:
        sides = sorted({f"{MILLIMETRES * side:.1f}" for side in _sides_m(board)})
        parts.append(f"{len(board.marker)} markers of {board.dictionary}, {'/'.join(sides)} mm")
    if board.charuco is not None:
        c = board.charuco
        legacy = " (legacy)" if c.legacy else ""
        size = f"{MILLIMETRES * c.square_m:.1f}/{MILLIMETRES * c.marker_m:.1f} mm"
        parts.append(f"{c.columns} × {c.rows} squares with {c.dictionary}{legacy}, {size}")
    return "; ".join(parts)
