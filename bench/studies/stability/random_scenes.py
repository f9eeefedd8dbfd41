"""No silent wrong answer: thousands of random hard scenes, and every pixel that is further off than its σ allows.

A scene is a cloud of random points on a known surface (so that speckle comes with it) before an array of 24 + 24
antennas, with noise from far below to above what the paper's radar has. A depth map states its own error, σ, and flags
pixels whose phase may have wrapped. A pixel that is off by more than 5σ and bears no flag is a silent wrong answer:
such pixels are counted, by what makes the scene hard. Off means: from every depth that the surface has within the
pixel's resolution cell, for at an edge none of them is wrong.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache

import numpy as np

from bench.results.stability import Table
from radar.data.arrays import AntennaArray, qar50
from radar.data.capture import RadarCapture
from radar.data.depthmap import DepthMap
from radar.methods.fsk import three_tone, two_tone
from radar.methods.fsk_config import ThreeToneConfig, TwoToneConfig
from radar.simulation.forward import Scatterers, simulate
from radar.support.errors import HandbenchError
from radar.support.parallel import workers
from radar.support.progress import track

SIGMAS = 5.0
POINTS, HALF_M = 300, 0.024
AXIS = {"start_m": -0.02, "stop_m": 0.02, "step_m": 0.00125}  # the filters' 5 pixels are little more than a cell
WITHIN_M = np.linspace(-2.5e-3, 2.5e-3, 5)  # the paper's lateral resolution: 5 mm
NOISE_DB = (-60.0, 0.0)  # of a channel's echo: the image gains the number of channels, 28 dB
TONES_HZ = np.array([82.0e9, 81.8e9, 79.5e9])

Surface = Callable[[np.ndarray, np.ndarray], np.ndarray]


def tilted(rng: np.random.Generator) -> Surface:
    """A plane, turned by up to 40°."""
    slope = np.tan(np.deg2rad(rng.uniform(-40, 40, 2)))
    return lambda x, y: slope[0] * x + slope[1] * y


def bumpy(rng: np.random.Generator) -> Surface:
    """Waves 1 to 6 mm high, 10 to 40 mm long."""
    height_m, length_m, phase = rng.uniform(1e-3, 6e-3), rng.uniform(0.01, 0.04), rng.uniform(0, 2 * np.pi, 2)
    return lambda x, y: (
        height_m * np.sin(2 * np.pi * x / length_m + phase[0]) * np.sin(2 * np.pi * y / length_m + phase[1])
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


@dataclass
class Count:
    """Scenes, those refused, pixels that were given, those off by more than 5σ, of these flagged, and the silent ones
    that are off by more than 5 mm too."""

    scenes: int = 0
    refused: int = 0
    pixels: int = 0
    beyond: int = 0
    flagged: int = 0
    gross: int = 0

    def __add__(self, other: Count) -> Count:
        return Count(*(a + b for a, b in zip(vars(self).values(), vars(other).values(), strict=True)))


def table(seed: int = 0, scenes: int = 10_000) -> Table:
    """Count over `scenes` random scenes, drawn from `seed`; the same on any number of threads."""
    counts: dict[tuple[str, str, str], Count] = {}
    with ThreadPoolExecutor(workers()) as pool:
        for found in track(pool.map(lambda number: scene(seed, number), range(scenes)), "random scenes", scenes):
            for key, count in found.items():
                counts[key] = counts.get(key, Count()) + count
    lines = []
    for column, names in enumerate((("2fsk", "3fsk"), tuple(KINDS), TROUBLES)):
        for name in names:
            together = sum((count for key, count in counts.items() if key[column] == name), Count())
            lines.append((name, *vars(together).values(), _percent(together)))
    whole = sum(counts.values(), Count())
    silent = whole.beyond - whole.flagged
    return Table(
        title=f"{scenes} random hard scenes",
        text=f"{whole.pixels} pixels, {whole.beyond} off by more than {SIGMAS:g}σ of their own; {whole.flagged} "
        f"of these are flagged, {silent} are silent",
        columns=("", "depth maps", "refused", "pixels", "beyond 5σ", "flagged", "silent, > 5 mm", "silent %"),
        rows=tuple(lines),
    )


def _percent(count: Count) -> float:
    return 100 * (count.beyond - count.flagged) / max(count.pixels, 1)


def scene(seed: int, number: int) -> dict[tuple[str, str, str], Count]:
    """(method, surface, trouble) → what one scene's depth maps come to."""
    rng = np.random.default_rng([seed, number])
    kind, trouble = list(KINDS)[number % len(KINDS)], TROUBLES[number // len(KINDS) % len(TROUBLES)]
    surface, middle_m = KINDS[kind](rng), rng.uniform(0.25, 0.35)
    capture = _recorded(surface, middle_m, trouble, rng)
    first_m = middle_m + rng.uniform(-0.1, 0.1)
    known = {"x": AXIS, "y": AXIS, "off_axis": True, "first_depth_m": first_m, "tolerance": None}
    methods = {"2fsk": (two_tone, TwoToneConfig(**known)), "3fsk": (three_tone, ThreeToneConfig(**known))}
    counts = {}
    for name, (method, config) in methods.items():
        try:
            counts[name, kind, trouble] = _count(method(capture, config), surface, middle_m)
        except HandbenchError:
            counts[name, kind, trouble] = Count(scenes=1, refused=1)
    return counts


def _count(depth: DepthMap, surface: Surface, middle_m: float) -> Count:
    given = np.isfinite(depth.z_m)
    y, x = (depth.y_m[:, None] + WITHIN_M[:, None, None, None], depth.x_m + WITHIN_M[:, None, None])
    within_m = middle_m + surface(*np.broadcast_arrays(x, y))
    beside_m = np.maximum(within_m.min(axis=(0, 1)) - depth.z_m, depth.z_m - within_m.max(axis=(0, 1)))
    error_m = np.maximum(beside_m, 0)[given]
    with np.errstate(invalid="ignore"):
        beyond = ~(error_m <= SIGMAS * depth.sigma_m[given])  # a σ that is no number covers nothing
    flagged = beyond & depth.wrapped[given]
    gross = beyond & ~flagged & (error_m > 5e-3)
    return Count(1, 0, int(given.sum()), int(beyond.sum()), int(flagged.sum()), int(gross.sum()))


@cache
def _array() -> AntennaArray:
    whole = qar50()
    return AntennaArray(whole.tx_m[::4], whole.rx_m[::4])


def _recorded(surface: Surface, middle_m: float, trouble: str, rng: np.random.Generator) -> RadarCapture:
    """Echoes of the surface with noise, and what else makes them hard."""
    xy = rng.uniform(-HALF_M, HALF_M, (POINTS, 2))
    points_m = np.column_stack([xy, middle_m + surface(*xy.T)])
    weight = rng.standard_normal(POINTS)
    if trouble == "glint":
        weight[0] = 10 ** rng.uniform(1, 2)
    if trouble == "clutter":
        points_m = np.vstack([points_m, rng.uniform((-0.1, -0.1, 0.2), (0.1, 0.1, 0.5), (5, 3))])
        weight = np.append(weight, 10 * rng.standard_normal(5))
    samples = simulate(Scatterers(points_m, weight), TONES_HZ, _array(), spreading=False, tolerance=None)
    level = np.sqrt(np.mean(np.abs(samples) ** 2)) * 10 ** (rng.uniform(*NOISE_DB) / 20)
    noise = rng.standard_normal((2, *samples.shape)) * level / np.sqrt(2)
    samples = samples + noise[0] + 1j * noise[1]
    if trouble == "dead":
        samples[:, rng.integers(0, len(_array().tx_m), 4)] = 0
    if trouble == "clipped":
        most = np.abs(samples).max() * rng.uniform(0.2, 0.8)
        samples = np.clip(samples.real, -most, most) + 1j * np.clip(samples.imag, -most, most)
    return RadarCapture(samples[None].astype(np.complex64), TONES_HZ, _array())
