"""Depth where the tones agree: the shift along z at which a few tones' images have one phase.

The aperture focuses on a smooth surface's mirror image and not on the surface, so that the strongest voxel lies before
or behind it; the delay does not care. An image formed at z_p of a scatterer at z has the phase k_f (z_p − z) and one
that all tones share, with k_f = 2πf/c · d(|p − t| + |p − r|)/dz averaged over the antennas. Where the paths of the
scatterer's neighbourhood are those of one depth, the power of the sum over N tones, with the shift Δ,

    P(Δ) = |Σ_f O_f e^{jk_f Δ}|² / (N Σ_f |O_f|²),

is their coherence, 1 at Δ = z − z_p: its maximum is the maximum-likelihood depth of one scatterer in white noise (Rife
& Boorstyn, IEEE Trans. Inf. Theory 20 (1974) 591). What the phases differ by from a line, variance s² a tone, gives the
depth the variance s² / Σ_f (k_f − k̄)², the Cramér–Rao bound with s² measured.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from radar.data.arrays import SPEED_OF_LIGHT_M_S

STEPS = 16  # per range cell, of the search
POLISHES = 2  # Gauss–Newton steps from the search's maximum


class Alignment(NamedTuple):
    """shift_m, its standard deviation sigma_m and coherence P, each [n]."""

    shift_m: np.ndarray
    sigma_m: np.ndarray
    coherence: np.ndarray


def align(images: np.ndarray, frequencies_hz: np.ndarray, rise: np.ndarray) -> Alignment:
    """The shifts, within a range cell c/2B or half of what evenly spaced tones repeat after, that align images [f, n]
    of ascending tones [f], f ≥ 3; rise [n]: of the path, per metre along z."""
    k = 2 * np.pi * frequencies_hz[:, None] / SPEED_OF_LIGHT_M_S * rise
    cell_m = SPEED_OF_LIGHT_M_S / (2 * np.ptp(frequencies_hz))
    reach_m = cell_m * min(1.0, (len(frequencies_hz) - 1) / 2)
    shift_m, most = np.zeros(len(rise)), np.zeros(len(rise))
    for tried_m in np.linspace(-reach_m, reach_m, 1 + 2 * int(np.ceil(STEPS * reach_m / cell_m))):
        power = np.abs(_sum(_turned(images, k, tried_m)))
        shift_m, most = np.where(power > most, tried_m, shift_m), np.maximum(power, most)
    weight = np.abs(images).astype(np.float64) ** 2
    total = np.where(most > 0, weight.sum(axis=0), np.inf)
    from_mean = k - (weight * k).sum(axis=0) / total
    leverage = (weight * from_mean**2).sum(axis=0) / total  # Σ (k − k̄)² / N
    turned = _turned(images, k, shift_m)
    for _ in range(POLISHES):
        slope = (weight * from_mean * _residual(turned)).sum(axis=0) / total
        shift_m = shift_m - np.divide(slope, leverage, out=np.zeros(len(rise)), where=leverage > 0)
        turned = _turned(images, k, shift_m)
    variance = (weight * _residual(turned) ** 2).sum(axis=0) / total / (len(images) - 2)
    sigma_m = np.sqrt(np.divide(variance, leverage, out=np.full(len(rise), np.inf), where=leverage > 0))
    return Alignment(shift_m, sigma_m, np.abs(_sum(turned)) ** 2 / (len(images) * total))


def _turned(images: np.ndarray, k: np.ndarray, shift_m: np.ndarray | float) -> np.ndarray:
    """Images [f, n] as they would be at another depth."""
    return np.asarray(images * np.exp(1j * k * shift_m))


def _sum(images: np.ndarray) -> np.ndarray:
    return np.asarray(images.sum(axis=0))


def _residual(images: np.ndarray) -> np.ndarray:
    """Phases [f, n] about that of the sum."""
    return np.angle(images * np.conj(_sum(images)))
