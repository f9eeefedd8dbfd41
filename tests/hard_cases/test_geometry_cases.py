"""Hard geometry: voxels on and behind the array, lone antennas and voxels, far origins, long
ranges, many tones; and what has no answer.

Every sweep is imaged exactly and to each tolerance, on white noise, and compared with the direct
sum in balls. Both are given as shares of what was asked: a relative L2 error over the points and a
few draws of samples.
"""

from collections.abc import Callable, Iterable, Iterator
from functools import partial, wraps
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from handbench.radar.data.arrays import AntennaArray
from handbench.radar.data.grid import VoxelGrid
from handbench.radar.imaging.api import image_points, image_volume
from handbench.radar.simulation.forward import Scatterers, simulate
from tests.hard_cases.cases import U_SINGLE, Seen, U, Works, hard_case, refusal
from tests.hard_cases.scenes import TONES_HZ, cloud, plate
from tests.radar.samples import always_planned, noise
from tests.references.balls import LIGHT_M_S, Balls, echoes, images, middles, off

STEER = 4 * U_SINGLE  # of a wave: its phase rounds to π/2 U, cosine and sine to 2 U
UP = 1e-3 * np.arange(9)
TOLERANCES = (None, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6)


class Place(NamedTuple):
    """One step of a sweep; draws of samples over which the error is taken: few points need many."""

    at: str
    array: AntennaArray
    points_m: np.ndarray
    tones_hz: np.ndarray = TONES_HZ
    draws: int = 6


def _asked_of(tolerance: float | None, terms: int, tones_hz: np.ndarray, range_m: float) -> float:
    """The tolerance; of the exact sum, two waves, sums in single precision that grow with the root
    of their terms' number, and paths of two legs that take three roundings each in double
    precision."""
    paths = 2 * np.pi * np.abs(tones_hz).max() / LIGHT_M_S * 2 * range_m * 3 * U
    return tolerance or float(2 * STEER + np.sqrt(terms) * U_SINGLE + paths)


def _shares(place: Place, tolerances: Iterable[float | None] = TOLERANCES) -> Seen:
    samples = np.array(
        [noise((len(place.tones_hz), *place.array.channels), n) for n in range(place.draws)]
    )
    expected = images(samples, place.array, place.tones_hz, place.points_m)
    range_m = float(np.ptp([*place.points_m, *place.array.tx_m], axis=0).max())
    for tolerance in tolerances:
        with always_planned():
            found = [
                image_points(s, place.tones_hz, place.array, place.points_m, tolerance)
                for s in samples
            ]
        asked = _asked_of(
            tolerance, 2 * sum(place.array.channels) + len(samples[0]), place.tones_hz, range_m
        )
        yield f"{place.at}, {_asked(tolerance)}", _relative(np.array(found), expected) / asked


def _relative(found: np.ndarray, expected: Balls, least: float = 0.0) -> float:
    return float(np.linalg.norm(off(found, expected))) / max(
        float(np.linalg.norm(middles(expected))), least
    )


def _asked(tolerance: float | None) -> str:
    return "exact" if tolerance is None else f"tolerance {tolerance:g}"


PROMISED: dict[str, Any] = {
    "kind": "rigorous",
    "bound": 1.0,
    "unit": "of what was asked",
    "reference": "the direct sum in balls",
    "reason": "A tolerance is a promise; the exact sum's waves are off by 4·2⁻²⁴ each, its sums "
    "of N terms of random "
    "sign in single precision by √N·2⁻²⁴, its paths by three roundings in double precision a leg.",
}


def of_images(
    name: str, quantity: str
) -> Callable[[Callable[[], Iterator[Place]]], Callable[[], None]]:
    """The hard case that images at a sweep's places, to each tolerance."""

    def decorate(places: Callable[[], Iterator[Place]]) -> Callable[[], None]:
        @wraps(places)
        def sweep() -> Seen:
            return (seen for place in places() for seen in _shares(place))

        return hard_case(name, quantity=quantity, **PROMISED)(sweep)

    return decorate


@of_images(
    "voxels through the array", "error of images where waves are chirps, R down to 0 and behind"
)
def test_through() -> Iterator[Place]:
    for z_m in (0.3, 0.05, 1e-2, 1e-3, 0.0, -1e-3, -0.3):
        yield Place(f"z = {z_m:g} m", plate(), cloud(40, (0, 0, z_m)) * [1, 1, z_m != 0])


@of_images("voxels on antennas", "error of images at the kink of |p − a|")
def test_on_antennas() -> Iterator[Place]:
    for height_m in (1e-3, 1e-5, 1e-6, 1e-9, 0.0):
        places = np.concatenate([plate().tx_m, plate().rx_m]) + [0, 0, height_m]
        yield Place(f"{height_m:g} m above every antenna", plate(), places)
        yield Place(
            f"within {height_m:g} m of one antenna",
            plate(),
            cloud(40, tuple(plate().tx_m[0]), height_m),
        )


@of_images(
    "lone, collinear and coincident antennas",
    "error of images from arrays whose waves are all equal",
)
def test_few_antennas() -> Iterator[Place]:
    points, line = cloud(40, (0, 0, 0.3)), np.linspace(-0.07, 0.07, 30)[:, None] * [1, 0, 0]
    for t, r in ((1, 1), (1, 10), (12, 1)):
        yield Place(f"{t} × {r} antennas", plate(t, r), points)
    yield Place("antennas on a line", AntennaArray(line, line), points)
    yield Place(
        "antennas and voxels on one line",
        AntennaArray(line, line),
        np.linspace(-4, 4, 60)[:, None] * line[0],
    )
    yield Place("all antennas in one place", AntennaArray(0 * line, 0 * line), points)


@of_images("array and scene far from the origin", "error of images, scene and array moved together")
def test_far_origin() -> Iterator[Place]:
    for offset_m in (1e3, 1e6, 9e6):
        for way in ([1, 0, 0], [0, 0, 1], [1, -1, 1]):
            moved, shift = plate(), offset_m * np.array(way)
            moved = AntennaArray(moved.tx_m + shift, moved.rx_m + shift)
            yield Place(f"offset {offset_m:g} m along {way}", moved, cloud(40, (0, 0, 0.3)) + shift)


@of_images("long ranges", "error of images whose phase is 10⁴ to 10⁹ turns")
def test_long_ranges() -> Iterator[Place]:
    halves_m = {20.0: (0.05, 1e-3), 100.0: (5e-3,), 1e3: (1e-3, 0.05), 1e5: (0.05,), 1e6: (0.05,)}
    for range_m, half_m in (
        (range_m, half_m) for range_m, halves in halves_m.items() for half_m in halves
    ):
        points = cloud(40, (0, 0, range_m), half_m)
        yield Place(f"{1e3 * half_m:g} mm about {range_m:g} m", plate(), points, draws=12)


@of_images("tones of every kind", "error of images, skeletons of tones that are all equal")
def test_tones() -> Iterator[Place]:
    for name, tones_hz in (
        ("one tone", TONES_HZ[:1]),
        ("equal tones", np.full(9, 80e9)),
        ("tones 1 Hz apart", 80e9 + np.arange(9.0)),
        ("descending tones", TONES_HZ[::-1].copy()),
        ("six decades", np.geomspace(1e6, 1e12, 9)),
    ):
        yield Place(name, plate(), cloud(40, (0, 0, 0.3)), tones_hz)


@hard_case("4096 uneven tones", quantity="error of images, drift along the tones", **PROMISED)
def test_many_tones() -> Seen:
    tones_hz = np.random.default_rng(2).uniform(72e9, 82e9, 4096)
    place = Place("4096 tones", plate(3, 2), cloud(10, (0, 0, 0.3)), tones_hz, draws=1)
    return _shares(place, (None, 1e-5))


@hard_case(
    "uneven and tiny grids", quantity="error of volumes by interpolation between nodes", **PROMISED
)
def test_grids() -> Seen:
    generator = np.random.default_rng(3)
    two = np.r_[1e-5 * np.arange(40), 0.1 + 1e-5 * np.arange(40)]
    uneven = [np.cumsum(10 ** generator.uniform(-5, -2.5, n)) for n in (40, 12, 24)]
    grids: dict[str, tuple[np.ndarray, ...]] = {
        "steps from 10 µm to 3 mm": (uneven[0] - uneven[0].mean(), uneven[1], 0.3 + uneven[2]),
        "two heaps 10 cm apart": (two, 1e-3 * np.arange(4), 0.3 + two[::3]),
        "every voxel twice": (np.repeat(2e-4 * np.arange(40), 2), UP, np.array([0.3, 0.3])),
        "through the array": tuple(2e-3 * np.arange(-n, n) for n in (15, 10, 9)),
        "steps of 1e-09 m": tuple(1e-9 * np.arange(n) for n in (40, 12, 20)),
        "one row": (1e-3 * np.arange(30), UP[:1], UP[:1] + 0.3),
        "one column of depths": (UP[:1], UP[:1], 0.3 + 1e-3 * np.arange(30)),
    }
    samples = noise((len(TONES_HZ), *plate().channels), 0)
    for name, axes in grids.items():
        grid = VoxelGrid(*axes)
        points_m = grid.points_m().reshape(-1, 3)
        chosen = np.random.default_rng(4).integers(0, len(points_m), 60)
        [expected] = images(samples[None], plate(), TONES_HZ, points_m[chosen])
        least = float(np.linalg.norm(samples)) * np.sqrt(len(chosen))  # they may cancel by chance
        for tolerance in TOLERANCES:
            found = image_volume(samples, TONES_HZ, plate(), grid, tolerance).ravel()[chosen]
            asked = _asked_of(tolerance, 2 * sum(samples.shape[1:]) + len(samples), TONES_HZ, 0.5)
            yield f"{name}, {_asked(tolerance)}", _relative(found, expected, least) / asked


@hard_case(
    "echoes of points close to antennas",
    quantity="error of echoes that fade as 1/R, R → 0",
    **PROMISED,
)
def test_echoes() -> Seen:
    places = {
        f"z = {z_m:g} m": cloud(40, (0, 0, 0)) * [1, 1, 0.02] + [0, 0, z_m]
        for z_m in (0.3, 0.03, 3e-3, 1e-3)
    }
    places |= {
        f"{r_m:g} m above antennas": plate(40, 40).tx_m[:3] + [0, 0, r_m]
        for r_m in (1e-3, 1e-6, 1e-12, 1e-24)
    }
    places |= {"range 1e5 m": cloud(40, (0, 0, 1e5)), "behind the array": cloud(40, (0, 0, -0.3))}
    for name, points_m in places.items():
        weights = np.random.default_rng(5).standard_normal(len(points_m))
        expected = echoes(weights, plate(40, 40), TONES_HZ, points_m)
        for tolerance in (None, 1e-2, 1e-3, 1e-5):
            found = simulate(
                Scatterers(points_m, weights), TONES_HZ, plate(40, 40), tolerance=tolerance
            )
            asked = _asked_of(tolerance, 2 * len(points_m), TONES_HZ, np.abs(points_m).max())
            yield f"{name}, {_asked(tolerance)}", _relative(found, expected) / asked


def _with(value: float) -> np.ndarray:
    """Points of which one coordinate is `value`."""
    points = cloud(5, (0, 0, 0.3))
    points[3, 1] = value
    return points


@refusal("a scatterer on an antenna", "is on an antenna", "remove it")
def test_on_antenna() -> Works:
    """1/R has no value at R = 0: an echo of NaN would spoil all samples."""
    point = Scatterers(plate().tx_m[4:5], np.ones(1))
    for tolerance in (1e-5, None):
        yield (
            f"tolerance {tolerance}",
            partial(simulate, point, TONES_HZ, plate(), tolerance=tolerance),
        )


@refusal("voxels at NaN, infinity and beyond 10⁷ m", "points_m")
def test_voxels_nowhere() -> Works:
    """No phase: an image of NaN, or a search for their neighbours without an end; beyond, float64
    rounds paths to more than a phase of 1e-5 rad can bear."""
    samples = noise((len(TONES_HZ), *plate().channels), 0)
    for value, tolerance in product((-np.inf, np.inf, np.nan, 1e300, 1.1e7), (1e-3, None)):
        yield (
            f"{value}, tolerance {tolerance}",
            partial(image_points, samples, TONES_HZ, plate(), _with(value), tolerance),
            "unit is metres" if np.isfinite(value) else "NaN or infinite",
        )


@refusal("antennas at NaN, infinity and beyond 10⁷ m", "tx_m", "metres")
def test_antennas() -> Works:
    """No phase, or one that rounding spoils, as for voxels."""
    return (
        (f"at {value}", partial(AntennaArray, _with(value), _with(0.0)))
        for value in (1e300, 1.1e7, np.inf, np.nan)
    )


@refusal("axes that do not ascend", "x_m", "ascending")
def test_unordered() -> Works:
    """Nodes are counted from the first voxel to the last: a descending or shuffled axis has no
    such order."""
    for axis in (UP[:0], np.r_[UP, 0.0], UP[::-1], np.r_[UP, np.nan]):
        yield f"{axis}", partial(VoxelGrid, axis, UP, 0.3 + UP)
