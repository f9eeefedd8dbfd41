"""Plane sweep with normalised cross-correlation, and semi-global smoothing: a first depth for every pixel.

Collins, "A space-sweep approach to true multi-image matching", CVPR 1996; Hirschmüller, "Stereo processing by
semiglobal matching and mutual information", TPAMI 2008. Disparity here is inverse depth in steps that move a pixel by
one pixel in the source that sees it move most. Each pass is one parallel region whose iterations write to places of
their own, so that the result does not depend on the number of threads.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from groundtruth.dense.views import Stereo
from radar.support.cost import require_free

LESS = "choose a lower --quality, or fewer or smaller photographs"
WINDOW_RADIUS = 4
LARGEST_COST = 127
OUTSIDE, WORST = -1.0, 2.0
FLAT = 1e-14  # product of both windows' variances below which there is no texture
SMALL_JUMP, LARGE_JUMP = 6, 40  # P1 and P2, against costs of 0 … LARGEST_COST
PATHS: tuple[tuple[int, int], ...] = ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, -1), (1, -1), (-1, 1))


def swept_disparity(stereo: Stereo, first: float, planes: int) -> np.ndarray:
    """Disparity [h, w] float32 of the smoothed cost's minimum, to a fraction of a plane; these lie at first,
    first + 1, …"""
    h, w = stereo.reference.shape
    require_free(4 * planes * h * w, f"dense: {planes} planes of {w} × {h} pixels", LESS)
    cost = np.empty((planes, h, w), dtype=np.uint8)
    _correlate(stereo._replace(reference=stereo.reference.astype(np.float64)), first, cost)
    cost = np.ascontiguousarray(np.moveaxis(cost, 0, -1))
    total = np.zeros(cost.shape, dtype=np.uint16)
    for step in PATHS:
        _smooth(cost, total, _starts(h, w, *step), *step)
    return (first + _lowest(total)).astype(np.float32)


def _starts(h: int, w: int, step_y: int, step_x: int) -> np.ndarray:
    """Pixels [n, 2] (row, column) at which the lines of one direction enter the picture."""
    y, x = np.mgrid[:h, :w]
    before_y, before_x = y - step_y, x - step_x
    enters = (before_y < 0) | (before_y >= h) | (before_x < 0) | (before_x >= w)
    return np.argwhere(enters)


@njit(cache=True, fastmath={"contract", "arcp"})
def _warp(stereo: Stereo, s: int, disparity: float, warped: np.ndarray) -> None:
    """Source s as the reference would see it if everything lay at one disparity; OUTSIDE where it ends."""
    source, A, b = stereo.sources[s], stereo.A[s], stereo.b[s]
    rows, columns = stereo.sizes[s, 0], stereo.sizes[s, 1]
    h, w = warped.shape
    for y in range(h):
        for x in range(w):
            q = 1 / (A[2, 0] * x + A[2, 1] * y + A[2, 2] + b[2] * disparity)
            u = (A[0, 0] * x + A[0, 1] * y + A[0, 2] + b[0] * disparity) * q
            v = (A[1, 0] * x + A[1, 1] * y + A[1, 2] + b[1] * disparity) * q
            if not (q > 0 and 0 <= u < columns - 1 and 0 <= v < rows - 1):
                warped[y, x] = OUTSIDE
                continue
            i, j = int(v), int(u)
            dv, du = v - i, u - j
            top = source[i, j] + du * (source[i, j + 1] - source[i, j])
            bottom = source[i + 1, j] + du * (source[i + 1, j + 1] - source[i + 1, j])
            warped[y, x] = top + dv * (bottom - top)


@njit(cache=True)
def _add_row(first: np.ndarray, second: np.ndarray, sums: np.ndarray, sign: float) -> None:
    """Add (or take away) one row of both pictures to the columns' sums of a, a², b, b², a b."""
    for x in range(len(first)):
        a, b = first[x], second[x]
        sums[0, x] += sign * a
        sums[1, x] += sign * a * a
        sums[2, x] += sign * b
        sums[3, x] += sign * b * b
        sums[4, x] += sign * a * b


@njit(cache=True)
def _mismatch(first: np.ndarray, second: np.ndarray, mismatch: np.ndarray) -> None:
    """1 − NCC [h, w] of two pictures over square windows, by running sums in double precision; 1 where one of them has
    no texture, WORST where the second is OUTSIDE."""
    h, w = first.shape
    columns = np.zeros((5, w))
    for y in range(-WINDOW_RADIUS, h):
        if y + WINDOW_RADIUS < h:
            _add_row(first[y + WINDOW_RADIUS], second[y + WINDOW_RADIUS], columns, 1.0)
        if y - WINDOW_RADIUS > 0:
            _add_row(first[y - WINDOW_RADIUS - 1], second[y - WINDOW_RADIUS - 1], columns, -1.0)
        if y < 0:
            continue
        rows = min(y + WINDOW_RADIUS, h - 1) - max(y - WINDOW_RADIUS, 0) + 1
        a = aa = b = bb = ab = 0.0
        for x in range(-WINDOW_RADIUS, w):
            enters, leaves = x + WINDOW_RADIUS, x - WINDOW_RADIUS - 1
            if enters < w:
                a, aa, b = a + columns[0, enters], aa + columns[1, enters], b + columns[2, enters]
                bb, ab = bb + columns[3, enters], ab + columns[4, enters]
            if leaves >= 0:
                a, aa, b = a - columns[0, leaves], aa - columns[1, leaves], b - columns[2, leaves]
                bb, ab = bb - columns[3, leaves], ab - columns[4, leaves]
            if x < 0:
                continue
            n = rows * (min(enters, w - 1) - max(x - WINDOW_RADIUS, 0) + 1)
            power = max(n * aa - a * a, 0.0) * max(n * bb - b * b, 0.0)
            mismatch[y, x] = 1 - (n * ab - a * b) / np.sqrt(power) if power > FLAT * n**4 else 1.0
            if second[y, x] == OUTSIDE:
                mismatch[y, x] = WORST


@njit(parallel=True, cache=True)
def _correlate(stereo: Stereo, first: float, cost: np.ndarray) -> None:
    """cost [plane, h, w]: 1 − NCC, averaged over the better half of the sources, quantised."""
    h, w = stereo.reference.shape
    count = len(stereo.sources)
    used = max(1, count // 2)
    for plane in prange(len(cost)):
        mismatch = np.empty((count, h, w))
        warped = np.empty((h, w))
        for s in range(count):
            _warp(stereo, s, first + plane, warped)
            _mismatch(stereo.reference, warped, mismatch[s])
        values = np.empty(count)
        for y in range(h):
            for x in range(w):
                for s in range(count):
                    place = s
                    while place > 0 and mismatch[s, y, x] < values[place - 1]:
                        values[place] = values[place - 1]
                        place -= 1
                    values[place] = mismatch[s, y, x]
                mean = 0.0
                for n in range(used):
                    mean += values[n]
                cost[plane, y, x] = np.uint8(min(mean / used, 1.0) * LARGEST_COST)


@njit(parallel=True, cache=True)
def _smooth(cost: np.ndarray, total: np.ndarray, starts: np.ndarray, step_y: int, step_x: int) -> None:
    """Add the smoothed cost along one direction to `total`; each line is one parallel iteration."""
    h, w, planes = cost.shape
    for line in prange(len(starts)):
        y, x = starts[line]
        previous = np.zeros(planes + 2, dtype=np.int32)
        current = np.zeros(planes + 2, dtype=np.int32)
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
    """Plane [h, w] of the smallest cost, moved to the vertex of the parabola through its neighbours."""
    place = total.argmin(axis=-1)
    inner = np.clip(place, 1, total.shape[-1] - 2)
    left, here, right = (np.take_along_axis(total, inner[..., None] + k, -1)[..., 0].astype(float) for k in (-1, 0, 1))
    bend = left - 2 * here + right
    return place + np.where((place == inner) & (bend > 0), 0.5 * (left - right) / np.maximum(bend, 1), 0)
