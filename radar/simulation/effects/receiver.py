"""The receiver: phase noise of the oscillator, thermal noise, quantisation."""

from __future__ import annotations

import numpy as np
from scipy.special import sici

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray
from handbench.radar.imaging.cpu.exact import exact_images
from handbench.radar.simulation.causes import Converter, Oscillator
from handbench.radar.simulation.effects.base import Effect
from handbench.radar.simulation.scene import EchoScene
from handbench.radar.simulation.state import EchoState

OFFSET_HZ = 1e6  # where the oscillator's level is given
PEAK_POINTS = 20_000  # surface points on which the strongest pixel is looked for


class OscillatorNoise(Effect):
    """Every tone of every transmitter is turned by a phase of its own: noise of the oscillator that all share.

    Its phase at the receiver is that of the echo's delay τ ago: what is left of a noise of density L(f) is
    4 sin²(πfτ)·L(f) (range correlation; Budge & Burt 1993). With L = L₀·(f₀/f)² below the receiver's bandwidth B,

        σ² = ∫₀^B 2·L·4 sin²(πfτ) df = 8 L₀ f₀² [ πτ·Si(2πτB) − sin²(πτB)/B ].

    Transmitters work one after another: the phase is another one for each tone and transmitter, and the same for all
    receivers, so that an image of T transmitters averages it to σ/√T.
    """

    id = "oscillator"

    def missing(self, scene: EchoScene) -> str:
        return "" if scene.causes.oscillator.level_dbc_hz is not None else "[sensor.oscillator] with level_dbc_hz"

    def apply(self, state: EchoState) -> None:
        delay_s = 2 * float(np.linalg.norm(state.scene.middle_m)) / SPEED_OF_LIGHT_M_S
        sigma_rad = phase_rad(state.scene.causes.oscillator, delay_s)
        shape = (len(state.scene.frequencies_hz), len(state.scene.array.tx_m), 1)
        turns = np.stack([state.random(seed).standard_normal(shape) for seed in state.frame_seeds(self.id)])
        state.samples = (state.samples * np.exp(1j * sigma_rad * turns)).astype(np.complex64)


def phase_rad(oscillator: Oscillator, delay_s: float) -> float:
    """Standard deviation of the phase that is left after the echo's delay."""
    a, bandwidth_hz = np.pi * delay_s, oscillator.bandwidth_hz
    integral = a * sici(2 * a * bandwidth_hz)[0] - np.sin(a * bandwidth_hz) ** 2 / bandwidth_hz
    return float(np.sqrt(8 * oscillator.density * OFFSET_HZ**2 * integral))


class ThermalNoise(Effect):
    """White circular Gaussian noise in every channel, tone and frame."""

    id = "noise"

    def missing(self, scene: EchoScene) -> str:
        return "" if scene.causes.noise.between_tones_rad else "[noise] with phase_noise_rad or snr_db"

    def apply(self, state: EchoState) -> None:
        tones_hz, sigma_rad = state.scene.frequencies_hz, state.scene.causes.noise.between_tones_rad
        strongest, seeds = state.level(self.id, lambda: _strongest(state)), state.frame_seeds(self.id)
        frames = zip(state.samples, seeds, strict=True)
        state.samples = np.stack([thermal_noise(s, tones_hz, sigma_rad, strongest, seed) for s, seed in frames])


def _strongest(state: EchoState) -> float:
    """The strongest pixel of the first frame's highest tone on the target's surface."""
    surface_m = state.points_m[:: max(1, len(state.points_m) // PEAK_POINTS)]
    top = int(state.scene.frequencies_hz.argmax())
    return strongest_amplitude(state.samples[0, top], state.scene.frequencies_hz[top], state.scene.array, surface_m)


def strongest_amplitude(samples: np.ndarray, frequency_hz: float, array: AntennaArray, surface_m: np.ndarray) -> float:
    """Largest magnitude of one tone's image (samples [t, r]) on the target's surface points [n, 3]."""
    return float(np.abs(exact_images(samples[None], np.array([frequency_hz]), array, surface_m, True)).max())


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


class Quantisation(Effect):
    """Both quadratures are rounded to the converter's steps and clipped at its full scale."""

    id = "converter"

    def missing(self, scene: EchoScene) -> str:
        return "" if scene.causes.converter.bits else "[sensor.converter] with bits"

    def apply(self, state: EchoState) -> None:
        converter = state.scene.causes.converter
        scale = state.level(self.id, lambda: full_scale(state.samples, converter))
        state.samples = np.stack([quantised(frame, converter, scale) for frame in state.samples])


def full_scale(samples: np.ndarray, converter: Converter) -> float:
    """Full scale of a quadrature: the largest one, with the headroom."""
    largest = max(np.abs(samples.real).max(), np.abs(samples.imag).max())
    return float(largest * 10 ** (converter.headroom_db / 20))


def quantised(samples: np.ndarray, converter: Converter, scale: float) -> np.ndarray:
    """Samples rounded to the middles of 2^bits steps over ±scale (mid-rise): complex64."""
    if scale == 0 or converter.bits is None:
        return samples
    step = 2 * scale / 2**converter.bits
    parts = np.ascontiguousarray(samples).view(np.float32).astype(np.float64)
    middle = (np.floor(parts / step) + 0.5) * step
    return np.clip(middle, -scale + step / 2, scale - step / 2).astype(np.float32).view(np.complex64)
