"""Echoes by the formula as it stands: the reference of every faster path."""

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, Aperture
from handbench.radar.imaging.cpu.exact import path_lengths


def direct_echoes(
    position_m: np.ndarray, weight: np.ndarray, frequencies_hz: np.ndarray, aperture: Aperture
) -> np.ndarray:
    """Echoes without spreading by the formula as it stands, in float64: complex128 [f, t, r] or [f,
    n]. The reference of every faster path."""
    samples = np.zeros((len(frequencies_hz), *aperture.channels), np.complex128)
    for point, w in zip(np.asarray(position_m, np.float64), weight, strict=True):
        path_m = path_lengths(aperture, point)
        for sample, f in zip(samples, frequencies_hz, strict=True):
            sample += w * np.exp(-2j * np.pi * f * path_m / SPEED_OF_LIGHT_M_S)
    return samples
