"""Thermal noise, given as the phase noise that it causes at the strongest pixel."""

from __future__ import annotations

import numpy as np

from radar.arrays import AntennaArray
from radar.backprojection import tone_images


def strongest_amplitude(
    samples: np.ndarray, frequency_hz: float, array: AntennaArray, surface_m: np.ndarray
) -> float:
    """Largest magnitude of one tone's image (samples [t, r]) on the target's surface points [n, 3]."""
    return float(np.abs(tone_images(samples[None], np.array([frequency_hz]), array, surface_m)).max())


def thermal_noise(
    samples: np.ndarray, frequencies_hz: np.ndarray, phase_noise_rad: float, strongest: float, seed: tuple[int, ...]
) -> np.ndarray:
    """Samples [f, t, r] with white circular Gaussian noise of the same level in every channel and tone.

    phase_noise_rad: standard deviation of the phase *between two tones* at the strongest pixel. An image sums N = t·r
    channels, so that its noise is √N σ; of it one quadrature turns the phase, σ_φ = √N σ / (√2 A) per tone, and
    √N σ / A between two tones of equal amplitude A: σ = phase_noise_rad · A / √N.

    Each tone draws from (seed, its frequency): its noise does not depend on which other tones there are.
    """
    sigma = phase_noise_rad * strongest / np.sqrt(samples[0].size)
    noisy = np.empty_like(samples)
    for f, frequency_hz in enumerate(frequencies_hz):
        generator = np.random.default_rng(np.random.SeedSequence([*seed, round(float(frequency_hz))]))
        noise = generator.standard_normal((*samples[f].shape, 2), dtype=np.float32) * np.float32(sigma / np.sqrt(2))
        noisy[f] = samples[f] + noise.view(np.complex64)[..., 0]
    return noisy
