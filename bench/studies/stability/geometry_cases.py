"""Hard geometry: voxels on and behind the array, lone antennas and voxels, far origins, long ranges, many tones.

Every sweep is imaged exactly and to each tolerance, on white noise, and compared with the direct sum in float64. Both
are told as shares of what was asked: a relative L2 error over the points and a few draws of samples.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import product
from typing import NamedTuple

import numpy as np

from bench.studies.stability import geometry_refusals as geometry_refusals
from bench.studies.stability.cases import Seen, case, enter
from bench.studies.stability.geometry_direct import TONES_HZ, array, cloud, echoes, image, waves
from bench.studies.stability.scenes import white_noise
from radar.data.arrays import AntennaArray
from radar.data.grid import VoxelGrid
from radar.imaging.api import image_points, image_volume
from radar.simulation.forward import Scatterers, simulate

EXACT = 1e-5
TOLERANCES = (None, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
ASKED = (
    "Against: the direct sum in float64, written apart. Because: a tolerance is a promise; the exact sum, of N terms "
    "of random sign in single precision, is off by √N·2⁻²⁴, below the 1e-5 that is promised for N of up to 25 000 "
    "terms."
)


class Place(NamedTuple):
    """One step of a sweep; draws of samples over which the error is taken: few points need many."""

    at: str
    array: AntennaArray
    points_m: np.ndarray
    tones_hz: np.ndarray = TONES_HZ
    draws: int = 6


def _share(place: Place, tolerance: float | None) -> float:
    along, error, size = waves(place.array, place.tones_hz, place.points_m), 0.0, 0.0
    for seed in range(place.draws):
        samples = white_noise((len(place.tones_hz), *place.array.channels), seed)
        expected = image(samples, along)
        found = image_points(samples, place.tones_hz, place.array, place.points_m, tolerance)
        error += np.sum(np.abs(found - expected) ** 2)
        size += np.sum(np.abs(expected) ** 2)
    return np.sqrt(error / size) / (tolerance or EXACT)


def _asked(tolerance: float | None) -> str:
    return "exact" if tolerance is None else f"tolerance {tolerance:g}"


def _sweep(name: str) -> Callable[[Callable[[], Iterator[Place]]], Callable[[], Iterator[Place]]]:
    """Decorator that enters a sweep of places into the catalogue, with its docstring as the quantity."""

    def add(places: Callable[[], Iterator[Place]]) -> Callable[[], Iterator[Place]]:
        def measure() -> Seen:
            return ((f"{p.at}, {_asked(t)}", _share(p, t)) for p in places() for t in TOLERANCES)

        enter("geometry", name, "of what was asked", 1.0, f"{places.__doc__} {ASKED}", measure)
        return places

    return add


@_sweep("voxels through the array")
def _through() -> Iterator[Place]:
    """Error of images where waves are chirps, R down to 0 and behind."""
    for z_m in (0.3, 0.05, 1e-2, 1e-3, 0.0, -1e-3, -0.3):
        yield Place(f"z = {z_m:g} m", array(), cloud(40, (0, 0, z_m)) * [1, 1, z_m != 0])


@_sweep("voxels on antennas")
def _on_antennas() -> Iterator[Place]:
    """Error of images at the kink of |p − a|."""
    for height_m in (1e-3, 1e-5, 1e-6, 1e-9, 0.0):
        places = np.concatenate([array().tx_m, array().rx_m]) + [0, 0, height_m]
        yield Place(f"{height_m:g} m above every antenna", array(), places)
        yield Place(f"within {height_m:g} m of one antenna", array(), cloud(40, tuple(array().tx_m[0]), height_m))


@_sweep("one voxel")
def _one_voxel() -> Iterator[Place]:
    """Error of an image without others to average over."""
    for z_m in (1.0, 0.3, 1e-2, 1e-6, 0.0):
        yield Place(f"z = {z_m:g} m", array(), np.array([[0.013, 0.021, z_m]]), draws=30)
        yield Place(f"{z_m:g} m above an antenna", array(), array().tx_m[:1] + [0, 0, z_m], draws=30)


@_sweep("lone, collinear and coincident antennas")
def _few_antennas() -> Iterator[Place]:
    """Error of images from arrays whose waves are all alike."""
    points, line = cloud(40, (0, 0, 0.3)), np.linspace(-0.07, 0.07, 30)[:, None] * [1, 0, 0]
    for t, r in ((1, 1), (1, 10), (12, 1)):
        yield Place(f"{t} × {r} antennas", array(t, r), points)
    yield Place("antennas on a line", AntennaArray(line, line), points)
    yield Place("antennas and voxels on one line", AntennaArray(line, line), np.linspace(-4, 4, 60)[:, None] * line[0])
    yield Place("all antennas in one place", AntennaArray(0 * line, 0 * line), points)


@_sweep("array and scene far from the origin")
def _far_origin() -> Iterator[Place]:
    """Error of images, scene and array moved together."""
    for offset_m in (1e3, 1e6, 9e6):
        for way in ([1, 0, 0], [0, 0, 1], [1, -1, 1]):
            moved, shift = array(), offset_m * np.array(way)
            moved = AntennaArray(moved.tx_m + shift, moved.rx_m + shift)
            yield Place(f"offset {offset_m:g} m along {way}", moved, cloud(40, (0, 0, 0.3)) + shift)


@_sweep("long ranges")
def _long_ranges() -> Iterator[Place]:
    """Error of images whose phase is 10⁴ to 10⁹ turns."""
    halves_m = {20.0: (0.05, 1e-3), 100.0: (5e-3,), 1e3: (1e-3, 0.05), 1e5: (0.05,), 1e6: (0.05,)}
    for range_m, half_m in ((range_m, half_m) for range_m, halves in halves_m.items() for half_m in halves):
        points = cloud(40, (0, 0, range_m), half_m)
        yield Place(f"{1e3 * half_m:g} mm about {range_m:g} m", array(), points, draws=12)


@_sweep("tones of every kind")
def _tones() -> Iterator[Place]:
    """Error of images, skeletons of tones that are all alike."""
    for name, tones_hz in (
        ("one tone", TONES_HZ[:1]),
        ("equal tones", np.full(9, 80e9)),
        ("tones 1 Hz apart", 80e9 + np.arange(9.0)),
        ("descending tones", TONES_HZ[::-1].copy()),
        ("six decades", np.geomspace(1e6, 1e12, 9)),
    ):
        yield Place(name, array(), cloud(40, (0, 0, 0.3)), tones_hz)


@case("geometry", "4096 uneven tones", "of what was asked", 1.0)
def _many_tones() -> Seen:
    """Error of images, drift along the tones. {ASKED}"""
    tones_hz = np.random.default_rng(2).uniform(72e9, 82e9, 4096)
    place = Place("4096 tones", array(3, 2), cloud(10, (0, 0, 0.3)), tones_hz, draws=1)
    return ((_asked(tolerance), _share(place, tolerance)) for tolerance in (None, 1e-5))


@case("geometry", "uneven and tiny grids", "of what was asked", 1.0)
def _grids() -> Seen:
    """Error of volumes by interpolation between nodes. {ASKED}"""
    generator = np.random.default_rng(3)
    two = np.r_[1e-5 * np.arange(40), 0.1 + 1e-5 * np.arange(40)]
    uneven = [np.cumsum(10 ** generator.uniform(-5, -2.5, n)) for n in (40, 12, 24)]
    grids = {
        "steps from 10 µm to 3 mm": (uneven[0] - uneven[0].mean(), uneven[1], 0.3 + uneven[2]),
        "two heaps 10 cm apart": (two, 1e-3 * np.arange(4), 0.3 + two[::3]),
        "every voxel twice": (np.repeat(2e-4 * np.arange(40), 2), 1e-3 * np.arange(6), np.array([0.3, 0.3])),
        "through the array": (2e-3 * np.arange(-15, 15), 2e-3 * np.arange(-10, 10), 2e-3 * np.arange(-9, 9)),
    }
    for step_m in (1e-4, 1e-6, 1e-9):
        grids[f"steps of {step_m:g} m"] = (step_m * np.arange(40), step_m * np.arange(12), 0.3 + step_m * np.arange(20))
    for counts in ((1, 1, 30), (1, 30, 1), (30, 1, 1)):
        starts = zip(counts, (0, 0, 0.3), strict=True)
        grids[f"{counts} voxels"] = tuple(1e-3 * np.arange(n) + start for n, start in starts)
    for (name, axes), tolerance in product(grids.items(), TOLERANCES):
        yield f"{name}, {_asked(tolerance)}", _grid_share(VoxelGrid(*axes), tolerance)


def _grid_share(grid: VoxelGrid, tolerance: float | None) -> float:
    samples, points_m = white_noise((len(TONES_HZ), *array().channels), 0), grid.points_m().reshape(-1, 3)
    chosen = np.random.default_rng(4).integers(0, len(points_m), 60)
    expected = image(samples, waves(array(), TONES_HZ, points_m[chosen]))
    found = image_volume(samples, TONES_HZ, array(), grid, tolerance).ravel()[chosen]
    size = max(np.linalg.norm(expected), np.linalg.norm(samples) * np.sqrt(len(chosen)))  # they may cancel by chance
    return np.linalg.norm(found - expected) / size / (tolerance or EXACT)


@case("geometry", "moved with its array", "1", 2e-5)
def _moved() -> Seen:
    """Change of an image, moved as far as is accepted. Against: the image at the origin. Because: places round to 1e-9
    m at 10⁷ m: in a path to 4e-9 m, times 2π/λ 7e-6 rad, and the exact sum's 1e-5."""
    points, samples = cloud(40, (0, 0, 0.3)), white_noise((len(TONES_HZ), *array().channels), 0)
    at_origin = image_points(samples, TONES_HZ, array(), points, None)
    for offset_m in (1.0, 1e3, 1e6, 9.9e6):
        moved = AntennaArray(array().tx_m + offset_m, array().rx_m + offset_m)
        found = image_points(samples, TONES_HZ, moved, points + offset_m, None)
        yield f"offset {offset_m:g} m", np.linalg.norm(found - at_origin) / np.linalg.norm(at_origin)


@case("geometry", "echoes of points close to antennas", "of what was asked", 1.0)
def _echoes() -> Seen:
    """Error of echoes that fade as 1/R, R → 0. {ASKED}"""
    places = {f"z = {z_m:g} m": cloud(40, (0, 0, 0)) * [1, 1, 0.02] + [0, 0, z_m] for z_m in (0.3, 0.03, 3e-3, 1e-3)}
    places |= {f"{r_m:g} m above antennas": array(40, 40).tx_m[:3] + [0, 0, r_m] for r_m in (1e-3, 1e-6, 1e-12, 1e-24)}
    places |= {"range 1e5 m": cloud(40, (0, 0, 1e5)), "behind the array": cloud(40, (0, 0, -0.3))}
    for (name, points_m), tolerance in product(places.items(), (None, 1e-2, 1e-3, 1e-5)):
        weights = np.random.default_rng(5).standard_normal(len(points_m))
        expected = echoes(weights, array(40, 40), TONES_HZ, points_m)
        found = simulate(Scatterers(points_m, weights), TONES_HZ, array(40, 40), tolerance=tolerance)
        error = np.linalg.norm(found - expected) / np.linalg.norm(expected)
        yield f"{name}, {_asked(tolerance)}", error / (tolerance or EXACT)
