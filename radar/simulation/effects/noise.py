"""Thermal noise, given by the phase noise that it causes at the strongest pixel, or by the signal-to-noise ratio."""

from __future__ import annotations

import numpy as np

from radar.data.arrays import AntennaArray
from radar.imaging.cpu.exact import tone_images
from radar.simulation.effects.base import Effect, Estimate
from radar.simulation.pilot import pilot
from radar.simulation.scene import EchoScene
from radar.simulation.state import EchoState

PEAK_POINTS = 20_000  # surface points on which the strongest pixel is looked for


class ThermalNoise(Effect):
    """White circular Gaussian noise in every channel, tone and frame."""

    id = "noise"
    does = "thermal noise of the receivers"
    source = "σ_z = c/(4πΔf)·σ_φ·A_max/A, its mean magnitude √(2/π)·σ_z"

    def missing(self, scene: EchoScene) -> str:
        return "" if scene.causes.noise.between_tones_rad else "[noise] with phase_noise_rad or snr_db"

    def estimate(self, scene: EchoScene) -> Estimate:
        sigma_rad, known = scene.causes.noise.between_tones_rad, pilot(scene)
        weaker = float((known.strongest / np.abs(known.images[0])).mean())
        depth_m = scene.depth_m_per_rad * np.sqrt(2 / np.pi) * sigma_rad * weaker
        why = f"{sigma_rad:.3g} rad at the strongest pixel, {weaker:.2g} times as much on average"
        # Mean power of the noise over that of the samples, from σ = σ_φ·A/√N.
        noise = sigma_rad * known.strongest / np.sqrt(known.samples[0].size)
        return Estimate(1e3 * depth_m, 20 * np.log10(noise / known.channel_rms), why)

    def apply(self, state: EchoState) -> None:
        scene = state.scene
        strongest, sigma_rad = state.level(self.id, lambda: _strongest(state)), scene.causes.noise.between_tones_rad
        state.samples = np.stack(
            [
                thermal_noise(samples, scene.frequencies_hz, sigma_rad, strongest, state.frame_seed(self.id, frame))
                for frame, samples in enumerate(state.samples)
            ]
        )


def _strongest(state: EchoState) -> float:
    """The strongest pixel of the first frame's highest tone on the target's surface."""
    points = [] if state.surface is None else [state.surface.facets.position_m]
    points += [ball.centre_m[None] for ball in state.scene.balls]
    surface_m = np.concatenate(points)
    surface_m = surface_m[:: max(1, len(surface_m) // PEAK_POINTS)]
    top = int(state.scene.frequencies_hz.argmax())
    return strongest_amplitude(state.samples[0, top], state.scene.frequencies_hz[top], state.scene.array, surface_m)


def strongest_amplitude(samples: np.ndarray, frequency_hz: float, array: AntennaArray, surface_m: np.ndarray) -> float:
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
