"""Images and echoes by the formula as it stands: the references of every faster path."""

from __future__ import annotations

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray, Aperture
from handbench.radar.imaging.reference import image_points_exact


def _ends_m(aperture: Aperture) -> tuple[np.ndarray, np.ndarray]:
    return aperture.tx_m, aperture.rx_m


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
    tones = zip(samples, frequencies_hz, strict=True)
    images = [
        image_points_exact(s[None], [f], *_ends_m(aperture), np.asarray(points_m)) for s, f in tones
    ]
    return np.array(images) if apart else sum(images)


def direct_echoes(
    position_m: np.ndarray, weight: np.ndarray, frequencies_hz: np.ndarray, aperture: Aperture
) -> np.ndarray:
    """Echoes Σ w e^{−j2πf(|p−t|+|p−r|)/c} without spreading, in float64: complex128 [f, t, r] or
    [f, n]."""
    distances_m = [np.linalg.norm(end[:, None] - position_m, axis=2) for end in _ends_m(aperture)]
    echoes = []
    for f in frequencies_hz:
        to, back = (np.exp(-2j * np.pi * f / SPEED_OF_LIGHT_M_S * r) for r in distances_m)
        of = "p,tp,rp->tr" if isinstance(aperture, AntennaArray) else "p,np,np->n"
        echoes.append(np.einsum(of, weight, to, back, optimize=True))
    return np.array(echoes)
