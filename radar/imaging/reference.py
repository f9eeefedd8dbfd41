"""Backprojection by its formula, in plain numpy: the reference that every faster implementation is
compared with."""

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S


def image_points_exact(
    samples: np.ndarray,
    frequencies_hz: np.ndarray,
    transmitters_m: np.ndarray,
    receivers_m: np.ndarray,
    points_m: np.ndarray,
) -> np.ndarray:
    """Compute the image O(p) = Σ_f Σ_t Σ_r S_f[t, r] exp(+j2πf(|p − t| + |p − r|)/c) at points p:
    complex128 [n].

    samples: S, complex [f, t, r] for tones, transmitters and receivers; frequencies_hz: [f];
    transmitters_m [t, 3], receivers_m [r, 3] and points_m [n, 3]: positions in metres. Raises
    ValueError if the shapes do not fit.
    """
    ends_m = (transmitters_m, receivers_m)
    to_m, back_m = (np.linalg.norm(points_m - end_m[:, None], axis=2) for end_m in ends_m)
    image = np.zeros(len(points_m), np.complex128)
    for s, f in zip(samples, frequencies_hz, strict=True):
        to, back = (np.exp(2j * np.pi * f * r_m / SPEED_OF_LIGHT_M_S) for r_m in (to_m, back_m))
        image += np.einsum("tr,tp,rp->p", s, to, back, optimize=True)
    return image
