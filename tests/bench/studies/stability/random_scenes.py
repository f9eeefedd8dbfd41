"""Random hard scenes: a cloud of random points on a known surface (so that speckle comes with it)
before an array of 24 + 24 antennas, with noise from far below to above what the paper's radar has,
and what makes them harder still.

`silent_errors.py` counts the silent wrong answers in them, `tests/bench/studies/trust` calibrates
p_gross on them.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from handbench.radar.data.capture import RadarCapture
from handbench.radar.simulation.forward import Scatterers, simulate
from tests.hard_cases.scenes import small_array

POINTS, HALF_M = 300, 0.024
AXIS = {
    "start_m": -0.02,
    "stop_m": 0.02,
    "step_m": 0.00125,
}  # the filters' 5 pixels are little more than a cell
WITHIN_M = np.linspace(-2.5e-3, 2.5e-3, 5)  # the paper's lateral resolution: 5 mm
NOISE_DB = (-60.0, 0.0)  # of a channel's echo: the image gains the number of channels, 28 dB
TONES_HZ = np.array([82.0e9, 81.8e9, 79.5e9])
ARRAY = small_array(4)  # 24 + 24 antennas

Surface = Callable[[np.ndarray, np.ndarray], np.ndarray]


def tilted(rng: np.random.Generator) -> Surface:
    """A plane, turned by up to 40°."""
    slope = np.tan(np.deg2rad(rng.uniform(-40, 40, 2)))
    return lambda x, y: slope[0] * x + slope[1] * y


def bumpy(rng: np.random.Generator) -> Surface:
    """Waves 1 to 6 mm high, 10 to 40 mm long."""
    height_m, length_m, phase = (
        rng.uniform(1e-3, 6e-3),
        rng.uniform(0.01, 0.04),
        rng.uniform(0, 2 * np.pi, 2),
    )
    return lambda x, y: (
        height_m
        * np.sin(2 * np.pi * x / length_m + phase[0])
        * np.sin(2 * np.pi * y / length_m + phase[1])
    )


def step(rng: np.random.Generator) -> Surface:
    """An edge, 2 to 50 mm deep: deeper than ±30 mm lies beyond what three tones can tell apart."""
    height_m, place_m = rng.uniform(2e-3, 0.05), rng.uniform(-0.01, 0.01)
    return lambda x, y: np.where(x > place_m, height_m, 0.0)


def fingers(rng: np.random.Generator) -> Surface:
    """Cylinders of 8 to 16 mm side by side, over a palm 5 to 25 mm further back."""
    width_m, depth_m = rng.uniform(0.008, 0.016), rng.uniform(0.005, 0.025)

    def z_m(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        beside = np.mod(x, 1.3 * width_m) - 0.65 * width_m
        inside = np.maximum((width_m / 2) ** 2 - beside**2, 0)
        return np.where(inside > 0, depth_m - np.sqrt(inside) - width_m / 2, depth_m)

    return z_m


KINDS: dict[str, Callable[[np.random.Generator], Surface]] = {
    kind.__name__: kind for kind in (tilted, bumpy, step, fingers)
}
TROUBLES = ("none", "glint", "clutter", "dead", "clipped")


def recorded(
    surface: Surface,
    middle_m: float,
    trouble: str,
    rng: np.random.Generator,
    tones_hz: np.ndarray = TONES_HZ,
) -> tuple[RadarCapture, np.ndarray]:
    """Echoes of the surface with noise, and what else makes them hard; places [n, 3] of clutter
    that is none of it."""
    xy = rng.uniform(-HALF_M, HALF_M, (POINTS, 2))
    points_m = np.column_stack([xy, middle_m + surface(*xy.T)])
    weight = rng.standard_normal(POINTS)
    if trouble == "glint":
        weight[0] = 10 ** rng.uniform(1, 2)
    if trouble == "clutter":
        points_m = np.vstack([points_m, rng.uniform((-0.1, -0.1, 0.2), (0.1, 0.1, 0.5), (5, 3))])
        weight = np.append(weight, 10 * rng.standard_normal(5))
    samples = simulate(
        Scatterers(points_m, weight), tones_hz, ARRAY, spreading=False, tolerance=None
    )
    level = np.sqrt(np.mean(np.abs(samples) ** 2)) * 10 ** (rng.uniform(*NOISE_DB) / 20)
    noise = rng.standard_normal((2, *samples.shape)) * level / np.sqrt(2)
    samples = samples + noise[0] + 1j * noise[1]
    if trouble == "dead":
        samples[:, rng.integers(0, len(ARRAY.tx_m), 4)] = 0
    if trouble == "clipped":
        most = np.abs(samples).max() * rng.uniform(0.2, 0.8)
        samples = np.clip(samples.view(float), -most, most).view(complex)
    return RadarCapture(samples[None].astype(np.complex64), tones_hz, ARRAY), points_m[POINTS:]
