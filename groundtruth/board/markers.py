"""The board's corners in photographs."""

import cv2
import numpy as np

from handbench.groundtruth.board.board import CHESSBOARD, Board
from handbench.groundtruth.board.corners import refined, to_light
from handbench.groundtruth.photos.exif import is_plausible
from handbench.groundtruth.photos.photos import Photo
from handbench.support.errors import HandbenchError

FEWEST_CORNERS = 16  # for a focal length

Corners = dict[tuple[int, int], np.ndarray]  # (marker, or CHESSBOARD, and its corner) → pixel [2], COLMAP's convention


def detect_corners(photo: Photo, board: Board) -> Corners:
    """Sub-pixel corners of the board in a photograph."""
    tones = photo.gray()
    picture = (tones * 255).round().astype(np.uint8)
    found = _chessboard_corners(picture, board)
    if board.marker:
        found |= _marker_corners(picture, to_light(tones), board)
    return {name: at + 0.5 for name, at in found.items()}  # OpenCV's first pixel is centred at 0, COLMAP's at 0.5


def _marker_corners(picture: np.ndarray, light: np.ndarray, board: Board) -> Corners:
    """Intersections of the markers' edges; a marker seen twice is a mistake."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    found, ids, _ = cv2.aruco.ArucoDetector(board.cv_dictionary(), parameters).detectMarkers(picture)
    known = board.corners_m()
    names = [] if ids is None else ids.ravel().tolist()
    return {
        (name, k): corner
        for name, quad in zip(names, found, strict=True)
        if name in known and names.count(name) == 1
        for k, corner in enumerate(refined(light, quad.reshape(4, 2).astype(np.float64)))
        if not np.isnan(corner).any()
    }


def _chessboard_corners(picture: np.ndarray, board: Board) -> Corners:
    """Inner corners of the chessboard: blur and tone curve do not shift them."""
    if board.charuco is None:
        return {}
    corners, ids, *_ = cv2.aruco.CharucoDetector(board.charuco.cv_board()).detectBoard(picture)
    if ids is None:
        return {}
    pixels = np.asarray(corners, dtype=np.float64).reshape(-1, 2)
    return {(CHESSBOARD, k): pixel for k, pixel in zip(ids.ravel().tolist(), pixels, strict=True)}


def require_board(seen: dict[str, Corners], board: Board) -> dict[str, Corners]:
    """`seen` (photograph → corners), or a HandbenchError when no corner is in two photographs."""
    corners = [corner for found in seen.values() for corner in found]
    if len(corners) == len(set(corners)):
        count = sum(bool(found) for found in seen.values())
        raise HandbenchError(
            f"board: its corners ({board.describe()}) were found in {count} of {len(seen)} photographs, each at most "
            "once; some must be in two: check dictionary, ids and focus"
        )
    return seen


def focal_length_px(photo: Photo, corners: Corners, board: Board) -> float | None:
    """Focal length from one view of the board, within a few per cent; None where the photograph shows too little.

    A plane under a slant fixes one focal length when the principal point is taken to be the middle (Zhang, TPAMI 2000).
    """
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
    return float(K[0, 0]) if is_plausible(K[0, 0], *size) else None
