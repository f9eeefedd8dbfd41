"""Hard phases: at and across each pair's ambiguity, pairs too close and too far apart, wrong first depths."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import permutations, product
from typing import Any

import numpy as np

from bench.stability.catalogue import Refused, Worst, case, refused, worst
from bench.stability.scenes import (
    FSK,
    LADDER_HZ,
    POINT_M,
    STEP_M,
    bumpy_points,
    capture,
    depth_map,
    echoes,
    middle,
    noisy,
)
from radar.arrays import SPEED_OF_LIGHT_M_S, qar50
from radar.backprojection import tone_images
from radar.confidence import wrap_probability
from radar.depthmap import DepthMap
from radar.fsk import depth_step_m
from radar.grid import PixelGrid

C = SPEED_OF_LIGHT_M_S
PAIRS_HZ = (0.2e9, 0.5e9, 0.7e9, 2.3e9, 2.5e9, 9.8e9, 10e9)
PAPER_HZ = (82.0e9, 81.8e9, 79.5e9)
FINEST_HZ = {"2fsk": 0.2e9, "3fsk": 2.3e9, "3fsk-plus": 2.3e9, "nfsk": 9.8e9}
PERIOD_M = C / (2 * 2.5e9)
NEAR_MM = 0.5
CELL_M = 0.006  # resolution cell at 0.3 m
NEAR_WHY = (
    "out of focus by no more than settled_m, 5 mm: the factor 2 of the path's derivative falls short of it by 3 %, "
    "0.15 mm on the axis, and the filters' neighbours by as much"
)


def _point_at(z_m: float) -> np.ndarray:
    return echoes((0.0, 0.0, z_m), frequencies_hz=LADDER_HZ)


def _found(id: str, z_m: float, **values: Any) -> DepthMap:
    return depth_map(id, capture(_point_at(z_m), LADDER_HZ), **values)


def _judged(seen: list[tuple[str, float, bool]], bound: float) -> Worst:
    """The worst of (place, value, whether it was marked); flagged where every value beyond the bound was marked."""
    found = worst((place, value) for place, value, _ in seen)
    silent = [(place, value) for place, value, marked in seen if not value <= bound and not marked]
    return worst(silent) if silent else Worst(found.value, found.at, flagged=True)


@case(
    "phase", "a step at and across ±c/4Δf", quantity="error of the phase, periods apart",
    reference="4πΔf·Δz/c wrapped, in long double", unit="rad", bound=2.0**-23,
    reason="each image rounds to single precision: 2⁻²⁴ rad at most, of two images 2⁻²³",
)
def across() -> Worst:
    def seen() -> Iterator[tuple[str, float]]:
        share = np.array([0, 0.1, 0.3, 0.5, 0.77, 1 - 1e-6, 1 - 2**-24, 1, 1 + 2**-24, 1 + 1e-6, 1.5, 2, 3])
        for difference_hz, sign in product(PAIRS_HZ, (-1, 1)):
            turns = np.longdouble(sign) * share.astype(np.longdouble) / 2  # of the phase, from the step −Δz
            phase = 2 * np.pi * (turns - np.rint(turns)).astype(np.float64)
            image, one = np.exp(1j * phase).astype(np.complex64), np.ones(len(share), np.complex64)
            step_m = depth_step_m(image, one, difference_hz)
            off = step_m * 4 * np.pi * difference_hz / C + phase
            yield f"Δf {difference_hz / 1e9:g} GHz", float(np.abs(off - 2 * np.pi * np.rint(off / 2 / np.pi)).max())

    return worst(seen())


@case(
    "phase", "the probability of a wrap at the ambiguity", quantity="wrap_probability", unit="1",
    reference="two Gaussian hypotheses, in long double", bound=1e-12,
    reason="its exponent 2a(a − |Δz|)/σ² rounds by a few 2⁻⁵³ of up to 700, beyond which the answer is 0 or 1 itself",
)
def wraps_at() -> Worst:
    def seen() -> Iterator[tuple[str, float]]:
        step = np.array([0, 29.9, 30 - 1e-9, 30, 30 + 1e-9, 30.1, 60, 300])
        for sigma in (0.0, 1e-300, 1e-9, 1e-3, 1.0, 30.0, 1e9):
            found = wrap_probability(step, np.full(len(step), sigma), 30.0)
            with np.errstate(all="ignore"):
                exponent = 60 * (30 - step.astype(np.longdouble)) / np.longdouble(sigma) ** 2
                exact = 1 / (1 + np.exp(exponent))
            exact = np.where(step == 30, 0.5, exact)  # halfway: either period, however well the point is known
            yield f"σ {sigma:g} mm", float(np.abs(found - exact).max())

    return worst(seen())


@case(
    "phase", "the coarse error across ±30 mm", quantity="depth off by half a period without flag",
    reference="two planes a step apart", unit="mm", bound=1e3 * PERIOD_M / 2,
    reason="a filter across the edge is off by up to half the step; beyond 30 mm the third tone adds a period, which "
    "must be flagged; no pixel without flag is off by more than half of one. Pixels a resolution cell from the edge: "
    "nearer ones see both planes in one phase",
)
def coarse_error() -> Worst:
    seen = []
    for height_mm in (20, 40, 60, 65, 70, 75, 80, 85, 90, 95, 100, 110):
        far_m = 0.26 + height_mm / 1000
        along = np.arange(-0.027, 0.0271, 0.006)
        x, y = np.meshgrid(along, along)
        points = np.stack([x, y, np.where(x < 0, 0.26, far_m)], axis=-1).reshape(-1, 3)
        taken = capture(echoes(points, None, PAPER_HZ, qar50()), PAPER_HZ, qar50())  # a thin array's lobes would meddle
        for size in (15, 31):
            values = {"coarse_filter_px": size, "fine_filter_px": 1, "first_depth_m": 0.3}
            depth = depth_map("3fsk", taken, half_m=0.024, **values)
            beside = np.abs(depth.z_m - np.where(depth.x_m < 0, 0.26, far_m))[:, np.abs(depth.x_m) > CELL_M]
            for marked in (False, True):
                there = beside[np.isfinite(beside) & (depth.wrapped[:, np.abs(depth.x_m) > CELL_M] == marked)]
                seen.append((f"step {height_mm} mm, filter {size}", 1e3 * there.max(initial=0.0), marked))
    return _judged(seen, 1e3 * PERIOD_M / 2)


@case(
    "phase", "wrapped pixels are dropped", quantity="flagged pixels that keep a depth", reference="none", unit="pixels",
    bound=0.0, reason="drop_wrapped takes the depth of every flagged pixel, before the filter could spread it",
)
def dropped() -> Worst:
    def seen() -> Iterator[tuple[str, float]]:
        clean = echoes(bumpy_points(), frequencies_hz=LADDER_HZ)
        for snr_db, seed in product((40, 25, 15, 5), range(3)):
            taken = capture(noisy(clean, 900.0, snr_db, seed), LADDER_HZ)
            depth = depth_map("3fsk-plus", taken, half_m=0.02, first_depth_m=0.28, tolerance=None)
            yield f"{snr_db} dB, draw {seed}", float(np.count_nonzero(np.isfinite(depth.z_m) & depth.wrapped))

    return worst(seen())


@case(
    "phase", "a pair of tones that meet", quantity="error of the depth, over cΔφ/4πΔf of a rounding Δφ",
    reference="the point", unit="rad", bound=2.0**-20,
    reason="samples, both steerings and the image round to single precision, 2⁻²³ rad each and tone, 8 in all; the "
    "last micrometre is the factor 2's",
)
def tones_meet() -> Worst:
    def seen() -> Iterator[tuple[str, float]]:
        for difference_hz in (2e8, 2e7, 2e6, 2e5, 2e4, 2e3, 2e2, 20.0):
            tones = np.array([82e9, 82e9 - difference_hz])
            taken = capture(echoes(POINT_M, frequencies_hz=tones), tones)
            depth = depth_map("2fsk", taken, f1_hz=tones[0], f2_hz=tones[1], tolerance=None, first_depth_m=0.28)
            metres = C / (4 * np.pi * difference_hz)
            yield f"Δf {difference_hz:g} Hz", max(abs(float(middle(depth.z_m)) - 0.28) - 1e-6, 0.0) / metres

    return worst(seen())


@case(
    "phase", "equal tones", quantity="depth from Δf = 0", reference="a refusal", unit="mm", bound=0.0,
    reason="φ/Δf has no value; every pair of a method, and a capture that lists a tone twice, must be refused",
)
def equal_tones() -> Refused | Worst:
    taken = capture(_point_at(0.28), LADDER_HZ)
    twice = np.array([82e9, 82e9, 79.5e9])
    listed = capture(echoes(POINT_M, frequencies_hz=twice), twice)
    answers = [
        refused(lambda: depth_map("2fsk", taken, f2_hz=82e9), "same measured tone"),
        refused(lambda: depth_map("3fsk", taken, f3_hz=82e9), "same measured tone"),
        refused(lambda: depth_map("3fsk", taken, f3_hz=81.8e9), "same measured tone"),
        refused(lambda: depth_map("3fsk-plus", taken, f2_hz=82e9 + 1.0), "same measured tone"),
        refused(lambda: depth_map("nfsk", taken, tones_hz=[82e9, 82e9, 79.5e9]), "0 GHz"),
        refused(lambda: depth_map("2fsk", listed, f2_hz=82e9), "same measured tone"),
    ]
    return next((answer for answer in answers if isinstance(answer, Worst)), answers[0])


@case(
    "phase", "tones in another order", quantity="change of the depth", reference="descending tones", unit="mm",
    bound=1e-9, reason="both signs of φ and Δf turn: what is left is the order of two sums in double precision",
)
def order() -> Worst:
    def seen() -> Iterator[tuple[str, float]]:
        for id in ("2fsk", "3fsk", "3fsk-plus"):
            for turned, (f1, f2) in product((False, True), permutations((82e9, 81.8e9))):
                tones = np.array(LADDER_HZ)[:: -1 if turned else 1]
                taken = capture(echoes(POINT_M, frequencies_hz=tones), tones)
                there = middle(depth_map(id, taken, f1_hz=f1, f2_hz=f2).z_m)
                usual = middle(_found(id, POINT_M[2]).z_m)
                yield f"{id}, f1 {f1 / 1e9:g} GHz, file {'as' if turned else 'des'}cending", 1e3 * abs(there - usual)

    return worst(seen())


@case(
    "phase", "a third tone far away", quantity="share of pixels off by half a period without flag",
    reference="the flag's probability", unit="1", bound=0.1,
    reason="the ambiguity shrinks below the coarse error's 3σ; what then wraps more likely than 0.1 is flagged",
)
def far_tone() -> Worst:
    def seen() -> Iterator[tuple[str, float]]:
        for f3_hz in (79.5e9, 76e9, 72e9, 60e9, 40e9, 20e9):
            tones = np.array([82e9, 81.8e9, f3_hz])
            clean = echoes(bumpy_points(), frequencies_hz=tones)
            values = {"f3_hz": f3_hz, "half_m": 0.02, "first_depth_m": 0.28, "fine_filter_px": 1, "tolerance": None}
            right = depth_map("3fsk", capture(clean, tones), **values).z_m
            half_m, silent = C / (4 * (82e9 - f3_hz)), []
            for seed in range(3):
                found = depth_map("3fsk", capture(noisy(clean, 900.0, 30.0, seed), tones), **values)
                on = np.isfinite(right) & np.isfinite(found.z_m)
                silent.append(((np.abs(found.z_m - right) > half_m) & ~found.wrapped)[on].mean())
            yield f"f3 {f3_hz / 1e9:g} GHz", float(np.mean(silent))

    return worst(seen())


@case(
    "phase", "a ladder with a rung too far", quantity="depth from a rung that noise cannot reach",
    reference="a refusal", unit="mm", bound=0.0,
    reason="3σ of a rung must stay within the next one's ambiguity: Δf'/Δf ≤ π/(3·0.03 rad) = 35",
)
def too_far() -> Refused | Worst:
    taken, answer = capture(_point_at(0.28), LADDER_HZ), None
    for last_hz in (74.9e9, 72e9, 40e9, 1e9, 1e6, 1e12):
        tones = [82e9, 81.8e9, last_hz]
        answer = refused(lambda tones=tones: depth_map("nfsk", taken, tones_hz=tones), "rung", "put a tone")
        if isinstance(answer, Worst):
            return answer
    return answer


OFFSETS_MM = (-1000, -700, -500, -400, -370, -300, -200, -100, -10, 10, 100, 200, 300, 370, 400, 500, 700, 1000)


def _first_depth(ids: tuple[str, ...], within: bool) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """Where, errors [n] and flags [n] of the pixels of a point at 0.28 m and of one at
    1.2 m, when the first image lies some way off, within ±375 mm or beyond."""
    for id, z_m, offset_mm in product(ids, (0.28, 1.2), OFFSETS_MM):
        first_m = z_m + offset_mm / 1000
        if first_m > 0.02 and (abs(offset_mm) < 375) == within:
            depth = _found(id, z_m, first_depth_m=first_m)
            on = np.isfinite(depth.z_m) | depth.wrapped
            place = f"{id}, a point at {z_m:g} m first imaged at {first_m:.3g} m"
            yield place, np.abs(depth.z_m - z_m)[on], depth.wrapped[on]


@case(
    "phase", "a first depth 10 to 370 mm off", quantity="error on target", reference="the point", unit="mm",
    bound=5.0,
    reason="within ±375 mm each pass leaves what the factor 2 falls short of, until it moves by less than 5 mm "
    "(settled_m)",
)
def first_depth() -> Worst:
    return worst((place, 1e3 * error.max()) for place, error, _ in _first_depth(FSK, within=True))


def _silent(ids: tuple[str, ...]) -> Worst:
    found = _first_depth(ids, within=False)
    return worst((place, float(np.mean((error > 0.005) & ~wrapped))) for place, error, wrapped in found)


@case(
    "phase", "a first depth 400 mm to 1 m off, with further tones", quantity="share of pixels wrong without flag",
    reference="the flag's probability", unit="1", bound=0.1,
    reason="the pair settles 750 mm off, 12.5 periods of the third tone, whose step is then half a period: likelier "
    "wrapped than wrap_probability, 0.1, at nine pixels of ten",
)
def first_depth_beyond() -> Worst:
    return _silent(FSK[1:])


@case(
    "phase", "a first depth 400 mm to 1 m off, two tones", quantity="share of pixels wrong without flag",
    reference="no pixel", unit="1", bound=0.1,
    reason="two tones tell depths 750 mm apart by their focus alone; of wrong periods, those behind the array are "
    "flagged",
)
def first_depth_beyond_two() -> Worst:
    return _silent(FSK[:1])


@case(
    "phase", "two equal maxima", quantity="error at the brighter point, over what the other's leak allows",
    reference="the points", unit="1", bound=1.0,
    reason="z_e settles on one of the two, whichever rounding prefers, and that one must be right: a leak of the other, "
    "a share s of its amplitude, turns each image by s at most: cs/(2πΔf), and 0.5 mm for the factor 2",
)
def two_maxima() -> Worst:
    array = qar50()
    along = np.arange(-0.024, 0.0241, STEP_M)
    first = PixelGrid(along, along).points_m(0.45).reshape(-1, 3)

    def seen() -> Iterator[tuple[str, float]]:
        for apart_mm in (0, 10, 60, 160):
            points = np.array([[-0.02, 0, 0.28], [0.02, 0, 0.28 + apart_mm / 1000]])
            alone = [echoes(point, None, LADDER_HZ, array).astype(np.complex64) for point in points]
            peaks = [np.abs(_images(samples, first)[:2]).mean(axis=0).max() for samples in alone]
            at = [np.abs(_images(samples, points)).max(axis=0) for samples in alone]  # [echo][point]
            for more in (0.9, 0.95, 0.99, 1 - 1e-6, 1, 1 + 1e-6, 1.01, 1.1):
                weight = np.array([more, 1 / more]) / peaks
                taken = capture(sum(w * samples for w, samples in zip(weight, alone, strict=True)), LADDER_HZ, array)
                for id in FSK:
                    depth = depth_map(id, taken, half_m=0.024)
                    row, columns = depth.z_m.shape[0] // 2, np.array([4, -5])
                    one = int(depth.amplitude_db[row, columns].argmax())
                    leak = weight[1 - one] * at[1 - one][one] / (weight[one] * at[one][one])
                    allowed_m = C * leak / (2 * np.pi * FINEST_HZ[id]) + NEAR_MM / 1000
                    error_m = abs(float(depth.z_m[row, columns[one]]) - points[one, 2])
                    yield f"{id}, {apart_mm} mm apart, strengths {more:g}", error_m / allowed_m

    return worst(seen())


def _images(samples: np.ndarray, points_m: np.ndarray) -> np.ndarray:
    return tone_images(samples, np.array(LADDER_HZ), qar50(), points_m)


@case(
    "phase", "a point at the image's edge", quantity="error at the point's pixel", reference="the point", unit="mm",
    bound=NEAR_MM, reason=NEAR_WHY,
)
def at_the_edge() -> Worst:
    def seen() -> Iterator[tuple[str, float]]:
        for id, (column, row) in product(FSK, ((0, 0), (0, 12), (12, 24), (24, 24))):
            point = ((column - 12) * STEP_M, (row - 12) * STEP_M, 0.28)
            depth = depth_map(id, capture(echoes(point, frequencies_hz=LADDER_HZ), LADDER_HZ))
            yield f"{id}, pixel {column}, {row}", 1e3 * abs(float(depth.z_m[row, column]) - 0.28)

    return worst(seen())


@case(
    "phase", "a point outside the image", quantity="depths on the map, off by half a period without flag",
    reference="the sphere of the point's range", unit="mm", bound=1e3 * PERIOD_M / 2,
    reason="what is seen inside is the point's sidelobe, whose range is the point's own within a cell: no period off",
)
def outside() -> Worst:
    seen = []
    for id, beside_mm in product(FSK, (13, 15, 20, 30, 50, 80)):
        point = np.array([beside_mm / 1000, 0.0, 0.28])
        depth = depth_map(id, capture(echoes(point, frequencies_hz=LADDER_HZ), LADDER_HZ))
        x, y = np.meshgrid(depth.x_m, depth.y_m)
        off = np.abs(np.sqrt(depth.z_m**2 + x**2 + y**2) - np.linalg.norm(point))
        for marked in (False, True):
            there = off[np.isfinite(off) & (depth.wrapped == marked)]
            seen.append((f"{id}, {beside_mm} mm beside", 1e3 * there.max(initial=0.0), marked))
    return _judged(seen, 1e3 * PERIOD_M / 2)


@case(
    "phase", "a point before and behind the projection's box", quantity="error on target without flag",
    reference="the point", unit="mm", bound=0.5 + 1e-6,
    reason="within the box half a voxel; outside it the strongest voxel is the box's last, which must not pass for "
    "a depth",
)
def outside_the_box() -> Worst:
    def seen() -> Iterator[tuple[str, float]]:
        for z_m in (0.245, 0.2454, 0.28, 0.3246, 0.325, 0.33, 0.24, 0.35, 0.40):
            taken = capture(echoes((0, 0, z_m)))
            yield f"a point at {z_m:g} m", 1e3 * abs(float(middle(depth_map("broadband", taken).z_m)) - z_m)

    return worst(seen())
