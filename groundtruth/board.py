"""ArUco boards: the metric scale and the frame of photographs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from pydantic import Field, field_validator

from calibration import Config, HandbenchError, atomic_path, load


class Marker(Config):
    """One marker: its id and its four corners [4][x, y, z] in metres, OpenCV's order (clockwise from top left)."""

    id: int = Field(ge=0)
    corners_m: tuple[tuple[float, float, float], ...] = Field(min_length=4, max_length=4)


class Board(Config):
    """A rigid set of ArUco markers; its frame is the photographs' world frame."""

    dictionary: str = "DICT_4X4_50"
    marker: tuple[Marker, ...] = Field(min_length=1)

    @field_validator("marker")
    @classmethod
    def _ids_differ(cls, markers: tuple[Marker, ...]) -> tuple[Marker, ...]:
        if len({marker.id for marker in markers}) < len(markers):
            raise ValueError("two markers have the same id")
        return markers

    def corners_m(self) -> dict[int, np.ndarray]:
        """Marker id → corners [4, 3], metres."""
        return {m.id: np.array(m.corners_m, dtype=np.float64) for m in self.marker}

    def cv_dictionary(self) -> Any:
        """OpenCV's dictionary object."""
        import cv2

        number = getattr(cv2.aruco, self.dictionary, None)
        if not self.dictionary.startswith("DICT_") or number is None:
            raise HandbenchError(f"board: unknown dictionary '{self.dictionary}'; use one of OpenCV's, as DICT_4X4_50")
        return cv2.aruco.getPredefinedDictionary(number)


def load_board(path: str | Path) -> Board:
    """Read `board.toml`."""
    return load(Board, path, "an ArUco board description")


def save_board(path: str | Path, board: Board) -> None:
    """Write `board.toml`, atomically."""
    with atomic_path(path) as temporary:
        temporary.write_text(tomlkit.dumps(board.model_dump()), encoding="utf-8")
