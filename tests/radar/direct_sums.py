"""Images and echoes by the formula as it stands: the references of every faster path."""

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaPairs, Aperture
from handbench.radar.imaging.exact import image_points_exact


def direct_sum(
    samples: np.ndarray,
    frequencies_hz: np.ndarray,
    aperture: Aperture,
    points_m: np.ndarray,
    apart: bool = False,
) -> np.ndarray:
    """`image_points_exact` of an array's samples [f, t, r], or of those [f, n] of a scan, whose
    n-th receiver receives from the n-th transmitter alone: complex128 [n] at points_m [n, 3], or
    [f, n] with the tones apart."""
    ends_m, points_m = (aperture.tx_m, aperture.rx_m), np.asarray(points_m)
    if not apart:
        return image_points_exact(samples, frequencies_hz, *ends_m, points_m)
    tones = zip(samples, frequencies_hz, strict=True)
    return np.array([image_points_exact(s[None], [f], *ends_m, points_m) for s, f in tones])


def direct_echoes(
    position_m: np.ndarray, weight: np.ndarray, frequencies_hz: np.ndarray, aperture: Aperture
) -> np.ndarray:
    """Echoes Σ w e^{−j2πf(|p−t|+|p−r|)/c} without spreading, in float64: complex128 [f, t, r] or
    [f, n]."""
    distances_m = [
        np.linalg.norm(end_m[:, None] - position_m, axis=2)
        for end_m in (aperture.tx_m, aperture.rx_m)
    ]
    echoes = []
    for f in frequencies_hz:
        to, back = (np.exp(-2j * np.pi * f / SPEED_OF_LIGHT_M_S * r) for r in distances_m)
        pairs = isinstance(aperture, AntennaPairs)
        echoes.append((to * back) @ weight if pairs else (to * weight) @ back.T)
    return np.array(echoes)
