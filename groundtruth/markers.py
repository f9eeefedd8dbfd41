"""Detection of a board's corners in photographs.

Two errors shift detected corners, together by about half a pixel: a corner detector places the
corner of a blurred square too far inside, and the photograph's tone curve (sRGB) shifts every edge
towards the dark side. This module therefore converts tones to linear light and fits a straight line
to the middle of each edge's brightness slope; the lines' intersections have neither error.
"""

from collections.abc import Callable, Iterable

import cv2
import numpy as np

from handbench.groundtruth.board import CHESSBOARD, Board
from handbench.groundtruth.photos import Photo, read_gray
from handbench.support.errors import HandbenchError

FEWEST_CORNERS = 16  # of a view, for a focal length
PLAUSIBLE = (0.3, 10.0)  # focal length over the picture's longer side
REACHES_PX = (4.0, 3.0)  # across the edge, first and second pass
AROUND_PX = 16  # a marker, of which tones are converted
REACH = 1 / 8  # largest reach relative to the shortest side; a marker's border is 1/6 to 1/12 of it
INNER = 0.1  # share at either end of an edge that is left out: blur mixes in the other edge
STEP_PX = 0.5
SAMPLES = 16  # of a projected edge
FAINTEST = 0.5  # of the typical slope along the edge
CLEAR = 0.6  # of the edge's length that must lie on the line
STRAIGHT_PX = 0.25  # median distance from the line

# (marker or CHESSBOARD, number of the corner) → pixel [2], COLMAP's convention
Corners = dict[tuple[int, int], np.ndarray]


def detect_corners(photo: Photo, board: Board) -> Corners:
    """Find the board's corners in a photograph, with sub-pixel accuracy.

    Returns a dict from (marker's id, number of the corner) to the corner's pixel [2] in COLMAP's
    convention, where the first pixel's centre is at 0.5. For the corners of a ChArUco board, the
    number −1 (CHESSBOARD) replaces the marker's id.
    """
    tones = read_gray(photo.path)
    picture = (photo.stretch(tones) * 255).round().astype(np.uint8)
    found = _chessboard_corners(picture, board)
    if board.marker:
        # as the file has them: stretched tones are not on sRGB's curve
        found |= _marker_corners(picture, tones, board)
    # OpenCV's first pixel is centred at 0, COLMAP's at 0.5
    return {name: at + 0.5 for name, at in found.items()}


def _marker_corners(picture: np.ndarray, tones: np.ndarray, board: Board) -> Corners:
    """Find the corners of the board's single markers, as intersections of their edges.

    picture [height, width]: the photograph, uint8; tones: those of its file in 0 … 1, float32.
    Returns a dict from (marker's id, number of the corner) to array indices (column, row).
    Markers that appear twice, and corners next to unclear edges, are left out.
    """
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    found, ids, _ = cv2.aruco.ArucoDetector(board.cv_dictionary(), parameters).detectMarkers(
        picture
    )
    known = board.corners_m()
    names = list(map(int, [] if ids is None else ids.ravel()))
    return {
        (name, k): corner
        for name, quad in zip(names, found, strict=True)
        if name in known and names.count(name) == 1
        for k, corner in enumerate(_refined(tones, quad.reshape(4, 2).astype(np.float64)))
        if not np.isnan(corner).any()
    }


def _refined(tones: np.ndarray, quad: np.ndarray) -> np.ndarray:
    """Refine the corners [4, 2] of a marker, with the tones around it in linear light."""
    first = np.maximum(quad.min(axis=0) - AROUND_PX, 0).astype(int)
    last = quad.max(axis=0).astype(int) + AROUND_PX
    columns, rows = (slice(*ends) for ends in zip(first, last, strict=True))
    return first + refine_corners(to_light(tones[rows, columns]), quad - first)


def _chessboard_corners(picture: np.ndarray, board: Board) -> Corners:
    """Find the inner corners of the ChArUco board in a picture [height, width], uint8.

    Returns a dict from (−1, number of the corner) to array indices (column, row); empty if the
    board has no ChArUco part. Blur and tone curve do not shift these corners, so they need no
    refinement.
    """
    if board.charuco is None:
        return {}
    corners, ids, *_ = cv2.aruco.CharucoDetector(board.charuco.cv_board()).detectBoard(picture)
    if ids is None:
        return {}
    pixels = np.asarray(corners, np.float64).reshape(-1, 2)
    return {(CHESSBOARD, k): pixel for k, pixel in zip(map(int, ids.ravel()), pixels, strict=True)}


def require_board(seen: dict[str, Corners], board: Board) -> dict[str, Corners]:
    """Check that some corner of the board was detected in at least two photographs.

    seen: the detected corners of each photograph, by its name; returned unchanged. Raises
    HandbenchError if no corner is in two photographs.
    """
    corners = [corner for found in seen.values() for corner in found]
    if len(corners) == len(set(corners)):
        raise HandbenchError(
            f"board: its corners ({board.describe()}) were found in "
            f"{sum(map(bool, seen.values()))} of {len(seen)} photographs, and no corner in two of "
            "them; check dictionary, ids, columns, rows and legacy in the board's description, and "
            "the focus of the photographs"
        )
    return seen


def focal_length_px(views: Iterable[Corners], size: tuple[int, int], board: Board) -> float | None:
    """Estimate the focal length of a lens in pixels, to a few per cent, from views of a flat board.

    views: the detected corners of each view. size: width and height of the pictures. Returns None
    if no view shows enough corners, if the board is not flat, or if the result is implausible. A
    tilted plane determines the focal length if the principal point is at the picture's middle
    (Zhang, TPAMI 2000).
    """
    known = board.corners_m()
    shown = [view for view in views if len(view) >= FEWEST_CORNERS]
    points_m = [np.array([known[m][k] for m, k in view], dtype=np.float32) for view in shown]
    if not shown or any(np.ptp(each[:, 2]) > 0 for each in points_m):
        return None
    pixels = [np.array(list(view.values()), dtype=np.float32) for view in shown]
    focal_px = float(cv2.initCameraMatrix2D(points_m, pixels, size)[0, 0])
    low, high = PLAUSIBLE
    return focal_px if low < focal_px / max(size) < high else None


def to_light(tones: np.ndarray) -> np.ndarray:
    """Convert sRGB tones in 0 … 1 to linear light in 0 … 1 (IEC 61966-2-1), float32."""
    return np.where(tones < 0.04045, tones / 12.92, ((tones + 0.055) / 1.055) ** 2.4).astype(
        np.float32
    )


def refine_corners(light: np.ndarray, quad: np.ndarray) -> np.ndarray:
    """Refine the four corners [4, 2] of a dark square on white to sub-pixel accuracy.

    light [height, width]: picture in linear light, float32. quad [4, 2]: initial corners within
    about two pixels, as array indices (column, row), clockwise. Returns refined indices [4, 2]; a
    corner next to an edge that is covered, faint or not straight is NaN.
    """
    for reach_px in REACHES_PX:
        reach_px = min(
            reach_px, REACH * np.linalg.norm(quad - np.roll(quad, -1, axis=0), axis=1).min()
        )
        edges = [
            _edge(light, a, b, reach_px)
            for a, b in zip(quad, np.roll(quad, -1, axis=0), strict=True)
        ]
        quad = np.array([_crossing(edges[k - 1], edges[k]) for k in range(4)])
        if np.isnan(quad).any():
            break
    return quad


def _edge(
    light: np.ndarray, a: np.ndarray, b: np.ndarray, reach_px: float
) -> tuple[np.ndarray, np.ndarray] | None:
    """Fit a straight line to the edge between two approximate corners a and b [2] of a dark square.

    light: picture in linear light, bright on the left of the direction from a to b as displayed.
    reach_px: how far from the line between a and b the edge is searched. Returns a point [2] on the
    fitted line and its direction [2], or None if the edge is not clear or not straight.
    """
    length_px = np.linalg.norm(b - a)
    along = (b - a) / length_px
    across = np.array([along[1], -along[0]])
    t = np.linspace(INNER, 1 - INNER, max(8, int(length_px))) * length_px
    s = np.arange(-reach_px, reach_px + STEP_PX / 2, STEP_PX)
    at = (a + t[:, None, None] * along + s[:, None] * across).astype(np.float32)
    profile = cv2.remap(
        light, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    slope = np.clip(np.diff(profile, axis=1), 0, None)
    height = slope.sum(axis=1)
    offset = slope @ ((s[1:] + s[:-1]) / 2) / np.maximum(height, 1e-6)
    clear = on_line = height > FAINTEST * np.median(height)
    for _ in range(3):
        if on_line.sum() < CLEAR * len(t):
            return None
        along_px = t[on_line] - t[on_line].mean()
        tilt = along_px @ offset[on_line] / (along_px @ along_px)
        middle = offset[on_line].mean() - tilt * t[on_line].mean()
        distance = np.abs(offset - tilt * t - middle)
        typical = np.median(distance[on_line])
        on_line = clear & (distance <= 4 * typical + 1e-3)
    return None if typical > STRAIGHT_PX else (a + middle * across, along + tilt * across)


def _crossing(
    first: tuple[np.ndarray, np.ndarray] | None, second: tuple[np.ndarray, np.ndarray] | None
) -> np.ndarray:
    """Compute the intersection [2] of two lines, each given as a point and a direction; NaN if a
    line is None."""
    if first is None or second is None:
        return np.full(2, np.nan)
    (p, u), (q, v) = first, second
    return p + np.linalg.solve(np.stack([u, -v], axis=1), q - p)[0] * u


def crossings_of_edges(
    project: Callable[[np.ndarray], np.ndarray], square_m: np.ndarray
) -> np.ndarray:
    """Compute the pixels [4, 2] at which `refine_corners` finds the corners [4, 3] of a square.

    project: function from points [n, 3] to pixels [n, 2]. A lens bends the edges, so the straight
    lines through them meet a few hundredths of a pixel outside or inside of the corners, all of
    them away from the picture's middle or towards it.
    """
    t = np.linspace(INNER, 1 - INNER, SAMPLES)[:, None]
    edges = []
    for a, b in zip(square_m, np.roll(square_m, -1, axis=0), strict=True):
        pixels = project(a + t * (b - a))
        middle = pixels.mean(axis=0)
        edges.append((middle, np.linalg.svd(pixels - middle)[2][0]))
    return np.array([_crossing(edges[k - 1], edges[k]) for k in range(4)])
