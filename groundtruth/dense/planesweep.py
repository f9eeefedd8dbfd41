"""Initial depth of every pixel: plane sweep with normalised cross-correlation (NCC), and
semi-global smoothing.

Collins, "A space-sweep approach to true multi-image matching", CVPR 1996; Hirschmüller, "Stereo
processing by semiglobal matching and mutual information", TPAMI 2008. Disparity here means inverse
depth, in steps that move a pixel by one pixel in the source picture where it moves most. Threads
never write to the same array elements, so the result does not depend on their number.
"""

from functools import partial

import cv2
import numpy as np

from handbench.groundtruth.dense.views import Stereo
from handbench.support.compiled import njit
from handbench.support.cost import require_memory
from handbench.support.parallel import for_each

# advice on depth maps that do not fit into memory
LESS = "choose a lower --quality, or fewer or smaller photographs"
WINDOW_RADIUS = 4
LARGEST_COST = 127
LINES = 32  # that one thread smooths along
OUTSIDE, WORST = -1.0, 2.0
FLAT = 1e-14  # product of both windows' variances below which there is no texture
SMALL_JUMP, LARGE_JUMP = 6, 40  # P1 and P2, against costs of 0 … LARGEST_COST
PATHS: tuple[tuple[int, int], ...] = (
    (1, 0),
    (-1, 0),
    (0, 1),
    (0, -1),
    (1, 1),
    (-1, -1),
    (1, -1),
    (-1, 1),
)


def swept_disparity(stereo: Stereo, first: float, planes: int) -> np.ndarray:
    """Compute a disparity map [h, w] float32 by plane sweep and semi-global smoothing.

    The swept disparities are first, first + 1, …, first + planes − 1. The result minimises the
    smoothed matching cost, interpolated between planes. Raises HandbenchError if the costs of all
    pixels and planes do not fit into memory.
    """
    h, w = stereo.reference.shape
    require_memory(4 * planes * h * w, f"dense: {planes} planes of {w} × {h} pixels", LESS)
    cost = np.empty((planes, h, w), dtype=np.uint8)
    tone = stereo.reference.mean()  # sums about it do not cancel in single precision
    stereo = stereo._replace(reference=stereo.reference - tone, sources=stereo.sources - tone)
    moments = _moments(stereo.reference)
    for_each(
        lambda plane: _correlate(stereo, moments, float(first) + plane, cost[plane]), range(planes)
    )
    cost = np.ascontiguousarray(np.moveaxis(cost, 0, -1))
    total = np.zeros(cost.shape, dtype=np.uint16)
    for step in PATHS:
        starts = _starts(h, w, *step)
        for_each(
            partial(_smooth, cost, total, *step), np.array_split(starts, len(starts) // LINES + 1)
        )
    return (first + _lowest(total)).astype(np.float32)


def _moments(picture: np.ndarray) -> np.ndarray:
    """Compute the sums of a picture a [h, w] over the square window around each pixel.

    Returns [3, h, w] float32: the number n of the window's pixels inside the picture, Σa, and n Σa²
    − (Σa)².
    """
    sides = (2 * WINDOW_RADIUS + 1, 2 * WINDOW_RADIUS + 1)
    parts = (np.ones_like(picture), picture, picture**2)
    n, a, aa = (
        cv2.boxFilter(p, cv2.CV_64F, sides, normalize=False, borderType=cv2.BORDER_CONSTANT)
        for p in parts
    )
    return np.stack([n, a, np.maximum(n * aa - a * a, 0)]).astype(np.float32)


def _starts(h: int, w: int, step_y: int, step_x: int) -> np.ndarray:
    """List the border pixels [n, 2] (row, column) of a picture of h × w pixels at which lines with
    the step (step_y, step_x) start."""
    y, x = np.mgrid[:h, :w]
    before_y, before_x = y - step_y, x - step_x
    enters = (before_y < 0) | (before_y >= h) | (before_x < 0) | (before_x >= w)
    return np.ascontiguousarray(np.argwhere(enters))


@njit(forceinline=True, error_model="numpy", fastmath={"contract", "arcp"})
def _warp(
    stereo: Stereo, s: int, disparity: float, y: int, places: np.ndarray, warped: np.ndarray
) -> None:
    """Warp source view number s to row y of the reference, as if the surface were at this
    disparity.

    Writes the source view's gray values into `warped` [w], and −1 (OUTSIDE) where it does not show
    the pixel. places [2, w]: scratch for columns and rows; their separate loop is compiled to
    vector instructions.
    """
    sources, A, b = stereo.sources, stereo.A, stereo.b
    rows, columns = np.float32(stereo.sizes[s, 0] - 1), np.float32(stereo.sizes[s, 1] - 1)
    q0 = np.float32(A[s, 2, 1] * y + A[s, 2, 2] + b[s, 2] * disparity)
    u0 = np.float32(A[s, 0, 1] * y + A[s, 0, 2] + b[s, 0] * disparity)
    v0 = np.float32(A[s, 1, 1] * y + A[s, 1, 2] + b[s, 1] * disparity)
    qx, ux, vx = np.float32(A[s, 2, 0]), np.float32(A[s, 0, 0]), np.float32(A[s, 1, 0])
    for x in range(len(warped)):
        q = np.float32(1) / (qx * np.float32(x) + q0)
        u, v = (ux * np.float32(x) + u0) * q, (vx * np.float32(x) + v0) * q
        inside = (q > 0) & (u >= 0) & (u < columns) & (v >= 0) & (v < rows)
        places[0, x], places[1, x] = u, v if inside else np.float32(OUTSIDE)
    for x in range(len(warped)):
        u, v = places[0, x], places[1, x]
        if v == np.float32(OUTSIDE):
            warped[x] = OUTSIDE
            continue
        i, j = np.uint32(np.int32(v)), np.uint32(np.int32(u))
        dv, du = v - np.float32(np.int32(v)), u - np.float32(np.int32(u))
        top = sources[s, i, j] + du * (sources[s, i, j + 1] - sources[s, i, j])
        bottom = sources[s, i + 1, j] + du * (sources[s, i + 1, j + 1] - sources[s, i + 1, j])
        warped[x] = top + dv * (bottom - top)


@njit(forceinline=True)
def _across(columns: np.ndarray, sums: np.ndarray) -> None:
    """Sum over the square windows along a row: add the column sums under the window around each
    pixel, and write the totals into `sums` [w].

    columns [w + 2 r]: sums over the windows' columns, 0 beyond the picture, for windows of 2 r + 1
    pixels (r = WINDOW_RADIUS).
    """
    for x in range(len(sums)):
        total = columns[x]
        for k in range(1, 2 * WINDOW_RADIUS + 1):
            total += columns[x + k]
        sums[x] = total


@njit(forceinline=True, error_model="numpy", fastmath={"contract", "arcp"})
def _mismatch(
    first: np.ndarray, moments: np.ndarray, second: np.ndarray, mismatch: np.ndarray
) -> None:
    """Compute 1 − NCC of two pictures [h, w] over square windows, and write it into `mismatch` [h,
    w].

    The value is 1 where one picture has no texture, and 2 (WORST) where the second picture is −1
    (OUTSIDE). moments [3, h, w]: for the window around each pixel of the first picture a, the
    number of pixels n, Σa, and n Σa² − (Σa)².
    """
    h, w = first.shape
    columns = np.zeros((3, w + 2 * WINDOW_RADIUS), np.float32)  # of b, b² and a b
    inner = columns[:, WINDOW_RADIUS : w + WINDOW_RADIUS]
    sums = np.empty((3, w), np.float32)
    for y in range(-WINDOW_RADIUS, h):
        enters, leaves = y + WINDOW_RADIUS, y - WINDOW_RADIUS - 1
        if enters < h:
            _add_row(first[enters], second[enters], inner, np.float32(1))
        if leaves >= 0:
            _add_row(first[leaves], second[leaves], inner, np.float32(-1))
        if y < 0:
            continue
        for m in range(3):
            _across(columns[m], sums[m])
        for x in range(w):
            n, a, aa = moments[0, y, x], moments[1, y, x], moments[2, y, x]
            b, bb, ab = sums[0, x], sums[1, x], sums[2, x]
            power = aa * max(n * bb - b * b, np.float32(0))
            textured = power > np.float32(FLAT) * n * n * n * n
            ncc = (n * ab - a * b) / np.sqrt(power if textured else np.float32(1))
            value = np.float32(1) - (ncc if textured else np.float32(0))
            mismatch[y, x] = np.float32(WORST) if second[y, x] == np.float32(OUTSIDE) else value


@njit(forceinline=True)
def _add_row(first: np.ndarray, second: np.ndarray, sums: np.ndarray, sign: np.float32) -> None:
    """Add one row of two pictures a and b to running column sums [3, w] of b, b² and a b, in place.
    sign: 1 adds the row, −1 subtracts it."""
    for x in range(len(first)):
        a, b = first[x], second[x]
        sums[0, x] += sign * b
        sums[1, x] += sign * b * b
        sums[2, x] += sign * a * b


@njit(nogil=True, cache=True)
def _correlate(stereo: Stereo, moments: np.ndarray, disparity: float, cost: np.ndarray) -> None:
    """Compute the matching cost of the plane at one disparity, and write it into `cost` [h, w]
    uint8.

    The cost is 1 − NCC, averaged over the better half of the source views, multiplied by 127
    (LARGEST_COST) and limited to it. moments [3, h, w]: for the window around each pixel of the
    reference a, the number of pixels n, Σa, and n Σa² − (Σa)².
    """
    h, w = stereo.reference.shape
    count = len(stereo.sources)
    used = max(1, count // 2)
    scale = np.float32(LARGEST_COST / used)
    least = np.full((used, h, w), np.float32(WORST))
    warped, mismatch = np.empty((h, w), np.float32), np.empty((h, w), np.float32)
    places = np.empty((2, w), np.float32)
    for s in range(count):
        for y in range(h):
            _warp(stereo, s, disparity, y, places, warped[y])
        _mismatch(stereo.reference, moments, warped, mismatch)
        for n in range(used):
            _keep_less(least[n], mismatch)
    for y in range(h):
        for x in range(w):
            total = np.float32(0)
            for n in range(used):
                total += least[n, y, x]
            cost[y, x] = np.uint8(min(total * scale, np.float32(LARGEST_COST)))


@njit(forceinline=True)
def _keep_less(least: np.ndarray, other: np.ndarray) -> None:
    """Sort two pictures [h, w] pixel by pixel, in place: `least` gets the smaller value and `other`
    the larger one."""
    h, w = least.shape
    for y in range(h):
        for x in range(w):
            a, b = least[y, x], other[y, x]
            least[y, x], other[y, x] = min(a, b), max(a, b)


@njit(nogil=True, cache=True)
def _smooth(
    cost: np.ndarray, total: np.ndarray, step_y: int, step_x: int, starts: np.ndarray
) -> None:
    """Add to `total` [h, w, planes] the path costs of semi-global matching in one direction.

    cost [h, w, planes]: matching costs. (step_y, step_x): the direction. starts [n, 2]: pixels
    (row, column) at which the lines begin.
    """
    h, w, planes = cost.shape
    previous, current = np.empty(planes + 2, dtype=np.int32), np.empty(planes + 2, dtype=np.int32)
    for y, x in starts:
        previous[:] = 0
        lowest = np.int32(0)
        while 0 <= y < h and 0 <= x < w:
            previous[0] = previous[planes + 1] = 1 << 20
            least = np.int32(1 << 20)
            for d in range(planes):
                jump = min(previous[d], previous[d + 2]) + np.int32(SMALL_JUMP)
                best = min(min(previous[d + 1], jump), lowest + np.int32(LARGE_JUMP))
                path = np.int32(cost[y, x, d]) + best - lowest
                current[d + 1] = path
                least = min(least, path)
                total[y, x, d] += np.uint16(path)
            lowest = least
            previous, current = current, previous
            y += step_y
            x += step_x


def _lowest(total: np.ndarray) -> np.ndarray:
    """Find the plane with the smallest total cost at each pixel, as a fractional index [h, w]: the
    vertex of the parabola through the lowest cost and its two neighbours.

    total [h, w, planes]: smoothed costs.
    """
    place = total.argmin(axis=-1)
    inner = np.clip(place, 1, total.shape[-1] - 2)
    left, here, right = (
        np.take_along_axis(total, inner[..., None] + k, -1)[..., 0].astype(float)
        for k in (-1, 0, 1)
    )
    bend = left - 2 * here + right
    return place + np.where(
        (place == inner) & (bend > 0), 0.5 * (left - right) / np.maximum(bend, 1), 0
    )
