"""Backprojection by its formula, in plain numpy: the reference that every faster implementation is
compared with."""

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray, Aperture, channel_ends
from handbench.radar.data.grid import VoxelGrid


def image_points_exact(
    samples: np.ndarray,
    frequencies_hz: np.ndarray,
    transmitters_m: np.ndarray,
    receivers_m: np.ndarray,
    points_m: np.ndarray,
) -> np.ndarray:
    """Compute the image O(p) = Σ_f Σ_t Σ_r S_f[t, r] exp(+j2πf(|p − t| + |p − r|)/c) at points p:
    complex128 [p].

    samples: S, complex [f, t, r] for tones, transmitters and receivers, or [f, n] if receiver i
    receives only from transmitter i; frequencies_hz: [f]; transmitters_m [t, 3], receivers_m [r, 3]
    and points_m [p, 3]: positions in metres. Raises ValueError if the shapes do not fit.
    """
    ends_m = (transmitters_m, receivers_m)
    to_m, back_m = (np.linalg.norm(points_m - end_m[:, None], axis=2) for end_m in ends_m)
    image = np.zeros(len(points_m), np.complex128)
    for s, f in zip(samples, frequencies_hz, strict=True):
        to, back = (np.exp(2j * np.pi * f * r_m / SPEED_OF_LIGHT_M_S) for r_m in (to_m, back_m))
        image += s @ (to * back) if s.ndim == 1 else ((s.T @ to) * back).sum(axis=0)
    return image


def imaging_error(
    image: np.ndarray,
    samples: np.ndarray,
    frequencies_hz: np.ndarray,
    aperture: Aperture,
    grid: VoxelGrid,
    count: int = 500,
) -> float:
    """Estimate the relative L2 error √(mean |I(p) − O(p)|² / mean |I|²) of a volume I [nz, ny, nx]
    from its exact sums O at `count` random voxels p.

    samples: the echoes that were imaged, complex [f, t, r], or [f, n] of a scan; grid: the voxels.
    """
    picked = np.random.default_rng(0).integers(0, image.size, count)
    ends_m = (
        (aperture.tx_m, aperture.rx_m)
        if isinstance(aperture, AntennaArray)
        else channel_ends(aperture)
    )
    exact = image_points_exact(samples, frequencies_hz, *ends_m, grid.points_at_m(picked))
    error, size = image.ravel()[picked] - exact, np.mean(np.abs(image) ** 2, dtype=np.float64)
    return float(np.sqrt(np.divide(np.mean(np.abs(error) ** 2), size)))
