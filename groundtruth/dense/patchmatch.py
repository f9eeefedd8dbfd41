"""PatchMatch multi-view stereo with slanted, then curved windows.

Bleyer, Rhemann & Rother, "PatchMatch Stereo", BMVC 2011; bilaterally weighted NCC after Schönberger
et al., "Pixelwise view selection for unstructured multi-view stereo", ECCV 2016.

The hypothesis at a pixel is a plane [3]: disparity δ (inverse depth in steps of about one source
pixel) and its slope per column and per row. Threads share nothing that they write, so the result
does not depend on their number.
"""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from handbench.groundtruth.dense.views import Stereo
from handbench.support.compiled import FAST, INNER, njit
from handbench.support.parallel import for_each

# of a window of 7 × 7 pixels; larger ones flatten curved surfaces, and put a finger too far away
RADIUS = 3
SIGMA_GRAY = 0.08  # of the bilateral weights
SIGMA_PX = 3.0  # of the bilateral weights
# Every second pixel of the window is compared, as on the white squares of a chessboard: depths are
# 6 % closer than with all pixels of every second row (measured).
CHESSBOARD = np.indices((2 * RADIUS + 1, 2 * RADIUS + 1)).sum(axis=0) % 2 == 0
ROW, COLUMN = (places.astype(np.float32) - RADIUS for places in np.nonzero(CHESSBOARD))
NEARNESS = np.exp(-(ROW**2 + COLUMN**2) / (2 * SIGMA_PX**2))
SAMPLES = len(NEARNESS)
# mean square distance of the window's pixels along an axis
FLATTENED_PX2 = float((NEARNESS * ROW**2).sum() / NEARNESS.sum())
DIRECTIONS = ((-1, 0), (1, 0), (0, -1), (0, 1))
# of neighbours in a direction, of which the best matched one counts; odd: on the other colour of a
# chessboard, so that no thread reads what another one writes
DISTANCES_PX = (1, 3)
VARIATIONS = (1.0, 0.4)  # of the disparity, as parts of the largest one
TILT = 0.3  # variation of a slope, as a part of that of the disparity; the largest one
SIDE = 0.25  # pixels from a disparity to the two others of its parabola
# of the neighbours that smooth a pixel's plane, every second one: standard deviation of their
# weights, and the farthest
SMOOTHED_PX = 3.0
SMOOTHED_REACH = 8
WEIGHTS = np.exp(-((np.arange(SMOOTHED_REACH + 1) / SMOOTHED_PX) ** 2) / 2)
ALL_WEIGHTS = (2 * WEIGHTS[::2].sum() - 1) ** 2
SINGULAR = 1e-5  # pixels², added to the variances of the neighbours' places
APART_PX = 1.0  # of disparity, between a pixel and a neighbour on another surface
MOST_BENT = 0.3  # disparities per pixel²
UNMATCHED = 0.6  # cost from which a plane does not count
WORST = 2.0  # mismatch in a source that does not show the pixel
ROWS = 16  # of a picture that a thread matches at once

# column, row; values about their mean, weights, scratch; variance
Window = tuple[int, int, np.ndarray, np.ndarray, np.ndarray, np.float32]
Triple = tuple[float, float, float]


def refine(
    stereo: Stereo,
    planes: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    reaches: Sequence[float],
    seed: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Improve each pixel's plane by PatchMatch, with an iteration for each of `reaches`: the
    largest random variation of the disparity.

    The planes are then smoothed along the surface, freed from the bias of flat windows, and moved
    to the nearest cost minimum with curved ones.

    planes [3, h, w] float32: disparity, slope per column and slope per row. low, high [h, w]: range
    of allowed disparities, NaN for pixels to leave out. seed: of the random variations. Returns the
    planes; the matching cost [h, w], 1 − NCC, averaged over the better half of the source views;
    and the share [h, w] of each pixel's neighbours that are on its surface.
    """
    draws = np.random.default_rng(seed)
    stereo = stereo._replace(reference=np.pad(stereo.reference, RADIUS, "edge"))
    wanted = low <= high
    flat = np.zeros_like(planes)
    planes, cost = planes.copy(), np.where(wanted, np.float32(0), np.float32(WORST))
    for step, reach in enumerate(reaches):
        if step == 0 or reach > 1:  # later, planes hardly move
            cost, views = _best_sources(stereo, planes, flat, wanted)
        changes = _changes(planes.shape, reach, draws)
        for colour in (0, 1):
            _by_rows(
                len(cost),
                partial(_improve, stereo, planes, cost, views, low, high, changes, colour),
            )
    matched = cost < UNMATCHED
    planes, bends, support = smoothed(planes, matched)
    planes[0] -= (bends[0] + bends[2]) * np.float32(FLATTENED_PX2 / 2)
    here, views = _best_sources(stereo, planes, bends, matched)
    side = np.zeros_like(planes)
    side[0] = SIDE
    left, right = (
        mismatches(stereo, moved, bends, views, matched).mean(axis=0)
        for moved in (planes - side, planes + side)
    )
    opening = left - 2 * here + right
    vertex = np.clip(0.5 * (left - right) / np.where(opening > 0, opening, np.inf), -1, 1)
    planes[0] += SIDE * vertex
    return planes, here, support


def _best_sources(
    stereo: Stereo, planes: np.ndarray, bends: np.ndarray, wanted: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Choose the better half of the source views for each pixel's paraboloid. Returns the mean of
    their mismatches [h, w] and their numbers [n, h, w]."""
    count = len(stereo.sources)
    every = np.empty((count, *wanted.shape), np.int8)
    every[:] = np.arange(count)[:, None, None]
    mismatch = mismatches(stereo, planes, bends, every, wanted)
    best = mismatch.argsort(axis=0, kind="stable")[: max(1, count // 2)]
    return np.take_along_axis(mismatch, best, 0).mean(axis=0), best.astype(np.int8)


def _changes(shape: tuple[int, ...], reach: float, draws: np.random.Generator) -> np.ndarray:
    """Draw random changes [n, 3, h, w] of planes, of the disparity by up to `reach`."""
    tilt = TILT * min(reach, 1)
    most = np.multiply.outer(VARIATIONS, [reach, tilt, tilt]).astype(np.float32)
    changes = draws.random((len(VARIATIONS), *shape), np.float32)
    changes -= 0.5  # in place: a large picture has no room for two
    changes *= 2 * most[..., None, None]
    return changes


def smoothed(planes: np.ndarray, matched: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Smooth the planes [3, h, w] (disparity and its slopes) of a curved surface, and compute the
    second derivatives [3, h, w] of the disparity (per column², per column and row, per row²) and
    the share [h, w] of each pixel's neighbours that are on its surface.

    matched [h, w]: True at pixels whose plane counts. The derivatives curve the matching window to
    a paraboloid. A flat window on a convex surface gives a depth that is too large in its middle,
    by half the curvature times the window's mean square: some hundredths of a millimetre on a
    finger.

    Slopes and derivatives are those of a weighted linear regression over the slopes of the
    neighbours on the same surface (Fan & Gijbels 1996); the disparity is the mean of what these
    paraboloids predict. Unlike the gradient of blurred slopes they are right up to a surface's
    border. A paraboloid is returned as it is.
    """
    sums = np.zeros((*matched.shape, 3, 6), np.float32)
    _by_rows(len(sums), lambda rows: _sum_neighbours(planes, matched, rows, sums))
    sums = sums[matched].astype(float)
    n, places, slopes = sums[:, 0, 0], sums[..., :3], sums[..., 3:5]
    regular = places + SINGULAR * n[:, None, None] * np.diag([0, 1, 1])
    second = np.linalg.solve(regular, slopes)[:, 1:]
    second = np.clip((second + second.swapaxes(1, 2)) / 2, -MOST_BENT, MOST_BENT)
    rise = sums[:, 0, 5] - sums[:, 1, 3] - sums[:, 2, 4]
    rise += (second * places[:, 1:, 1:]).sum(axis=(1, 2)) / 2
    slope = slopes[:, 0] - (second @ places[:, 1:, :1])[..., 0]
    smooth, bends = planes.copy(), np.zeros_like(planes)
    support = np.zeros(matched.shape, np.float32)
    smooth[0, matched] += rise / n
    smooth[1:, matched] = (slope / n[:, None]).T
    bends[:, matched] = second[:, [0, 0, 1], [0, 1, 1]].T
    support[matched] = n / ALL_WEIGHTS
    return smooth, bends, support


def mismatches(
    stereo: Stereo, planes: np.ndarray, bends: np.ndarray, views: np.ndarray, wanted: np.ndarray
) -> np.ndarray:
    """Compute 1 − NCC [n, h, w] of each pixel's plane in n source views; 2 (WORST) at pixels where
    the mask `wanted` [h, w] is False.

    stereo: with the reference padded by RADIUS. planes [3, h, w]. bends [3, h, w]:
    second derivatives of the disparity (per column², per column and row, per row²), which turn the
    planes into paraboloids. views [n, h, w]: numbers of the source views.
    """
    mismatch = np.full(views.shape, np.float32(WORST))
    _by_rows(len(wanted), lambda rows: _match(stereo, planes, bends, views, wanted, rows, mismatch))
    return mismatch


def _by_rows(height: int, function: Callable[[np.ndarray], None]) -> None:
    """Call a function in several threads with the numbers of some of a picture's rows each."""
    for_each(function, np.array_split(np.arange(height), height // ROWS + 1))


@njit(**FAST)
def _sum_neighbours(
    planes: np.ndarray, matched: np.ndarray, rows: np.ndarray, sums: np.ndarray
) -> None:
    """Sum the weighted products of 1, dx, dy with 1, dx, dy, both slopes and the rise of the
    disparity, over each pixel's neighbours on its surface, into sums [h, w, 3, 6]."""
    h, w = matched.shape
    terms = np.ones(6, np.float32)
    for y in rows:
        for x in range(w):
            if not matched[y, x]:
                continue
            for dy in range(-SMOOTHED_REACH, SMOOTHED_REACH + 1, 2):
                for dx in range(-SMOOTHED_REACH, SMOOTHED_REACH + 1, 2):
                    i, j = y + dy, x + dx
                    if not (0 <= i < h and 0 <= j < w and matched[i, j]):
                        continue
                    u, v = planes[1, i, j], planes[2, i, j]
                    rise = planes[0, i, j] - planes[0, y, x]
                    mean_rise = (dx * (planes[1, y, x] + u) + dy * (planes[2, y, x] + v)) / 2
                    if abs(rise - mean_rise) > APART_PX:
                        continue
                    terms[1], terms[2], terms[3], terms[4], terms[5] = dx, dy, u, v, rise
                    weight = WEIGHTS[abs(dx)] * WEIGHTS[abs(dy)]
                    for a in range(3):
                        for b in range(6):
                            sums[y, x, a, b] += weight * terms[a] * terms[b]


@njit(**FAST)
def _match(
    stereo: Stereo,
    planes: np.ndarray,
    bends: np.ndarray,
    views: np.ndarray,
    wanted: np.ndarray,
    rows: np.ndarray,
    mismatch: np.ndarray,
) -> None:
    """Do what `mismatches` does, in some rows of the picture."""
    scratch = np.empty((8, SAMPLES), np.float32)
    for y in rows:
        for x in range(wanted.shape[1]):
            if not wanted[y, x]:
                continue
            window = _window(stereo.reference, y, x, scratch)
            bend = (float(bends[0, y, x]), float(bends[1, y, x]), float(bends[2, y, x]))
            plane = (float(planes[0, y, x]), float(planes[1, y, x]), float(planes[2, y, x]))
            for n in range(len(views)):
                mismatch[n, y, x] = _mismatch(window, stereo, views[n, y, x], plane, bend)


@njit(**FAST)
def _improve(
    stereo: Stereo,
    planes: np.ndarray,
    cost: np.ndarray,
    views: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    changes: np.ndarray,
    colour: int,
    rows: np.ndarray,
) -> None:
    """Try, at the pixels of one colour of a chessboard in some rows, the continued planes of
    neighbours, which have the other colour, and then changes of the best plane."""
    scratch = np.empty((8, SAMPLES), np.float32)
    h, w = cost.shape
    for y in rows:
        for x in range((y + colour) % 2, w, 2):
            if not low[y, x] <= high[y, x]:
                continue
            window = _window(stereo.reference, y, x, scratch)
            best = cost[y, x]
            for k in range(len(DIRECTIONS) + len(changes)):
                if k < len(DIRECTIONS):
                    least, i, j = np.float32(WORST), y, x
                    for distance in DISTANCES_PX:
                        from_y = y + distance * DIRECTIONS[k][0]
                        from_x = x + distance * DIRECTIONS[k][1]
                        if 0 <= from_y < h and 0 <= from_x < w and cost[from_y, from_x] < least:
                            least, i, j = cost[from_y, from_x], from_y, from_x
                    if least == WORST:
                        continue
                    slope_x, slope_y = planes[1, i, j], planes[2, i, j]
                    disparity = planes[0, i, j] + (x - j) * slope_x + (y - i) * slope_y
                else:
                    change = changes[k - len(DIRECTIONS), :, y, x]
                    disparity = planes[0, y, x] + change[0]
                    slope_x, slope_y = planes[1, y, x] + change[1], planes[2, y, x] + change[2]
                disparity = min(max(disparity, low[y, x]), high[y, x])
                plane = (float(disparity), float(slope_x), float(slope_y))
                tried = 0.0
                for n in range(len(views)):
                    if tried <= len(views) * best:
                        tried += _mismatch(window, stereo, views[n, y, x], plane, (0.0, 0.0, 0.0))
                if tried < len(views) * best:
                    best = np.float32(tried / len(views))
                    planes[0, y, x], planes[1, y, x], planes[2, y, x] = disparity, slope_x, slope_y
            cost[y, x] = best


@njit(**INNER)
def _window(reference: np.ndarray, y: int, x: int, scratch: np.ndarray) -> Window:
    """Extract the matching window around pixel (x, y) of the reference picture, which is padded at
    its border.

    scratch [8, SAMPLES]: receives what is returned. Returns column, row, gray values minus their
    weighted mean, bilateral weights with sum 1, the array for places in a source view and its
    values around them, and the weighted variance of the values.
    """
    values, weights, places = scratch[0], scratch[1], scratch[2:]
    centre = reference[y + RADIUS, x + RADIUS]
    total = mean = variance = np.float32(0)
    for k in range(SAMPLES):
        values[k] = reference[y + RADIUS + int(ROW[k]), x + RADIUS + int(COLUMN[k])] - centre
    for k in range(SAMPLES):
        scaled = abs(values[k]) * np.float32(1 / (64 * SIGMA_GRAY))
        similarity = max(np.float32(1) - scaled, np.float32(0))
        for _ in range(6):
            # exp(−|value| / SIGMA_GRAY) ≈ (1 − |value| / (64 SIGMA_GRAY))⁶⁴
            similarity *= similarity
        weights[k] = similarity * NEARNESS[k]
        total += weights[k]
    for k in range(SAMPLES):
        weights[k] /= total
        mean += weights[k] * values[k]
    for k in range(SAMPLES):
        values[k] -= mean
        variance += weights[k] * values[k] * values[k]
    return x, y, values, weights, places, variance


@njit(**INNER)
def _mismatch(window: Window, stereo: Stereo, s: int, plane: Triple, bend: Triple) -> float:
    """Compute 1 − NCC between a window of the reference and source view number s, if the surface is
    the given paraboloid; 2 (WORST) if the source view does not show its middle.

    plane: disparity and its slopes per column and row. bend: second derivatives of the disparity
    (per column², per column and row, per row²).
    """
    x, y, values, weights, places, variance = window
    picture, A, b = stereo.sources[s], stereo.A[s], stereo.b[s]
    disparity, slope_x, slope_y = plane
    # the source shows the pixel's middle at (u, v) / q
    u = np.float32(A[0, 0] * x + A[0, 1] * y + A[0, 2] + b[0] * disparity)
    v = np.float32(A[1, 0] * x + A[1, 1] * y + A[1, 2] + b[1] * disparity)
    q = np.float32(A[2, 0] * x + A[2, 1] * y + A[2, 2] + b[2] * disparity)
    most_u = np.float32(stereo.sizes[s, 1] - 1.01)
    most_v = np.float32(stereo.sizes[s, 0] - 1.01)
    if not (q > 0 and 0 <= u <= most_u * q and 0 <= v <= most_v * q):
        return WORST
    ux, uy = np.float32(A[0, 0] + b[0] * slope_x), np.float32(A[0, 1] + b[0] * slope_y)
    vx, vy = np.float32(A[1, 0] + b[1] * slope_x), np.float32(A[1, 1] + b[1] * slope_y)
    qx, qy = np.float32(A[2, 0] + b[2] * slope_x), np.float32(A[2, 1] + b[2] * slope_y)
    rise_u, rise_v, rise_q = np.float32(b[0]), np.float32(b[1]), np.float32(b[2])
    xx, xy, yy = np.float32(0.5 * bend[0]), np.float32(bend[1]), np.float32(0.5 * bend[2])
    origin = picture[int(v / q), int(u / q)]  # sums about a value nearby do not cancel
    mean = square = product = np.float32(0)
    for k in range(SAMPLES):
        dx, dy = COLUMN[k], ROW[k]
        rise = xx * dx * dx + yy * dy * dy + xy * dx * dy
        scale = np.float32(1) / (q + dx * qx + dy * qy + rise * rise_q)
        su = (u + dx * ux + dy * uy + rise * rise_u) * scale
        sv = (v + dx * vx + dy * vy + rise * rise_v) * scale
        places[0, k] = min(max(su, np.float32(0)), most_u)
        places[1, k] = min(max(sv, np.float32(0)), most_v)
    for k in range(SAMPLES):
        # unsigned: no check for negative indices
        i, j = np.uint32(np.int32(places[1, k])), np.uint32(np.int32(places[0, k]))
        places[2, k], places[3, k] = picture[i, j], picture[i, j + 1]
        places[4, k], places[5, k] = picture[i + 1, j], picture[i + 1, j + 1]
    for k in range(SAMPLES):
        fu = places[0, k] - np.float32(np.int32(places[0, k]))
        fv = places[1, k] - np.float32(np.int32(places[1, k]))
        top = places[2, k] + fu * (places[3, k] - places[2, k])
        bottom = places[4, k] + fu * (places[5, k] - places[4, k])
        value = top + fv * (bottom - top) - origin
        weighted = weights[k] * value
        mean += weighted
        square += weighted * value
        product += weighted * values[k]
    power = variance * max(square - mean * mean, np.float32(0))
    if power < 1e-14:
        return 1.0
    return 1.0 - product / np.sqrt(power)
