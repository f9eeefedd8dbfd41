"""Arrays and clouds of points of geometry's cases."""

import numpy as np

from radar.data.arrays import AntennaArray

TONES_HZ = np.linspace(72e9, 82e9, 9)


def array(t: int = 12, r: int = 10, seed: int = 0) -> AntennaArray:
    """Antennas anywhere on a plate of 14 cm."""
    places = np.random.default_rng(seed).uniform(-0.07, 0.07, (t + r, 3)) * [1, 1, 0]
    return AntennaArray(places[:t], places[t:])


def cloud(count: int, middle_m: tuple[float, float, float], half_m: float = 0.015, seed: int = 1) -> np.ndarray:
    """Points [count, 3] within half_m of the middle, metres."""
    return np.random.default_rng(seed).uniform(-half_m, half_m, (count, 3)) + middle_m
