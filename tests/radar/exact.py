"""The exact path of imaging, as tests call it."""

import numpy as np

from handbench.radar.data.arrays import Aperture
from handbench.radar.imaging.cpu.exact import exact_images


def backproject(
    samples: np.ndarray, frequencies_hz: np.ndarray, aperture: Aperture, points_m: np.ndarray
) -> np.ndarray:
    """`exact_images` of the tones' coherent sum: complex64 [n]."""
    return exact_images(samples, frequencies_hz, aperture, points_m, per_tone=False)[0]
