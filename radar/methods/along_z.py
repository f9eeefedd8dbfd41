"""Established estimators of a pixel's depth from its tones, for comparison: Capon's spectrum and the coherence factor.

Capon (Proc. IEEE 57 (1969) 1408), with the covariance R of sub-bands averaged forward and backward (Shan, Wax &
Kailath, IEEE Trans. ASSP 33 (1985) 806) and loaded diagonally: P(Δ) = 1 / (aᴴ R⁻¹ a), a_l = e^{−j l δk Δ}. The
coherence factor (Mallart & Fink, JASA 96 (1994) 3721) is |Σ O|² / (N Σ |O|²) of the tones' images at each depth that is
imaged.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S

LOADING, TINY = 1e-2, 1e-30  # of R's mean diagonal; and least
CAPON_STEP_M, IMAGED_STEP_M = 0.25e-3, 0.5e-3


def capon(images: np.ndarray, frequencies_hz: np.ndarray, rise: np.ndarray, reach_m: float) -> np.ndarray:
    """Shifts [n] within ±reach_m at which the spectrum of images [f, n] at even tones [f] is highest; rise [n]: of the
    path, per metre along z."""
    half, spacing_hz = len(images) // 2, np.ptp(frequencies_hz) / (len(frequencies_hz) - 1)
    bands = np.stack([images[i : i + half].T for i in range(len(images) - half + 1)]).astype(np.complex128)
    covariance = np.einsum("bni,bnj->nij", bands, bands.conj())
    covariance += covariance[:, ::-1, ::-1].conj()
    mean = np.trace(covariance, axis1=1, axis2=2).real / half
    inverse = np.linalg.inv(covariance + (LOADING * mean + TINY)[:, None, None] * np.eye(half))
    tried_m = np.arange(-reach_m, reach_m + CAPON_STEP_M / 2, CAPON_STEP_M)
    turns_per_m = 2 * np.pi * spacing_hz / SPEED_OF_LIGHT_M_S * rise[:, None] * np.arange(half)
    inverse_power = [_form(inverse, np.exp(-1j * turns_per_m * there_m)) for there_m in tried_m]
    return np.asarray(tried_m[np.argmin(inverse_power, axis=0)])


def coherence_factor(image: Callable[[float], np.ndarray], reach_m: float) -> np.ndarray:
    """Shifts [n] within ±reach_m at which the tones' images [f, n], made by `image` for a shift, are most coherent."""
    tried_m = np.arange(-reach_m, reach_m + IMAGED_STEP_M / 2, IMAGED_STEP_M)
    images = map(image, tried_m)
    factors = [np.abs(o.sum(axis=0)) ** 2 / np.maximum((np.abs(o) ** 2).sum(axis=0), TINY) for o in images]
    return np.asarray(tried_m[np.argmax(factors, axis=0)])


def _form(inverse: np.ndarray, steering: np.ndarray) -> np.ndarray:
    """aᴴ R⁻¹ a, [n]."""
    return np.asarray(np.einsum("ni,nij,nj->n", steering.conj(), inverse, steering).real)
