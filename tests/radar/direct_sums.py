"""The image by the formula as it stands: the reference of every faster path."""

from __future__ import annotations

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, Aperture, positions
from handbench.radar.imaging.cpu.exact import check_samples, path_lengths


def direct_sum(
    samples: np.ndarray, frequencies_hz: np.ndarray, aperture: Aperture, points_m: np.ndarray
) -> np.ndarray:
    """Σ S e^{+j2πf(|p−t|+|p−r|)/c} in float64 over every tone and channel: complex128 [n] at
    points_m [n, 3]."""
    check_samples(samples, frequencies_hz, aperture)
    image = np.zeros(len(points_m), np.complex128)
    for i, point in enumerate(positions("points_m", points_m)):
        path_m = path_lengths(aperture, point)
        for s, f in zip(samples, frequencies_hz, strict=True):
            image[i] += np.sum(s * np.exp(2j * np.pi * f * path_m / SPEED_OF_LIGHT_M_S))
    return image
