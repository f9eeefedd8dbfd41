"""The effects of an imperfect sensor: errors of the antennas' positions, their pattern, leakage,
channel errors, dead antennas, phase noise of the oscillator, thermal noise and quantisation."""

from __future__ import annotations

import numpy as np
from scipy.special import sici

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray
from handbench.radar.imaging.exact import exact_images
from handbench.radar.imaging.steering import phasor
from handbench.radar.simulation.scene import Oscillator, generator
from handbench.radar.simulation.scene_echoes import Echoes
from handbench.support.errors import HandbenchError

OFFSET_HZ = 1e6  # where the oscillator's level is given
PEAK_POINTS = 20_000  # surface points on which the strongest pixel is looked for


def positions(echoes: Echoes) -> None:
    """Move each antenna from its nominal position by a normally distributed error in x, y and z.
    The simulated capture stores the nominal positions."""
    scene = echoes.scene
    legs_m = []
    for i, leg in enumerate(scene.array.legs):
        normal = generator(scene.seeds("positions", i)).standard_normal(leg.position_m.shape)
        legs_m.append(leg.position_m + scene.sensor.positions.sigma_m * normal)
    echoes.array = AntennaArray(*legs_m)


def pattern(echoes: Echoes) -> None:
    """Give every antenna the amplitude pattern cosᵠθ, θ from the z axis."""
    echoes.pattern = echoes.scene.sensor.pattern.exponent


def coupling(echoes: Echoes, samples: np.ndarray) -> np.ndarray:
    """Add a direct wave (leakage) from each transmitter t to each receiver r, exp(−j2πf|t −
    r|/c)/|t − r|. Its mean power is set relative to that of the target's samples."""
    scene, array, target = echoes.scene, echoes.array, samples[: echoes.frames]
    level = scene.sensor.coupling.amplitude * np.linalg.norm(target) / np.sqrt(target.size)
    distance_m = np.linalg.norm(array.tx_m[:, None] - array.rx_m[None], axis=2)
    gain = 1 / np.maximum(distance_m, 1e-3)  # a transceiver's own leakage is not infinite
    gain /= np.sqrt(np.mean(gain**2))
    wave = gain * phasor(distance_m, scene.frequencies_hz[:, None, None], -1)
    return samples + np.float32(level) * wave.astype(np.complex64)


def channels(echoes: Echoes, samples: np.ndarray) -> np.ndarray:
    """Multiply the samples by a random gain, phase and delay of each antenna, drawn once per
    scene."""
    scene, causes = echoes.scene, echoes.scene.sensor.channels
    legs = []
    for i, count in enumerate(scene.array.channels):
        draw = generator(scene.seeds("channels", i))
        gain, phase, delay = draw.standard_normal((3, count))
        still = 10 ** (causes.gain_db * gain / 20) * np.exp(1j * causes.phase_rad * phase)
        legs.append(still * phasor(causes.delay_m * delay, scene.frequencies_hz[:, None], -1))
    return samples * (legs[0][:, :, None] * legs[1][:, None]).astype(np.complex64)


def dead(echoes: Echoes, samples: np.ndarray) -> np.ndarray:
    """Set the samples of all channels with a dead antenna to zero. Raises HandbenchError for an
    antenna number that does not exist."""
    causes = echoes.scene.sensor.dead
    alive = np.ones(samples.shape[-2:], np.float32)
    for name, numbers, axis in (("tx", causes.tx, 0), ("rx", causes.rx, 1)):
        wrong = [n for n in numbers if not 0 <= n < alive.shape[axis]]
        if wrong:
            last = alive.shape[axis] - 1
            raise HandbenchError(
                f"sensor.dead.{name}: has the antenna number {wrong[0]}; expected numbers from 0 "
                f"to {last}"
            )
        alive[(slice(None),) * axis + (list(numbers),)] = 0
    return samples * alive


def oscillator(echoes: Echoes, samples: np.ndarray) -> np.ndarray:
    """Add a random phase to every tone of every transmitter: phase noise of the common oscillator.

    The receiver mixes with the same oscillator, a delay τ later: noise of density L(f) is reduced
    to 4 sin²(πfτ)·L(f) (range correlation; Budge & Burt 1993). With L = L₀·(f₀/f)² below the
    receiver's bandwidth B, the phase has the variance

        σ² = ∫₀^B 2·L·4 sin²(πfτ) df = 8 L₀ f₀² [ πτ·Si(2πτB) − sin²(πτB)/B ].

    Transmitters send one after another, so the phases differ between tones and transmitters and are
    the same for all receivers. An image averages them over T transmitters, which leaves σ/√T.
    """
    middle_m = echoes.scene.points_m.mean(axis=0)
    delay_s = 2 * float(np.linalg.norm(middle_m)) / SPEED_OF_LIGHT_M_S
    sigma_rad = phase_rad(echoes.scene.sensor.oscillator, delay_s)
    shape, seeds = (*samples.shape[1:3], 1), echoes.frame_seeds("oscillator")
    turns = np.stack([generator(seed).standard_normal(shape) for seed in seeds])
    return (samples * np.exp(1j * sigma_rad * turns)).astype(np.complex64)


def phase_rad(oscillator: Oscillator, delay_s: float) -> float:
    """Compute the standard deviation of the phase, in radians, that an oscillator's noise causes.
    Transmitter and receiver share the oscillator, so noise slower than the target's delay delay_s
    cancels (range correlation)."""
    a, bandwidth_hz = np.pi * delay_s, oscillator.bandwidth_hz
    integral = a * sici(2 * a * bandwidth_hz)[0] - np.sin(a * bandwidth_hz) ** 2 / bandwidth_hz
    return float(np.sqrt(8 * oscillator.density * OFFSET_HZ**2 * integral))


def noise(echoes: Echoes, samples: np.ndarray) -> np.ndarray:
    """Add white circular Gaussian noise to every channel, tone and frame. Its level is set relative
    to the strongest pixel on the target's surface, in the image of the highest tone of the first
    frame."""
    scene, tones_hz = echoes.scene, echoes.scene.frequencies_hz
    surface_m = echoes.points_m[:: max(1, len(echoes.points_m) // PEAK_POINTS)]
    top = int(tones_hz.argmax())
    strongest = strongest_amplitude(samples[0, top], tones_hz[top], scene.array, surface_m)
    noise_rad, frames = scene.noise.between_tones_rad, echoes.frame_seeds("noise")
    return np.stack(
        [
            thermal_noise(frame, tones_hz, noise_rad, strongest, seed)
            for frame, seed in zip(samples, frames, strict=True)
        ]
    )


def strongest_amplitude(
    samples: np.ndarray, frequency_hz: float, array: AntennaArray, surface_m: np.ndarray
) -> float:
    """Return the largest magnitude, over surface points [n, 3], of the image of one tone. samples
    [t, r]: the tone's samples."""
    return float(
        np.abs(exact_images(samples[None], np.array([frequency_hz]), array, surface_m, True)).max()
    )


def thermal_noise(
    samples: np.ndarray,
    frequencies_hz: np.ndarray,
    phase_noise_rad: float,
    strongest: float,
    seed: tuple[int, ...],
) -> np.ndarray:
    """Add white circular Gaussian noise to samples [f, t, r], of the same level in every channel
    and at every tone. strongest: amplitude A of the strongest pixel in an image of one tone.

    phase_noise_rad: standard deviation of the phase *between two tones* at the strongest pixel. An
    image sums N = t·r channels, so that its noise is √N σ; of it one quadrature turns the phase,
    σ_φ = √N σ / (√2 A) per tone, and √N σ / A between two tones of equal amplitude A: σ =
    phase_noise_rad · A / √N.

    The random numbers of a tone depend only on `seed`, on the tone's frequency and on how often it
    was measured before, not on the other tones.
    """
    sigma = phase_noise_rad * strongest / np.sqrt(samples[0].size)
    noisy = np.empty_like(samples)
    for f, frequency_hz in enumerate(frequencies_hz):
        before = int((frequencies_hz[:f] == frequency_hz).sum())
        keys = [*seed, round(float(frequency_hz)), *([before] if before else [])]
        generator = np.random.default_rng(np.random.SeedSequence(keys))
        noise = generator.standard_normal((*samples[f].shape, 2), dtype=np.float32) * np.float32(
            sigma / np.sqrt(2)
        )
        noisy[f] = samples[f] + noise.view(np.complex64)[..., 0]
    return noisy


def converter(echoes: Echoes, samples: np.ndarray) -> np.ndarray:
    """Round both quadratures to the middles of 2^bits equal steps over ±full scale, and clip what
    exceeds it. Full scale is the largest quadrature of the samples, raised by the headroom."""
    causes = echoes.scene.sensor.converter
    parts = np.ascontiguousarray(samples).view(np.float32)
    scale = float(np.abs(parts[: echoes.frames]).max() * 10 ** (causes.headroom_db / 20))
    if scale == 0:
        return samples
    step = 2 * scale / 2 ** (causes.bits or 0)
    middles = (np.floor(parts.astype(np.float64) / step) + 0.5) * step
    clipped = np.clip(middles, -scale + step / 2, scale - step / 2)
    return clipped.astype(np.float32).view(np.complex64)
