"""Hard phases: first depths that are wrong, points that tie, points at the edge of what is imaged and outside."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np

from bench.studies.stability.cases import Worst, case, worst
from bench.studies.stability.scenes import FSK, LADDER_HZ, STEP_M, capture, depth_map, echoes, judged, middle
from radar.data.arrays import SPEED_OF_LIGHT_M_S, qar50
from radar.data.grid import PixelGrid
from radar.imaging.cpu.exact import tone_images

C = SPEED_OF_LIGHT_M_S
FINEST_HZ = {"2fsk": 0.2e9, "3fsk": 2.3e9, "3fsk-plus": 2.3e9, "nfsk": 9.8e9}
PERIOD_M = C / (2 * 2.5e9)
NEAR_MM = 0.5
NEAR_WHY = (
    "out of focus by no more than settled_m, 5 mm: the factor 2 of the path's derivative falls short of it by 3 %, "
    "0.15 mm on the axis, and the filters' neighbours by as much"
)

OFFSETS_MM = (-1000, -700, -500, -400, -370, -300, -200, -100, -10, 10, 100, 200, 300, 370, 400, 500, 700, 1000)


def _first_depth(ids: tuple[str, ...], within: bool) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """Where, errors [n] and flags [n] of the pixels of a point at 0.28 m and of one at 1.2 m, when the first image
    lies some way off, within ±375 mm or beyond."""
    for id, z_m, offset_mm in product(ids, (0.28, 1.2), OFFSETS_MM):
        first_m = z_m + offset_mm / 1000
        if first_m > 0.02 and (abs(offset_mm) < 375) == within:
            taken = capture(echoes((0, 0, z_m), frequencies_hz=LADDER_HZ), LADDER_HZ)
            depth = depth_map(id, taken, first_depth_m=first_m)
            on = np.isfinite(depth.z_m) | depth.wrapped
            place = f"{id}, a point at {z_m:g} m first imaged at {first_m:.3g} m"
            yield place, np.abs(depth.z_m - z_m)[on], depth.wrapped[on]


@case(
    "phase",
    "a first depth 10 to 370 mm off",
    quantity="error on target",
    reference="the point",
    unit="mm",
    bound=NEAR_MM,
    reason="each pass leaves 3 % of its correction, for the factor 2, and the last one is below 5 mm (settled_m): 0.15 "
    "mm; a pixel 12 mm beside the point sees its range, 0.26 mm nearer",
)
def first_depth() -> Worst:
    return worst((place, 1e3 * error.max()) for place, error, _ in _first_depth(FSK, within=True))


def _silent(ids: tuple[str, ...]) -> Worst:
    found = _first_depth(ids, within=False)
    return worst((place, float(np.mean((error > 0.005) & ~wrapped))) for place, error, wrapped in found)


@case(
    "phase",
    "a first depth 400 mm to 1 m off, with further tones",
    quantity="share of pixels wrong without flag",
    reference="the flag's probability",
    unit="1",
    bound=0.1,
    reason="the pair settles 750 mm off, 12.5 periods of the third tone, whose step is then half a period: likelier "
    "wrapped than wrap_probability, 0.1, at nine pixels of ten",
)
def first_depth_beyond() -> Worst:
    return _silent(FSK[1:])


@case(
    "phase",
    "a first depth 400 mm to 1 m off, two tones",
    quantity="share of pixels wrong without flag",
    reference="no pixel",
    unit="1",
    bound=0.1,
    reason="two tones tell depths 750 mm apart by their focus alone: those of wrong periods are flagged where a plane "
    "a period away is sharper, and those behind the array",
)
def first_depth_beyond_two() -> Worst:
    return _silent(FSK[:1])


@case(
    "phase",
    "two equal maxima",
    quantity="error at the brighter point, over what the other's leak allows",
    reference="the points",
    unit="1",
    bound=1.0,
    reason="z_e settles on one of the two, whichever rounding prefers, and that one must be right: a leak of the "
    "other, a share s of its amplitude, turns each image by s at most: cs/(2πΔf), and 0.5 mm for the factor 2",
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
    "phase",
    "a point at the image's edge",
    quantity="error at the point's pixel",
    reference="the point",
    unit="mm",
    bound=NEAR_MM,
    reason=NEAR_WHY,
)
def at_the_edge() -> Worst:
    def seen() -> Iterator[tuple[str, float]]:
        for id, (column, row) in product(FSK, ((0, 0), (0, 12), (12, 24), (24, 24))):
            point = ((column - 12) * STEP_M, (row - 12) * STEP_M, 0.28)
            depth = depth_map(id, capture(echoes(point, frequencies_hz=LADDER_HZ), LADDER_HZ))
            yield f"{id}, pixel {column}, {row}", 1e3 * abs(float(depth.z_m[row, column]) - 0.28)

    return worst(seen())


@case(
    "phase",
    "a point outside the image",
    quantity="depths on the map, off by half a period without flag",
    reference="the sphere of the point's range",
    unit="mm",
    bound=1e3 * PERIOD_M / 2,
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
    return judged(seen, 1e3 * PERIOD_M / 2)


@case(
    "phase",
    "a point before and behind the projection's box",
    quantity="error on target without flag",
    reference="the point",
    unit="mm",
    bound=0.5 + 1e-6,
    reason="within the box half a voxel; outside it the strongest voxel is the box's last, or a range sidelobe whose "
    "tones do not agree: neither may pass for a depth",
)
def outside_the_box() -> Worst:
    seen = []
    for z_m in (0.245, 0.2454, 0.28, 0.3246, 0.325, 0.326, 0.33, 0.24, 0.335, 0.345, 0.35, 0.40, 0.2, 0.6):
        depth = depth_map("broadband", capture(echoes((0, 0, z_m))))
        off_mm = 1e3 * abs(float(middle(depth.z_m)) - z_m)
        seen.append((f"a point at {z_m:g} m", off_mm, bool(middle(depth.wrapped))))
    return judged(seen, 0.5 + 1e-6)
