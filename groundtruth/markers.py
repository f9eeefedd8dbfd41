"""The board's markers in photographs."""

from __future__ import annotations

import numpy as np

from calibration import HandbenchError
from groundtruth.board import Board
from groundtruth.photos import Photo

FEWEST_CORNERS = 16  # for a focal length

Corners = dict[tuple[int, int], np.ndarray]  # (marker, corner) → pixel [2], COLMAP's convention


def detect_corners(photo: Photo, board: Board) -> Corners:
    """Sub-pixel corners of the board's markers in a photograph."""
    import cv2

    gray = (photo.gray() * 255).round().astype(np.uint8)
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    found, ids, _ = cv2.aruco.ArucoDetector(board.cv_dictionary(), parameters).detectMarkers(gray)
    known = board.corners_m()
    names = [] if ids is None else ids.ravel().tolist()
    return {  # OpenCV's first pixel is centred at 0, COLMAP's at 0.5; a marker seen twice is a mistake
        (name, k): corner.astype(np.float64) + 0.5
        for name, quad in zip(names, found, strict=True)
        if name in known and names.count(name) == 1
        for k, corner in enumerate(quad.reshape(4, 2))
    }


def require_board(seen: dict[str, Corners], board: Board) -> dict[str, Corners]:
    """`seen` (photograph → corners), or a HandbenchError when no marker is in two photographs."""
    corners = [corner for found in seen.values() for corner in found]
    if len(corners) == len(set(corners)):
        count = sum(bool(found) for found in seen.values())
        raise HandbenchError(
            f"board: its markers ({board.dictionary}, ids {sorted(board.corners_m())}) were found in {count} of "
            f"{len(seen)} photographs, each marker at most once; one must be in two: check dictionary, ids and focus"
        )
    return seen


def focal_length_px(photo: Photo, corners: Corners, board: Board) -> float | None:
    """Focal length from one view of the board, within a few per cent; None where the photograph shows too little.

    A plane under a slant fixes one focal length when the principal point is taken to be the middle (Zhang, TPAMI 2000).
    """
    import cv2

    if len(corners) < FEWEST_CORNERS:
        return None
    known = board.corners_m()
    points_m = np.array([known[marker][k] for marker, k in corners], dtype=np.float32)
    if np.ptp(points_m[:, 2]) > 0:
        return None
    pixels = np.array(list(corners.values()), dtype=np.float32) - 0.5
    size = (photo.width, photo.height)
    guess = np.array([[1.2 * max(size), 0, size[0] / 2 - 0.5], [0, 1.2 * max(size), size[1] / 2 - 0.5], [0, 0, 1]])
    flags = cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_PRINCIPAL_POINT | cv2.CALIB_FIX_ASPECT_RATIO
    flags |= cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3
    _, K, *_ = cv2.calibrateCamera([points_m], [pixels], size, guess, None, flags=flags)
    plausible = 0.3 * max(size) < K[0, 0] < 10 * max(size)
    return float(K[0, 0]) if plausible else None
