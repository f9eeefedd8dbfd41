"""Exact backprojection on a device, one complex product per tone and block: `radar.imaging.cpu.exact` as array code
over numpy or cupy (`xp`).

A planar scan is an array whose second leg is one antenna that the wave meets zero times.
"""

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, Aperture, as_of_an_array
from handbench.radar.imaging.cpu.exact import check_samples
from handbench.radar.imaging.device import BLOCK_BYTES, array_module, cis, distances, to_host

POINT_BYTES = 48  # per point and antenna: distances in double, their turns, phases and products


def exact_images(
    samples: np.ndarray, frequencies_hz: np.ndarray, aperture: Aperture, points_m: np.ndarray, apart: bool
) -> np.ndarray:
    """As `radar.imaging.cpu.exact.exact_images`: complex64 [f or 1, n] at points_m [n, 3]."""
    check_samples(samples, frequencies_hz, aperture)
    xp = array_module()
    turns_per_m = np.asarray(frequencies_hz, np.float64) / SPEED_OF_LIGHT_M_S
    matrices = samples.reshape(*samples.shape[:2], -1).swapaxes(1, 2)  # receivers first
    matrices, (n_b, n_a) = xp.asarray(matrices, dtype=np.complex64), matrices.shape[1:]
    images = np.empty((len(samples) if apart else 1, len(points_m)), np.complex64)
    block = max(BLOCK_BYTES // (POINT_BYTES * (n_a + n_b)), 1)
    for start in range(0, len(points_m), block):
        here = slice(start, start + block)
        points = xp.asarray(np.ascontiguousarray(points_m[here].T, np.float64))[:, None]
        lengths = [
            leg.passes * distances(xp, points, xp.asarray(leg.position_m.T)[:, :, None]) for leg in aperture.legs
        ]
        paths_a, paths_b = as_of_an_array(aperture, lengths)
        part = xp.zeros((len(images), points.shape[2]), np.complex64)
        for f, turns in enumerate(turns_per_m):
            heard = xp.matmul(matrices[f], cis(xp, turns * paths_a))  # a scan's sum over positions is a product
            heard *= cis(xp, turns * paths_b)
            part[f if apart else 0] += heard.sum(axis=0)
        images[:, here] = to_host(part)
    return images
