"""Solid textures: reflectance as a function of a body's own coordinates, so that all photographs see the same one."""

from collections.abc import Callable

import numpy as np

from handbench.support.compiled import njit
from handbench.support.parallel import for_each

SKIN_RGB = (0.62, 0.36, 0.25)  # linear reflectances
FOAM_RGB = (0.78, 0.78, 0.76)
STYRODUR_RGB = (0.30, 0.42, 0.48)

# (wavelength in metres, relative contrast): blotches, mottling, pores and skin ridges.
SKIN_OCTAVES = ((9e-3, 0.030), (4e-3, 0.030), (1.8e-3, 0.035), (0.9e-3, 0.045), (0.5e-3, 0.045))
CREASES = ((2.6e-3, 0.10), (1.2e-3, 0.07))  # fine dark lines where a smooth noise crosses zero
BEAD_M = 2.2e-3  # foam beads
BLOCK = 50_000  # points per task


def skin(points_m: np.ndarray, contrast: float, seed: int) -> np.ndarray:
    """Reflectance [n, 3] of skin at points [n, 3]: low-contrast octaves between 9 and 0.5 mm and fine creases."""
    shade = np.zeros(len(points_m), dtype=np.float32)
    for octave, (wavelength_m, amplitude) in enumerate(SKIN_OCTAVES):
        shade += 2.2 * amplitude * solid_noise(points_m, wavelength_m, seed + octave)
    for octave, (wavelength_m, depth) in enumerate(CREASES):
        shade -= depth * np.exp(-((solid_noise(points_m, wavelength_m, seed + 50 + octave) / 0.10) ** 2))
    redness = solid_noise(points_m, 14e-3, seed + 90)
    tint = 1 + 0.10 * redness[:, None] * np.array([0.3, -1.0, -0.8], dtype=np.float32)
    return (np.array(SKIN_RGB, dtype=np.float32) * np.exp(contrast * shade)[:, None] * tint).astype(np.float32)


def foam(points_m: np.ndarray, contrast: float, seed: int) -> np.ndarray:
    """Reflectance [n, 3] of styrofoam: beads with darker seams, each of its own brightness."""
    seam, tone = cells(points_m, BEAD_M, seed)
    shade = 0.16 * tone - 0.35 * np.exp(-((seam / (0.12 * BEAD_M)) ** 2))
    shade += 0.06 * solid_noise(points_m, 0.6e-3, seed + 1)
    return np.array(FOAM_RGB, dtype=np.float32) * np.exp(contrast * shade)[:, None].astype(np.float32)


def styrodur(points_m: np.ndarray, seed: int) -> np.ndarray:
    """Reflectance [n, 3] of extruded foam board: nearly plain."""
    grain = 0.08 * solid_noise(points_m, 2e-3, seed) + 0.06 * solid_noise(points_m, 0.8e-3, seed + 1)
    return np.array(STYRODUR_RGB, dtype=np.float32) * np.exp(grain)[:, None].astype(np.float32)


def solid_noise(points_m: np.ndarray, wavelength_m: float, seed: int) -> np.ndarray:
    """Band-limited gradient noise [n] (about ±1) whose typical period is `wavelength_m`, at points [n, 3]."""
    return _at_points(_gradient_noise, points_m / wavelength_m, seed, 1)[0]


def cells(points_m: np.ndarray, size_m: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Random cells of about `size_m`: distance to the nearest wall [n], metres, and the cell's tone [n] in ±1."""
    seam, tone = _at_points(_cells, points_m / size_m, seed, 2)
    return size_m * seam, tone


def _at_points(kernel: Callable[..., None], points: np.ndarray, seed: int, count: int) -> np.ndarray:
    """`count` values [count, n] of a kernel at points [n, 3] in lattice units, on all cores."""
    result = np.empty((count, len(points)), dtype=np.float32)

    def work(first: int) -> None:
        part = slice(first, first + BLOCK)
        kernel(points[part], np.uint32(seed), result[:, part])

    for_each(work, range(0, len(points), BLOCK))
    return result


@njit(inline="always")
def _hash(i: int, j: int, k: int, seed: np.uint32) -> np.uint32:
    """A well-mixed 32-bit number of a lattice point."""
    h = np.uint32(i * 73856093) ^ np.uint32(j * 19349663) ^ np.uint32(k * 83492791) ^ np.uint32(seed * 2654435761)
    h = np.uint32(h ^ (h >> np.uint32(16))) * np.uint32(0x7FEB352D)
    h = np.uint32(np.uint32(h) ^ (np.uint32(h) >> np.uint32(15))) * np.uint32(0x846CA68B)
    return np.uint32(np.uint32(h) ^ (np.uint32(h) >> np.uint32(16)))


@njit(inline="always")
def _fraction(h: np.uint32, shift: int) -> float:
    """Eight bits of a hash as a number in ±1."""
    return ((h >> np.uint32(shift)) & np.uint32(255)) / 127.5 - 1.0


@njit(inline="always")
def _fade(offset: float) -> float:
    """Quintic weight: 1 at a lattice point, 0 at its neighbours, smooth at both."""
    f = 1 - abs(offset)
    return f**3 * (10 - 15 * f + 6 * f * f)


@njit(nogil=True, cache=True)
def _gradient_noise(points: np.ndarray, seed: np.uint32, result: np.ndarray) -> None:
    """Perlin's noise with hashed gradients and quintic weights."""
    for n in range(len(points)):
        x, y, z = points[n]
        i, j, k = int(np.floor(x)), int(np.floor(y)), int(np.floor(z))
        total = 0.0
        for di in range(2):
            for dj in range(2):
                for dk in range(2):
                    h = _hash(i + di, j + dj, k + dk, seed)
                    a, b, c = x - i - di, y - j - dj, z - k - dk
                    slope = _fraction(h, 0) * a + _fraction(h, 8) * b + _fraction(h, 16) * c
                    total += _fade(a) * _fade(b) * _fade(c) * slope
        result[0, n] = 1.6 * total


@njit(nogil=True, cache=True)
def _cells(points: np.ndarray, seed: np.uint32, result: np.ndarray) -> None:
    """Worley's cells: one jittered centre per lattice cube."""
    for n in range(len(points)):
        x, y, z = points[n]
        i, j, k = int(np.floor(x)), int(np.floor(y)), int(np.floor(z))
        first, second, tone = 1e9, 1e9, 0.0
        for di in range(-1, 2):
            for dj in range(-1, 2):
                for dk in range(-1, 2):
                    h = _hash(i + di, j + dj, k + dk, seed)
                    a = i + di + 0.5 + 0.45 * _fraction(h, 0) - x
                    b = j + dj + 0.5 + 0.45 * _fraction(h, 8) - y
                    c = k + dk + 0.5 + 0.45 * _fraction(h, 16) - z
                    distance = np.sqrt(a * a + b * b + c * c)
                    if distance < first:
                        first, second, tone = distance, first, _fraction(h, 24)
                    elif distance < second:
                        second = distance
        result[0, n], result[1, n] = 0.5 * (second - first), tone
