"""Distances and phases on a device: `radar.imaging.cpu.steering` as array code over numpy or cupy (`xp`).

As there, phases are counted in turns and reduced in the precision in which they come before the float32 sine.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import ModuleType

import numpy as np

from radar.imaging.device import Array


def cis(xp: ModuleType, turns: Array) -> Array:
    """exp(j2π·turns): complex64 of float64 turns, or of float32 ones where a few turns are exact enough."""
    angle = (turns - xp.rint(turns)).astype(np.float32, copy=False)
    angle *= np.float32(2 * np.pi)
    wave = xp.empty(angle.shape, np.complex64)
    wave.real = xp.cos(angle)
    wave.imag = xp.sin(angle)
    return wave


def distances(xp: ModuleType, points_m: Sequence[Array], antennas_m: Sequence[Array]) -> Array:
    """|p − a| in float64 of points (x, y, z) and antennas (x, y, z), each an array; they are broadcast."""
    return xp.sqrt(sum((p - a) ** 2 for p, a in zip(points_m, antennas_m, strict=True)))
