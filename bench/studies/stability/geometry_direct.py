"""Arrays, noise, and images and echoes by the formula as it stands, in float64: what geometry's cases compare with.

Written apart from the product, of which only the formula is shared: O(p) = Σ S e^{+j2πf(|p−t|+|p−r|)/c}.
"""

import numpy as np

from radar.data.arrays import AntennaArray

LIGHT_M_S = 299_792_458.0
TONES_HZ = np.linspace(72e9, 82e9, 9)


def array(t: int = 12, r: int = 10, seed: int = 0) -> AntennaArray:
    """Antennas anywhere on a plate of 14 cm."""
    places = np.random.default_rng(seed).uniform(-0.07, 0.07, (t + r, 3)) * [1, 1, 0]
    return AntennaArray(places[:t], places[t:])


def cloud(count: int, middle_m: tuple[float, float, float], half_m: float = 0.015, seed: int = 1) -> np.ndarray:
    """Points [count, 3] within half_m of the middle, metres."""
    return np.random.default_rng(seed).uniform(-half_m, half_m, (count, 3)) + middle_m


def legs_m(antennas: AntennaArray, points_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances of points to transmitters [p, t] and receivers [p, r]."""
    to, back = (np.sqrt(((points_m[:, None] - leg[None]) ** 2).sum(axis=2)) for leg in (antennas.tx_m, antennas.rx_m))
    return to, back


def waves(antennas: AntennaArray, tones_hz: np.ndarray, points_m: np.ndarray) -> np.ndarray:
    """e^{+j2πf(|p−t|+|p−r|)/c}: complex128 [f, p, t, r]."""
    to, back = legs_m(antennas, points_m)
    turns = tones_hz[:, None, None, None] * (to[:, :, None] + back[:, None, :]) / LIGHT_M_S
    return np.exp(2j * np.pi * (turns - np.round(turns)))


def image(samples: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Samples [f, t, r] imaged along `waves`: [p]."""
    return np.einsum("fptr,ftr->p", along, samples.astype(np.complex128), optimize=True)


def echoes(weights: np.ndarray, antennas: AntennaArray, tones_hz: np.ndarray, points_m: np.ndarray) -> np.ndarray:
    """Samples [f, t, r] of points that scatter evenly, each leg fading as 1/R."""
    to, back = legs_m(antennas, points_m)
    fading = weights[:, None, None] / (to[:, :, None] * back[:, None, :])
    return np.einsum("ptr,fptr->ftr", fading, waves(antennas, tones_hz, points_m).conj(), optimize=True)
