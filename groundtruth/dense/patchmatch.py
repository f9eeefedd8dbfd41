"""PatchMatch multi-view stereo with slanted windows.

Bleyer, Rhemann & Rother, "PatchMatch Stereo", BMVC 2011; red-black order after Galliani, Lasinger &
Schindler, "Massively parallel multiview stereopsis by surface normal diffusion", ICCV 2015;
bilaterally weighted NCC after Schönberger et al., "Pixelwise view selection for unstructured
multi-view stereo", ECCV 2016.

The hypothesis at a pixel is a plane: disparity δ (inverse depth in steps of about one source pixel)
and its slope per column and per row. The pixels form a chessboard of two colours: those of one
colour read only those of the other, and random numbers are a hash of the pixel's index. So the
result does not depend on the number of threads.
"""

import cv2
import numpy as np

from handbench.groundtruth.dense.views import Stereo
from handbench.support.compiled import njit, prange

# of a window of 7 × 7 pixels; larger ones flatten curved surfaces, and put a finger too far away
RADIUS = 3
SIGMA_GRAY, SIGMA_PX = 0.08, 3.0  # bilateral weights
# Every second row of the window is compared: all rows cost twice as much and match no better. A row
# is filled up with a pixel of no weight to eight floats, a vector.
ROW, COLUMN = (
    places.ravel().astype(np.float32)
    for places in np.meshgrid((-3, -1, 1, 3), (*range(-RADIUS, RADIUS + 1), 0), indexing="ij")
)
NEARNESS = np.exp(-(ROW**2 + COLUMN**2) / (2 * SIGMA_PX**2))
NEARNESS[2 * RADIUS + 1 :: 2 * RADIUS + 2] = 0
SAMPLES = len(NEARNESS)
# mean square distance of the window's pixels along a row and along a column
FLATTENED_PX2 = [float((NEARNESS * axis**2).sum() / NEARNESS.sum()) for axis in (COLUMN, ROW)]
DIRECTIONS = np.array([(-1, 0), (1, 0), (0, -1), (0, 1)])
SIDE = 0.25  # pixels from a disparity to the two others of its parabola
REACH = 5  # neighbours at distances 1, 3, 5 are of the other colour
PERTURBATIONS = 3
# of the neighbours that smooth a pixel's plane, every second one: standard deviation of their
# weights, and the farthest
SMOOTHED_PX, SMOOTHED_REACH = 3.0, 8
WEIGHTS = np.exp(-((np.arange(SMOOTHED_REACH + 1) / SMOOTHED_PX) ** 2) / 2)
ALL_WEIGHTS = (2 * WEIGHTS[::2].sum() - 1) ** 2
SINGULAR = 1e-5  # pixels², added to the variances of the neighbours' places
APART_PX = 1.0  # of disparity, between a pixel and a neighbour on another surface
MOST_BENT = 0.3  # disparities per pixel²
WORST = 2.0  # a hypothesis that a source does not see
# cost of a plane to begin with; share of a pixel's neighbours that must have such a one
HOPEFUL, SHARE = (0.4, 0.02)
UNMATCHED = 0.6  # cost from which a plane is not polished

# column, row; values about their mean, weights, variance
Window = tuple[int, int, np.ndarray, np.ndarray, np.float32]
Triple = tuple[float, float, float]


def refine(
    stereo: Stereo,
    planes: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    iterations: int,
    seed: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Improve each pixel's plane by PatchMatch, in place. Returns the matching cost [h, w] float32,
    1 − NCC, averaged over the better half of the source views, and the share [h, w] of each pixel's
    neighbours that are on its surface.

    planes [h, w, 3] float32: disparity, slope per column and slope per row. low, high [h, w]: range
    of allowed disparities, NaN for pixels to leave out. iterations: number of PatchMatch
    iterations; with 0, the planes are only evaluated and moved to the nearest cost minimum. seed:
    of the random variations.

    The planes are then smoothed along the surface, freed from the bias of PatchMatch's flat
    windows, and polished with curved ones.

    After the first evaluation, pixels without well-matched neighbours are skipped: most of them
    show background, which matches at no allowed disparity.
    """
    cost = np.full(stereo.reference.shape, WORST, dtype=np.float32)
    sides = (RADIUS, RADIUS, RADIUS, RADIUS)
    stereo = stereo._replace(
        reference=cv2.copyMakeBorder(stereo.reference, *sides, cv2.BORDER_REPLICATE)
    )
    for iteration in range(iterations + 1):  # the first only evaluates what is there
        matching = cv2.blur((cost < HOPEFUL).astype(np.float32), (2 * REACH + 1, 2 * REACH + 1))
        lowest = np.where(matching > SHARE, low, np.nan) if iteration else low
        for colour in (0, 1):
            _pass(stereo, planes, cost, lowest, high, 2 * iteration + colour, seed)
    matched = cost < UNMATCHED
    planes[:], bends, support = smoothed(planes, matched)
    if iterations:
        planes[..., 0] -= bends[..., ::2] @ FLATTENED_PX2 / 2
    _polish(stereo, planes, cost, matched, bends)
    return cost, support


@njit(forceinline=True)
def _clipped(bend: float) -> float:
    return min(max(bend, -MOST_BENT), MOST_BENT)


@njit(parallel=True, cache=True, error_model="numpy")
def smoothed(planes: np.ndarray, matched: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Smooth the planes [h, w, 3] (disparity and its slopes) of a curved surface, and compute the
    second derivatives [h, w, 3] of the disparity (per column², per column and row, per row²) and
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
    h, w = matched.shape
    smooth, bends = planes.copy(), np.zeros((h, w, 3), np.float32)
    support = np.zeros((h, w), np.float32)
    for row in prange(h):
        y = int(np.int64(row))
        for x in range(w):
            if not matched[y, x]:
                continue
            n = x1 = y1 = xx = xy = yy = 0.0
            u1 = ux = uy = v1 = vx = vy = level = 0.0
            for dy in range(-SMOOTHED_REACH, SMOOTHED_REACH + 1, 2):
                for dx in range(-SMOOTHED_REACH, SMOOTHED_REACH + 1, 2):
                    i, j = y + dy, x + dx
                    if not (0 <= i < h and 0 <= j < w and matched[i, j]):
                        continue
                    u, v = planes[i, j, 1], planes[i, j, 2]
                    rise = planes[i, j, 0] - planes[y, x, 0]
                    mean_rise = (dx * (planes[y, x, 1] + u) + dy * (planes[y, x, 2] + v)) / 2
                    if abs(rise - mean_rise) > APART_PX:
                        continue
                    weight = WEIGHTS[abs(dx)] * WEIGHTS[abs(dy)]
                    a, b = weight * dx, weight * dy
                    n, x1, y1 = n + weight, x1 + a, y1 + b
                    xx, xy, yy = xx + a * dx, xy + a * dy, yy + b * dy
                    u1, ux, uy = u1 + weight * u, ux + a * u, uy + b * u
                    v1, vx, vy = v1 + weight * v, vx + a * v, vy + b * v
                    level += weight * (rise - dx * u - dy * v)
            support[y, x] = n / ALL_WEIGHTS
            x1, y1, u1, v1, xx, xy, yy = x1 / n, y1 / n, u1 / n, v1 / n, xx / n, xy / n, yy / n
            cxx, cxy, cyy = xx - x1 * x1 + SINGULAR, xy - x1 * y1, yy - y1 * y1 + SINGULAR
            determinant = cxx * cyy - cxy * cxy
            ux, uy, vx, vy = ux / n - x1 * u1, uy / n - y1 * u1, vx / n - x1 * v1, vy / n - y1 * v1
            per_xx = _clipped((cyy * ux - cxy * uy) / determinant)
            per_yy = _clipped((cxx * vy - cxy * vx) / determinant)
            per_xy = _clipped((cxx * uy - cxy * ux + cyy * vx - cxy * vy) / (2 * determinant))
            bends[y, x] = per_xx, per_xy, per_yy
            smooth[y, x, 0] += level / n + (per_xx * xx + 2 * per_xy * xy + per_yy * yy) / 2
            smooth[y, x, 1] = u1 - per_xx * x1 - per_xy * y1
            smooth[y, x, 2] = v1 - per_xy * x1 - per_yy * y1
    return smooth, bends, support


@njit(forceinline=True)
def _random(pixel: int, step: int, draw: int, seed: int) -> float:
    """Return a pseudo-random number, uniform in −1 … 1, as a hash of the four arguments alone (the
    finaliser of MurmurHash3)."""
    k = np.uint64(pixel) * np.uint64(0x9E3779B97F4A7C15) + np.uint64(step) * np.uint64(
        0xBF58476D1CE4E5B9
    )
    k += np.uint64(draw) * np.uint64(0x94D049BB133111EB) + np.uint64(seed)
    k ^= k >> np.uint64(33)
    k *= np.uint64(0xFF51AFD7ED558CCD)
    k ^= k >> np.uint64(33)
    k *= np.uint64(0xC4CEB9FE1A85EC53)
    k ^= k >> np.uint64(33)
    return np.float64(k >> np.uint64(11)) / 2.0**52 - 1.0


@njit(forceinline=True, error_model="numpy", fastmath={"contract", "reassoc", "nsz", "arcp"})
def _window(
    reference: np.ndarray, y: int, x: int, values: np.ndarray, weights: np.ndarray
) -> Window:
    """Extract the matching window around pixel (x, y) of the reference picture, which is padded at
    its border.

    values, weights: scratch arrays [SAMPLES], which are overwritten and returned. Returns column,
    row, gray values minus their weighted mean, bilateral weights with sum 1, and weighted variance.
    """
    centre = reference[y + RADIUS, x + RADIUS]
    total = np.float32(0)
    for k in range(SAMPLES):
        value = reference[y + RADIUS + np.int64(ROW[k]), x + RADIUS + np.int64(COLUMN[k])] - centre
        scaled = abs(value) * np.float32(1 / (64 * SIGMA_GRAY))
        similarity = max(np.float32(1) - scaled, np.float32(0))
        for _ in range(6):
            # exp(−|value| / SIGMA_GRAY) ≈ (1 − |value| / (64 SIGMA_GRAY))⁶⁴
            similarity *= similarity
        values[k] = value
        weights[k] = similarity * NEARNESS[k]
        total += weights[k]
    mean = np.float32(0)
    for k in range(SAMPLES):
        weights[k] /= total
        mean += weights[k] * values[k]
    variance = np.float32(0)
    for k in range(SAMPLES):
        values[k] -= mean
        variance += weights[k] * values[k] * values[k]
    return x, y, values, weights, variance


@njit(forceinline=True, error_model="numpy", fastmath={"contract", "reassoc", "nsz", "arcp"})
def _mismatch(window: Window, stereo: Stereo, s: int, plane: Triple, bend: Triple | None) -> float:
    """Compute 1 − NCC between a window of the reference and source view number s, if the surface is
    the given plane; 2 (WORST) if the source view does not show the whole window.

    plane: disparity and its slopes per column and row, whose homography is approximated as affine
    across the window. bend: second derivatives of the disparity (per column², per column and row,
    per row²), which turn the plane into a paraboloid; None: a plane.
    """
    x, y, values, weights, variance = window
    sources, A, b = stereo.sources, stereo.A, stereo.b
    rows, columns = stereo.sizes[s, 0], stereo.sizes[s, 1]
    disparity, slope_x, slope_y = plane
    q = A[s, 2, 0] * x + A[s, 2, 1] * y + A[s, 2, 2] + b[s, 2] * disparity
    if q <= 0:
        return WORST
    u = (A[s, 0, 0] * x + A[s, 0, 1] * y + A[s, 0, 2] + b[s, 0] * disparity) / q
    v = (A[s, 1, 0] * x + A[s, 1, 1] * y + A[s, 1, 2] + b[s, 1] * disparity) / q
    qx, qy = A[s, 2, 0] + b[s, 2] * slope_x, A[s, 2, 1] + b[s, 2] * slope_y
    ux, uy = (
        (A[s, 0, 0] + b[s, 0] * slope_x - u * qx) / q,
        (A[s, 0, 1] + b[s, 0] * slope_y - u * qy) / q,
    )
    vx, vy = (
        (A[s, 1, 0] + b[s, 1] * slope_x - v * qx) / q,
        (A[s, 1, 1] + b[s, 1] * slope_y - v * qy) / q,
    )
    reach_u, reach_v = RADIUS * (abs(ux) + abs(uy)), RADIUS * (abs(vx) + abs(vy))
    if bend is not None:
        rise = RADIUS * RADIUS * (0.5 * abs(bend[0]) + 0.5 * abs(bend[2]) + abs(bend[1]))
        rise_u, rise_v = (b[s, 0] - u * b[s, 2]) / q, (b[s, 1] - v * b[s, 2]) / q
        reach_u, reach_v = reach_u + rise * abs(rise_u), reach_v + rise * abs(rise_v)
    if not (
        u - reach_u >= 0
        and u + reach_u < columns - 1
        and v - reach_v >= 0
        and v + reach_v < rows - 1
    ):
        return WORST
    origin = sources[s, int(v), int(u)]  # sums about a value nearby do not cancel
    u, v, ux, uy, vx, vy = (
        np.float32(u),
        np.float32(v),
        np.float32(ux),
        np.float32(uy),
        np.float32(vx),
        np.float32(vy),
    )
    if bend is not None:
        xx, xy, yy = np.float32(0.5 * bend[0]), np.float32(bend[1]), np.float32(0.5 * bend[2])
        rise_u, rise_v = np.float32(rise_u), np.float32(rise_v)
    mean, square, product = np.float32(0), np.float32(0), np.float32(0)
    for k in range(len(weights)):
        dx, dy = COLUMN[k], ROW[k]
        su, sv = u + dx * ux + dy * uy, v + dx * vx + dy * vy
        if bend is not None:
            rise = xx * dx * dx + yy * dy * dy + xy * dx * dy
            su, sv = su + rise * rise_u, sv + rise * rise_v
        # unsigned: no check for negative indices
        i, j = (np.uint32(np.int32(sv)), np.uint32(np.int32(su)))
        fv, fu = sv - np.float32(np.int32(sv)), su - np.float32(np.int32(su))
        top = sources[s, i, j] + fu * (sources[s, i, j + 1] - sources[s, i, j])
        bottom = sources[s, i + 1, j] + fu * (sources[s, i + 1, j + 1] - sources[s, i + 1, j])
        value = top + fv * (bottom - top) - origin
        weighted = weights[k] * value
        mean += weighted
        square += weighted * value
        product += weighted * values[k]
    power = variance * max(square - mean * mean, np.float32(0))
    if power < 1e-14:
        return 1.0
    return 1.0 - product / np.sqrt(power)


@njit(forceinline=True)
def _cost(
    window: Window,
    stereo: Stereo,
    plane: Triple,
    bend: Triple | None,
    chosen: np.ndarray,
    mismatch: np.ndarray,
    ranked: bool,
    most: float = np.inf,
) -> float:
    """Compute the matching cost of a plane: 1 − NCC, averaged over the better half of the source
    views.

    ranked: True if `chosen` already lists the source views, best first, so that only its first half
    is compared; False: all of them are compared, and their order is written to `chosen`. mismatch:
    scratch, one value per source view. most: the sum stops early once the mean must exceed this
    value; the result is then only some number above it.
    """
    used = max(1, len(chosen) // 2)
    total = 0.0
    for n in range(used if ranked else len(chosen)):
        s = chosen[n] if ranked else n
        mismatch[s] = _mismatch(window, stereo, s, plane, bend)
        if ranked:
            total += mismatch[s]
            if total > most * used:
                break
        else:
            place = n
            while place > 0 and mismatch[s] < mismatch[chosen[place - 1]]:
                chosen[place] = chosen[place - 1]
                place -= 1
            chosen[place] = s
    for n in range(0 if ranked else used):
        total += mismatch[chosen[n]]
    return total / used


@njit(forceinline=True)
def _best_neighbour(cost: np.ndarray, y: int, x: int, direction: int) -> tuple[int, int]:
    """Find the pixel (row, column) with the lowest cost among the neighbours of (y, x) at distances
    1, 3 and 5 in one of four directions. Returns (-1, -1) if none of them has been matched."""
    h, w = cost.shape
    best_i, best_j, least = -1, -1, WORST
    for distance in range(1, REACH + 1, 2):
        i, j = y + distance * DIRECTIONS[direction, 0], x + distance * DIRECTIONS[direction, 1]
        if 0 <= i < h and 0 <= j < w and cost[i, j] < least:
            best_i, best_j, least = i, j, cost[i, j]
    return best_i, best_j


@njit(parallel=True, cache=True)
def _pass(
    stereo: Stereo,
    planes: np.ndarray,
    cost: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    step: int,
    seed: int,
) -> None:
    """Run one iteration of PatchMatch, in place, on the pixels of one colour of the chessboard: try
    the planes of neighbours, then random variations of the best plane.

    low, high [h, w]: allowed disparities. step: 2 · iteration + colour (0 or 1); iteration 0 only
    evaluates the planes. The source views are ranked under a pixel's current plane; other planes
    are compared with the better half only.
    """
    h, w = cost.shape
    iteration = step // 2
    for row in prange(h):
        # prange's index is unsigned: functions called with it would be compiled twice
        y = int(np.int64(row))
        values, weights = np.empty(SAMPLES, np.float32), np.empty(SAMPLES, np.float32)
        mismatch, chosen = (
            np.empty(len(stereo.sources)),
            np.zeros(len(stereo.sources), dtype=np.int64),
        )
        for x in range((y + step) % 2, w, 2):
            if not low[y, x] <= high[y, x]:
                continue
            window = _window(stereo.reference, y, x, values, weights)
            best = plane = (float(planes[y, x, 0]), float(planes[y, x, 1]), float(planes[y, x, 2]))
            least = np.inf
            # first the pixel's own plane
            for n in range(-1, len(DIRECTIONS) + PERTURBATIONS if iteration > 0 else 0):
                if 0 <= n < len(DIRECTIONS):
                    i, j = _best_neighbour(cost, y, x, n)
                    if i < 0:
                        continue
                    slope_x, slope_y = float(planes[i, j, 1]), float(planes[i, j, 2])
                    plane = (
                        planes[i, j, 0] + slope_x * (x - j) + slope_y * (y - i),
                        slope_x,
                        slope_y,
                    )
                elif n > 0:
                    reach = 2.0 ** (len(DIRECTIONS) + 1 - iteration - n)  # 1, 1/2, 1/4 … of a pixel
                    pixel = y * w + x
                    plane = (
                        best[0] + reach * _random(pixel, step, 3 * n, seed),
                        best[1] + 0.3 * reach * _random(pixel, step, 3 * n + 1, seed),
                        best[2] + 0.3 * reach * _random(pixel, step, 3 * n + 2, seed),
                    )
                if n >= 0 and not low[y, x] <= plane[0] <= high[y, x]:
                    continue
                tried = _cost(window, stereo, plane, None, chosen, mismatch, n >= 0, least)
                if n < 0 or tried < least:
                    least, best = tried, plane
            cost[y, x] = least
            planes[y, x, 0], planes[y, x, 1], planes[y, x, 2] = best


@njit(parallel=True, cache=True)
def _polish(
    stereo: Stereo, planes: np.ndarray, cost: np.ndarray, wanted: np.ndarray, bends: np.ndarray
) -> None:
    """Refine the disparities in place where `wanted` [h, w] is True.

    The cost is computed at the disparity and a quarter of a pixel to either side, and the disparity
    moves to the vertex of the parabola through the three. bends [h, w, 3]: second derivatives of
    the disparity, which curve the windows. `cost` [h, w] is set to the cost before the move.
    """
    h, w = cost.shape
    for row in prange(h):
        y = int(np.int64(row))
        values, weights = np.empty(SAMPLES, np.float32), np.empty(SAMPLES, np.float32)
        mismatch, chosen = (
            np.empty(len(stereo.sources)),
            np.zeros(len(stereo.sources), dtype=np.int64),
        )
        costs = np.empty(3)  # a quarter of a pixel to one side, here, and to the other
        for x in range(w):
            if not wanted[y, x]:
                continue
            window = _window(stereo.reference, y, x, values, weights)
            disparity, slope_x, slope_y = (
                float(planes[y, x, 0]),
                float(planes[y, x, 1]),
                float(planes[y, x, 2]),
            )
            bend = (float(bends[y, x, 0]), float(bends[y, x, 1]), float(bends[y, x, 2]))
            for side in (0, -1, 1):
                plane = (disparity + SIDE * side, slope_x, slope_y)
                costs[side + 1] = _cost(window, stereo, plane, bend, chosen, mismatch, side != 0)
            left, here, right = costs
            opening = left - 2 * here + right
            if opening > 0:
                planes[y, x, 0] += SIDE * min(max(0.5 * (left - right) / opening, -1.0), 1.0)
            cost[y, x] = here
