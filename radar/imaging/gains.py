"""The gains of legs as skeletons meet them: which are smooth from antenna to antenna, and samples of those that are."""

from __future__ import annotations

import numba
import numpy as np

from radar.imaging.cpu.steering import FAST

# Gains that bend too sharply across the array to be carried by few antennas:
GRAZING = 0.05  # √(n·û) where the cosine falls below this,
FADED = 0.35  # a pattern that falls below this (half the tolerance was measured at 0.3 m).


def least_cosine(pattern: float) -> float:
    """Smallest cosine from the z axis at which the pattern cosᵠθ of an antenna is still smooth."""
    return max(GRAZING, FADED ** (1 / pattern)) if pattern != 0 else -1.0


def probe_gains(points_m: np.ndarray, antennas_m: np.ndarray, pattern: float) -> np.ndarray:
    """Smooth gains [p, a] at points [p, 3], of unit mean square over the antennas [a, 3]: 1/R and the pattern, for half
    of the points and more; for the others times the √(n·û) of a facet, whose normals stand evenly over all that every
    antenna sees."""
    return _probe_gains(points_m, _normals(len(points_m)), antennas_m, float(pattern), least_cosine(pattern))


def _normals(count: int) -> np.ndarray:
    """Unit vectors [count, 3] evenly over the sphere: an additive sequence, the same every time."""
    plastic = 1.324717957244746  # g³ = g + 1: the ratio for two dimensions
    u = (0.5 + np.arange(count)[:, None] / plastic ** np.arange(1, 3)) % 1.0
    z, azimuth = 2 * u[:, 0] - 1, 2 * np.pi * u[:, 1]
    across = np.sqrt(1 - z**2)
    return np.stack([across * np.cos(azimuth), across * np.sin(azimuth), z], axis=1)


@numba.njit(**FAST)
def _probe_gains(points_m, normals, antennas_m, pattern, least):  # type: ignore[no-untyped-def]
    n_points, n_antennas = len(points_m), len(antennas_m)
    gains, obliquity, axial = np.empty((n_points, n_antennas)), np.empty(n_antennas), np.empty(n_antennas)
    for p in range(n_points):
        nx, ny, nz = normals[p, 0], normals[p, 1], normals[p, 2]
        for a in range(n_antennas):
            dx, dy = antennas_m[a, 0] - points_m[p, 0], antennas_m[a, 1] - points_m[p, 1]
            dz = antennas_m[a, 2] - points_m[p, 2]
            nearness = 1 / np.sqrt(dx * dx + dy * dy + dz * dz)
            gains[p, a], axial[a] = nearness, -dz * nearness
            obliquity[a] = (nx * dx + ny * dy + nz * dz) * nearness
        if obliquity.min() >= GRAZING:
            gains[p] *= np.sqrt(obliquity)
        if pattern != 0.0 and axial.min() >= least:
            gains[p] *= axial**pattern
        gains[p] /= np.sqrt(np.mean(gains[p] ** 2))
    return gains
