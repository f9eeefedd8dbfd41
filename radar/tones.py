"""Tone skeletons: as many tones as a box needs.

Seen from a box's centre c₀, paths differ by at most ±d, so that tones closer than about π/d tell the same story: a
skeleton of k tones carries all f of them (128 → 11 for 20 mm at a tolerance of 1e-6). With the real weights L of the
interpolative decomposition,

    compress (imaging):    S'[m] = Σ_f L[m, f] e^{j(k_f − k_m)(|c₀ − t| + |c₀ − r|)} S[f]
    expand (simulation):   S[f] = Σ_m L[m, f] e^{−j(k_f − k_m)(|c₀ − t| + |c₀ − r|)} S'[m],  its adjoint.
"""

from __future__ import annotations

import numpy as np

from radar.arrays import SPEED_OF_LIGHT_M_S, Aperture
from radar.skeleton import skeleton
from radar.steering import phasor


class ToneSkeleton:
    """The tones that the box with corners_m [3, 8] needs of frequencies_hz [f], to a relative `tolerance`.

    With tolerance None, or three tones at most, all are kept and nothing is changed.
    """

    def __init__(
        self, frequencies_hz: np.ndarray, aperture: Aperture, corners_m: np.ndarray, tolerance: float | None
    ) -> None:
        self.frequencies_hz = frequencies_hz
        self.weights = None
        if tolerance is None or len(frequencies_hz) <= 3:
            return
        centre = corners_m.mean(axis=1, keepdims=True)
        legs = [distances_m(centre, leg)[:, 0] for leg in aperture.legs_m]
        reach_m = sum(  # distances are convex, so that they are largest in a corner
            np.abs(distances_m(corners_m, antennas) - leg[:, None]).max()
            for antennas, leg in zip(aperture.legs_m, legs, strict=True)
        )
        wavenumber = 2 * np.pi * frequencies_hz / SPEED_OF_LIGHT_M_S
        chosen, weights = skeleton(np.sinc(reach_m * (wavenumber[:, None] - wavenumber) / np.pi), tolerance)
        self.frequencies_hz = frequencies_hz[chosen]
        self.weights = weights.astype(np.float32)
        self._all = [phasor(leg, frequencies_hz[:, None], +1).astype(np.complex64) for leg in legs]
        self._kept = [phase[chosen] for phase in self._all]

    def compress(self, samples: np.ndarray) -> np.ndarray:
        """Samples [f, …] of all tones → [k, …] that image the box alike."""
        if self.weights is None:
            return samples
        mixed = _mix(self.weights, _modulate(samples, *self._all))
        return _modulate(mixed, *(phase.conj() for phase in self._kept))

    def expand(self, samples: np.ndarray) -> np.ndarray:
        """Echoes [k, …] of scatterers in the box at the kept tones → [f, …] at all tones."""
        if self.weights is None:
            return samples
        mixed = _mix(self.weights.T, _modulate(samples, *self._kept))
        return _modulate(mixed, *(phase.conj() for phase in self._all))


def distances_m(points_m: np.ndarray, antennas_m: np.ndarray) -> np.ndarray:
    """Distances [a, n] of antennas [a, 3] to points [3, n]."""
    return np.sqrt(((antennas_m[:, :, None] - points_m[None]) ** 2).sum(axis=1))


def _mix(weights: np.ndarray, samples: np.ndarray) -> np.ndarray:
    """Real weights [n, m] times complex samples [m, …], as one real matrix product."""
    flat = np.ascontiguousarray(samples.reshape(len(samples), -1)).view(np.float32)
    return (np.ascontiguousarray(weights) @ flat).view(np.complex64).reshape(len(weights), *samples.shape[1:])


def _modulate(samples: np.ndarray, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """samples · phase of both legs: complex64 [f, t, r] or, for a scan, [f, n]."""
    if samples.ndim == 2:
        return samples * (first * second)
    return (samples * first[:, :, None]) * second[:, None, :]
