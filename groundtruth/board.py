"""Boards of ArUco markers and ChArUco boards: the metric scale and the frame of photographs."""

from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from pydantic import Field, model_validator

from handbench.support.config import Config, Near, load
from handbench.support.errors import HandbenchError
from handbench.support.files import write_text

CHESSBOARD = -1  # key of the ChArUco board, among the markers' ids


class Marker(Config):
    """One ArUco marker: its id, and its four corners (x, y, z) in the board's frame, metres, in
    OpenCV's order (clockwise from top left)."""

    id: int = Field(ge=0, le=9999)
    corners_m: tuple[tuple[Near, Near, Near], ...] = Field(min_length=4, max_length=4)


class Charuco(Config):
    """A ChArUco board: a chessboard with an ArUco marker in each white square, as OpenCV draws it.

    It has columns × rows squares of side square_m, and markers of side marker_m from OpenCV's
    `dictionary`. legacy: the board has the pattern that OpenCV drew before version 4.6. The board's
    frame has its origin at the top left corner, x along the upper edge, y upwards and z out of the
    print.
    """

    columns: int = Field(ge=3, le=100)
    rows: int = Field(ge=3, le=100)
    square_m: float = Field(gt=0, le=1)
    marker_m: float = Field(gt=0, ge=1e-6)  # OpenCV takes float32
    dictionary: str = "DICT_4X4_50"
    legacy: bool = False

    @model_validator(mode="after")
    def _fits(self) -> "Charuco":
        if self.marker_m >= self.square_m:
            raise ValueError("a marker must be smaller than the square around it")
        count = len(cv_dictionary(self.dictionary).bytesList)
        if self.markers > count:
            raise ValueError(
                f"the board needs {self.markers} markers, but the dictionary '{self.dictionary}' "
                f"has {count}; use a larger dictionary"
            )
        return self

    @property
    def markers(self) -> int:
        """Number of the board's markers, whose ids count from 0."""
        return self.columns * self.rows // 2

    def corners_m(self) -> np.ndarray:
        """Compute the inner corners of the chessboard, [(rows − 1)(columns − 1), 3], in the board's
        frame, metres, row by row from the top left."""
        corners_m = np.array(self.cv_board().getChessboardCorners(), np.float64)
        return corners_m * (1, -1, 1)  # OpenCV's y runs downwards

    def cv_board(self) -> Any:
        """Make OpenCV's object of this board."""
        import cv2

        board = cv2.aruco.CharucoBoard(
            (self.columns, self.rows), self.square_m, self.marker_m, cv_dictionary(self.dictionary)
        )
        board.setLegacyPattern(self.legacy)
        return board


class Board(Config):
    """A rigid target of single ArUco markers, a ChArUco board, or both. The target's frame becomes
    the world frame of the photographs.

    dictionary: OpenCV's dictionary of the single markers.
    """

    dictionary: str = "DICT_4X4_50"
    marker: tuple[Marker, ...] = Field(default=(), max_length=1000)
    charuco: Charuco | None = None

    @model_validator(mode="after")
    def _has_different_markers(self) -> "Board":
        ids = [marker.id for marker in self.marker]
        if self.charuco is not None and self.charuco.dictionary == self.dictionary:
            ids += range(self.charuco.markers)
        if len(set(ids)) < len(ids):
            raise ValueError("two markers have the same id, also counting the charuco board's")
        if not ids and self.charuco is None:
            raise ValueError("the board has no marker; add a [[marker]] or a [charuco]")
        return self

    def corners_m(self) -> dict[int, np.ndarray]:
        """Return the positions of all corners in the board's frame, metres.

        The keys are the markers' ids, each with its corners [4, 3]; the ChArUco board, if there is
        one, has the key CHESSBOARD (−1) and its inner corners [n, 3].
        """
        corners = {m.id: np.array(m.corners_m, np.float64) for m in self.marker}
        return corners if self.charuco is None else corners | {CHESSBOARD: self.charuco.corners_m()}

    def cv_dictionary(self) -> Any:
        """Return OpenCV's dictionary object of the single markers (those outside the ChArUco
        board)."""
        return cv_dictionary(self.dictionary)

    def describe(self) -> str:
        """Describe the board's markers and squares in a phrase, for error messages."""
        parts = []
        if self.marker:
            parts += [f"markers of {self.dictionary}, ids {sorted(m.id for m in self.marker)}"]
        if (c := self.charuco) is not None:
            parts += [f"{c.columns} × {c.rows} squares with {c.dictionary}"]
        return " and ".join(parts)


def cv_dictionary(name: str) -> Any:
    """Return OpenCV's ArUco dictionary of this name, such as "DICT_4X4_50". Raises HandbenchError
    for a name that OpenCV does not have."""
    import cv2

    number = getattr(cv2.aruco, name, None)
    if not name.startswith("DICT_") or number is None:
        raise HandbenchError(
            f"board: the dictionary '{name}' is unknown; use one of OpenCV's, such as DICT_4X4_50"
        )
    return cv2.aruco.getPredefinedDictionary(number)


def load_board(path: str | Path) -> Board:
    """Read the description of a board from a `board.toml` file. Raises HandbenchError for a
    malformed file."""
    return load(Board, path, "an ArUco board description")


def save_board(path: str | Path, board: Board) -> None:
    """Write the description of a board to a `board.toml` file, atomically."""
    write_text(path, tomlkit.dumps(board.model_dump(exclude_none=True)))
