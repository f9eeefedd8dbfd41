"""Bands: how fast an image can vary over a box, from the geometry alone."""

from __future__ import annotations

import numpy as np

from radar.data.arrays import SPEED_OF_LIGHT_M_S, Aperture
from radar.imaging.tree import Box

PROBES = 7  # points along each axis of the box at which the local band is looked up


def carriers(aperture: Aperture) -> tuple[np.ndarray, np.ndarray]:
    """What `bands` takes the path of out: passes [2] and reference points [2, 3], the middle of each leg's antennas."""
    passes = np.array([float(leg.passes) for leg in aperture.legs])
    return passes, np.array([leg.position_m.mean(axis=0) for leg in aperture.legs])


def bands(frequencies_hz: np.ndarray, aperture: Aperture, box: Box) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest spatial frequency [3], [3] (rad/m) that an image has along x, y, z within the box, once
    exp(jk_c Σ R_reference) is taken out of it."""
    wavenumber = 2 * np.pi * np.asarray(frequencies_hz) / SPEED_OF_LIGHT_M_S
    k_c = (wavenumber.min() + wavenumber.max()) / 2
    axes = [np.linspace(low, high, PROBES if high > low else 1) for low, high in zip(*box, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    low, high = np.zeros_like(points), np.zeros_like(points)
    for leg, passes, reference_m in zip(aperture.legs, *carriers(aperture), strict=True):
        about = k_c * passes * _direction(points, reference_m)
        least, most = np.full_like(points, np.inf), np.full_like(points, -np.inf)
        for antenna in leg.position_m:
            seen = leg.passes * _direction(points, antenna)
            np.minimum(least, seen, out=least)
            np.maximum(most, seen, out=most)
        ends = wavenumber.min(), wavenumber.max()
        low += np.minimum(ends[0] * least, ends[1] * least) - about
        high += np.maximum(ends[0] * most, ends[1] * most) - about
    return low.min(axis=0), high.max(axis=0)


def _direction(points_m: np.ndarray, antenna_m: np.ndarray) -> np.ndarray:
    towards = points_m - antenna_m
    return towards / np.maximum(np.linalg.norm(towards, axis=1), 1e-12)[:, None]
