"""Tone skeletons: as many tones as a box needs, for whoever images one small box many times.

Seen from a box's centre, paths differ by at most ±d, so that tones closer than about π/d tell the same story: a
skeleton of k tones carries all f of them (128 → 11 for 20 mm at a tolerance of 1e-6). This is the root of
`radar.imaging.tree`, with the phase about the box's centre put back, so that the few tones are samples like any others.
"""

from __future__ import annotations

import numpy as np

from radar.data.arrays import SPEED_OF_LIGHT_M_S, Aperture
from radar.imaging.cpu.ascent import ascend
from radar.imaging.cpu.descent import complex_samples, descend, planes, turn
from radar.imaging.tree import Box, Family, branch, trunk


class ToneSkeleton:
    """The tones frequencies_hz [k] that the box between low_m and high_m [3] needs, to a relative `tolerance`."""

    def __init__(
        self, frequencies_hz: np.ndarray, aperture: Aperture, low_m: np.ndarray, high_m: np.ndarray, tolerance: float
    ) -> None:
        self._all = trunk(frequencies_hz, aperture)
        self._few = branch(self._all, Box(low_m, high_m), Family(tolerance, apart=False), keep_antennas=True)
        self.frequencies_hz = self._few.turns_per_m * SPEED_OF_LIGHT_M_S
        self._step = (self._all.turns_per_m, *self._few.shifts_m, self._few.tone_weights, *self._few.leg_weights)

    def compress(self, samples: np.ndarray) -> np.ndarray:
        """Samples [f, t, r] of all tones → [k, t, r] that image the box alike."""
        return complex_samples(self._centred(descend(planes(samples), *self._step), -1.0))

    def expand(self, samples: np.ndarray) -> np.ndarray:
        """Echoes [k, t, r] of scatterers in the box at the few tones → [f, t, r] at all tones: the adjoint."""
        return complex_samples(ascend(self._centred(planes(samples), 1.0), *self._step))

    def _centred(self, samples: np.ndarray, sign: float) -> np.ndarray:
        return turn(samples, self._few.turns_per_m, *(leg.length_m for leg in self._few.legs), np.float32(sign))
