"""Errors of single precision in images and echoes, against double precision or the closed form.

u = 2⁻²⁴ is the rounding of float32. A sum of n products in it errs by at most n·u of the sum of their magnitudes, in
any order (Higham 2002, sec. 3.1); white noise, whose sum is far smaller than that, shows the errors best.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from bench.studies.stability.geometry_direct import image, waves
from bench.studies.stability.scenes import POINT_M, C, small_array, white_noise
from radar.data.arrays import AntennaArray, Aperture, PlanarScan, qar50
from radar.data.grid import VoxelGrid
from radar.imaging.api import image_points, image_volume, project_volume
from radar.imaging.cpu.exact import backproject, direct_sum, path_lengths
from radar.imaging.cpu.steering import cis_turns
from radar.simulation.forward import Scatterers, direct_echoes, simulate

U = 2.0**-24  # rounding of single precision
STEER = 4 * U  # a steering phase, radians: its remainder rounds to π/2·u, cosine and sine by 2u
PAIR_MM = 1e3 * C / (4 * np.pi * 0.2e9)  # depth per radian between the closest tones
TONES_HZ = np.linspace(72e9, 82e9, 16)
MANY_HZ = np.linspace(72e9, 82e9, 4096)
UNEVEN_HZ = np.sort(np.random.default_rng(7).uniform(72e9, 82e9, 16))
GRID = VoxelGrid(np.linspace(-0.01, 0.01, 11), np.linspace(-0.01, 0.01, 11), np.linspace(0.27, 0.29, 21))


class Line(NamedTuple):
    """One path: where it uses single precision, the bound of its error, the error, their unit, and what it moves a
    depth by at most, millimetres (None: no depth comes of it)."""

    path: str
    single: str
    bound: float
    measured: float
    unit: str
    depth_mm: float | None


def of_samples() -> Iterator[Line]:
    path_m = path_lengths(small_array(), np.array(POINT_M))
    exact = np.exp(-2j * np.pi * 82e9 * path_m / C)
    error = float(np.abs(np.angle(exact.astype(np.complex64).astype(np.complex128) / exact)).max())
    yield image_line("samples of a capture", "real and imaginary part", U, error)


def of_steering() -> Iterator[Line]:
    for range_m in (0.3, 2.0, 20.0):
        turns = np.random.default_rng(0).uniform(0.5, 1.0, 4000) * 2 * range_m * 82e9 / C
        found = np.array([cis_turns(t) for t in turns])
        phase = 2 * np.pi * np.mod(turns, 1.0)  # exact: the remainder of a float64 is one
        measured = np.abs(found - np.stack([np.cos(phase), np.sin(phase)], axis=1)).max()
        where = "cosine and sine of the remainder of a turn, itself in double"
        yield image_line(f"steering at {range_m:g} m", where, STEER, measured)


def of_exact() -> Iterator[Line]:
    points = GRID.points_m().reshape(-1, 3)[::40]
    for name, array, tones in (
        ("exact points, 94 + 94 antennas", qar50(), TONES_HZ[:4]),
        ("exact points, tones unevenly spaced", small_array(), UNEVEN_HZ),
        ("exact points, 4096 tones", AntennaArray(small_array().tx_m[:3], small_array().rx_m[:3]), MANY_HZ),
    ):
        samples = white_noise((len(tones), *array.channels))
        found = backproject(samples, tones, array, points)
        bound = sums(array, len(tones))
        error = np.abs(found - direct_sum(samples, tones, array, points)).max() / np.abs(samples).sum()
        yield image_line(name, "steering, products, sums over antennas and tones", bound, error)
    samples = white_noise((len(TONES_HZ), *small_array().channels))
    found = image_volume(samples, TONES_HZ, small_array(), GRID, None).ravel()
    error = np.abs(found - _volume(samples)).max() / np.abs(samples).sum()
    yield image_line("exact volume", "as exact points", sums(small_array(), len(TONES_HZ)), error)


def sums(array: Aperture, tones: int) -> float:
    """Most that an exact image errs by, over Σ|S|: steering twice, and sums over 2t, 2r and the tones."""
    t, r = (len(leg.position_m) for leg in array.legs)
    return 2 * STEER + (2 * t + 2 * r + tones) * U


def of_fast() -> Iterator[Line]:
    samples = white_noise((len(TONES_HZ), *small_array().channels))
    exact = _volume(samples)
    strongest = np.abs(exact.reshape(GRID.shape)).max(axis=0)
    for tolerance in (1e-3, 1e-5):
        bound = tolerance + fast_floor(len(TONES_HZ))
        where = f"weights, phases within a leaf, products; tolerance {tolerance:g}"
        volume = image_volume(samples, TONES_HZ, small_array(), GRID, tolerance).ravel()
        yield image_line("fast volume", where, bound, relative(volume, exact))
        _, magnitude = project_volume(samples, TONES_HZ, small_array(), GRID, tolerance)
        yield image_line("fast projection", where, bound, relative(magnitude[1], strongest))
        points = GRID.points_m().reshape(-1, 3)[::7]
        uneven = white_noise((len(UNEVEN_HZ), *small_array().channels))
        found = image_points(uneven, UNEVEN_HZ, small_array(), points, tolerance)
        error = relative(found, direct_sum(uneven, UNEVEN_HZ, small_array(), points))
        bound = tolerance + fast_floor(len(UNEVEN_HZ))
        yield image_line("fast points, tones unevenly spaced", where, bound, error)


def fast_floor(tones: int) -> float:
    """The roundings of the fast chain on noise, relative L2: three levels, each a steering and products of three sums
    whose roundings are independent, so that they grow with the root of their terms."""
    terms = 2 * sum(small_array().channels) + tones
    return 3 * (2 * STEER + np.sqrt(terms) * U)


def of_scan() -> Iterator[Line]:
    generator = np.random.default_rng(2)
    scan = PlanarScan(np.stack([*generator.uniform(-0.07, 0.07, (2, 300)), np.zeros(300)], axis=1))
    samples, points = white_noise((4, 300)), GRID.points_m().reshape(-1, 3)[::40]
    exact = direct_sum(samples, TONES_HZ[:4], scan, points)
    error = np.abs(backproject(samples, TONES_HZ[:4], scan, points) - exact).max() / np.abs(samples).sum()
    yield image_line("planar scan", "steering; sums over positions in double", STEER + 5 * U, error)


def of_forward() -> Iterator[Line]:
    generator, count = np.random.default_rng(3), 300
    position = np.array(POINT_M) + generator.uniform(-0.01, 0.01, (count, 3))
    weight = generator.normal(size=count)
    exact = direct_echoes(position, weight, TONES_HZ, small_array())
    scatterers = Scatterers(position, weight)
    found = simulate(scatterers, TONES_HZ, small_array(), spreading=False, tolerance=None)
    error = np.abs(found - exact).max() / np.abs(weight).sum()
    yield image_line("forward model, exact", "gains, steering, sums", 2 * STEER + (count + 6) * U, error)
    found = simulate(scatterers, TONES_HZ, small_array(), spreading=False, tolerance=1e-5)
    bound = 1e-5 + fast_floor(len(TONES_HZ)) + np.sqrt(count) * U
    yield image_line("forward model, fast", "as fast volume; tolerance 1e-05", bound, relative(found, exact))


def image_line(path: str, single: str, bound: float, measured: float) -> Line:
    """A line about a relative error of images or echoes: two of them, at the strongest pixel, make a depth."""
    return Line(path, single, float(bound), float(measured), "1", 2 * PAIR_MM * float(measured))


def _volume(samples: np.ndarray) -> np.ndarray:
    """The exact volume [n] in double precision."""
    return image(samples, waves(small_array(), TONES_HZ, GRID.points_m().reshape(-1, 3)))


def relative(found: np.ndarray, exact: np.ndarray) -> float:
    return float(np.linalg.norm(found - exact) / np.linalg.norm(exact))
