"""Hard phases: first depths that are wrong, points that tie, points at the edge of what is imaged and outside."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np

from bench.studies.stability.cases import Seen, case
from bench.studies.stability.scenes import (
    FSK,
    LADDER_HZ,
    PERIOD_M,
    STEP_M,
    C,
    by_flag,
    capture,
    depth_map,
    echoes,
    middle,
    recorded,
)
from radar.data.arrays import qar50
from radar.data.grid import PixelGrid
from radar.imaging.cpu.exact import tone_images

FINEST_HZ = {"2fsk": 0.2e9, "3fsk": 2.3e9, "3fsk-plus": 2.3e9, "nfsk": 9.8e9}
NEAR_MM = 0.5
NEAR_WHY = (
    "out of focus by no more than settled_m, 5 mm: the factor 2 of the path's derivative falls short of it by 3 %, "
    "0.15 mm on the axis, and the filters' neighbours by as much"
)

OFFSETS_MM = (-1000, -700, -500, -400, -370, -300, -200, -100, -10, 10, 100, 200, 300, 370, 400, 500, 700, 1000)


def _first_depth(ids: tuple[str, ...], within: bool) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """The place, errors [n] and flags [n] of the pixels of a point at 0.28 m and of one at 1.2 m, when the first image
    lies some way off, within ±375 mm or beyond."""
    for id, z_m, offset_mm in product(ids, (0.28, 1.2), OFFSETS_MM):
        first_m = z_m + offset_mm / 1000
        if first_m > 0.02 and (abs(offset_mm) < 375) == within:
            depth = depth_map(id, recorded((0, 0, z_m), LADDER_HZ), first_depth_m=first_m)
            on = np.isfinite(depth.z_m) | depth.wrapped
            place = f"{id}, a point at {z_m:g} m first imaged at {first_m:.3g} m"
            yield place, np.abs(depth.z_m - z_m)[on], depth.wrapped[on]


@case("phase", "a first depth 10 to 370 mm off", "mm", NEAR_MM)
def first_depth() -> Seen:
    """Error on target. Against: the point. Because: each pass leaves 3 % of its correction, for the factor 2, and the
    last one is below 5 mm (settled_m): 0.15 mm; a pixel 12 mm beside the point sees its range, 0.26 mm nearer."""
    return ((place, 1e3 * error.max()) for place, error, _ in _first_depth(FSK, within=True))


def _silent(ids: tuple[str, ...]) -> Seen:
    for place, error, wrapped in _first_depth(ids, within=False):
        yield place, float(np.mean((error > 0.005) & ~wrapped))


@case("phase", "a first depth 400 mm to 1 m off, with further tones", "1", 0.1)
def first_depth_beyond() -> Seen:
    """Share of pixels wrong without flag. Against: the flag's probability. Because: the pair settles 750 mm off, 12.5
    periods of the third tone, whose step is then half a period: likelier wrapped than wrap_probability, 0.1, at nine
    pixels of ten."""
    return _silent(FSK[1:])


@case("phase", "a first depth 400 mm to 1 m off, two tones", "1", 0.1)
def first_depth_beyond_two() -> Seen:
    """Share of pixels wrong without flag. Against: no pixel. Because: two tones tell depths 750 mm apart by their focus
    alone: those of wrong periods are flagged where a plane a period away is sharper, and those behind the array."""
    return _silent(FSK[:1])


@case("phase", "two equal maxima", "1", 1.0)
def two_maxima() -> Seen:
    """Error at the brighter point, over what the other's leak allows. Against: the points. Because: z_e settles on one
    of the two, whichever rounding prefers, and that one must be right: a leak of the other, a share s of its amplitude,
    turns each image by s at most: cs/(2πΔf), and 0.5 mm for the factor 2."""
    array = qar50()
    along = np.arange(-0.024, 0.0241, STEP_M)
    first = PixelGrid(along, along).points_m(0.45).reshape(-1, 3)
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


def _images(samples: np.ndarray, points_m: np.ndarray) -> np.ndarray:
    return tone_images(samples, np.array(LADDER_HZ), qar50(), points_m)


@case("phase", "a point at the image's edge", "mm", NEAR_MM)
def at_the_edge() -> Seen:
    """Error at the point's pixel. Against: the point. Because: {NEAR_WHY}."""
    for id, (column, row) in product(FSK, ((0, 0), (0, 12), (12, 24), (24, 24))):
        point = ((column - 12) * STEP_M, (row - 12) * STEP_M, 0.28)
        depth = depth_map(id, recorded(point, LADDER_HZ))
        yield f"{id}, pixel {column}, {row}", 1e3 * abs(float(depth.z_m[row, column]) - 0.28)


@case("phase", "a point outside the image", "mm", 1e3 * PERIOD_M / 2)
def outside() -> Seen:
    """Depths on the map, off by half a period without flag. Against: the sphere of the point's range. Because: what is
    seen inside is the point's sidelobe, whose range is the point's own within a cell: no period off."""
    for id, beside_mm in product(FSK, (13, 15, 20, 30, 50, 80)):
        point = np.array([beside_mm / 1000, 0.0, 0.28])
        depth = depth_map(id, recorded(point, LADDER_HZ))
        x, y = np.meshgrid(depth.x_m, depth.y_m)
        off_m = np.abs(np.sqrt(depth.z_m**2 + x**2 + y**2) - np.linalg.norm(point))
        yield from by_flag(f"{id}, {beside_mm} mm beside", off_m, depth.wrapped)


@case("phase", "a point before and behind the projection's box", "mm", 0.5 + 1e-6)
def outside_the_box() -> Seen:
    """Error on target without flag. Against: the point. Because: within the box half a voxel; outside it the strongest
    voxel is the box's last, or a range sidelobe whose tones do not agree: neither may pass for a depth."""
    for z_m in (0.245, 0.2454, 0.28, 0.3246, 0.325, 0.326, 0.33, 0.24, 0.335, 0.345, 0.35, 0.40, 0.2, 0.6):
        depth = depth_map("broadband", recorded((0, 0, z_m)))
        yield f"a point at {z_m:g} m", 1e3 * abs(float(middle(depth.z_m)) - z_m), bool(middle(depth.wrapped))
