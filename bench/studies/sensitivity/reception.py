"""The receiver: what noise, the oscillator, the antennas and the calibration add to echoes without noise."""

import zlib
from collections.abc import Mapping

import numpy as np

from bench.studies.sensitivity.cases import Value
from bench.studies.sensitivity.placement import Clean
from radar.simulation.effects.receiver import ThermalNoise, thermal_noise


def received(
    clean: Clean,
    values: Mapping[str, Value],
    noise_rad: float,
    late_hz: tuple[float, float],
    seed: int,
    frame: int,
    draw: int,
) -> np.ndarray:
    """Samples complex64 [f, t, r] of one frame of a scene with this seed. noise_rad: the benchmark's own; late_hz: f2
    and f3, where phases are left; draw: which errors the antennas have, the same in all frames of a capture.

    Thermal noise is that of `handbench simulate`, draw for draw, and keeps its level where antennas err.
    """
    f, samples = clean.frequencies_hz, clean.samples
    phase_rad, gain_db = (float(values.get(name, 0.0)) for name in ("antenna_phase_rad", "antenna_gain_db"))
    if phase_rad or gain_db:
        tx, rx = (
            10 ** (gain_db * gain / 20) * np.exp(1j * phase_rad * phase)
            for gain, phase in (
                _normal(seed, f"antennas {leg}", draw, (2, n)) for leg, n in enumerate(samples.shape[1:])
            )
        )
        samples = samples * (tx[:, None] * rx)
    turn_rad = float(values.get("common_phase_rad", 0.0)) / np.sqrt(2) * _normal(seed, "tones", frame, f.shape)
    for name, tone_hz in zip(("f2_phase_rad", "f3_phase_rad"), late_hz, strict=True):
        turn_rad[f == tone_hz] += float(values.get(name, 0.0))
    if turn_rad.any():
        samples = samples * np.exp(1j * turn_rad)[:, None, None]
    sigma_rad = float(values.get("phase_noise_rad", noise_rad))
    samples = samples.astype(np.complex64, copy=False)
    if sigma_rad == 0:
        return samples
    return thermal_noise(samples, f, sigma_rad, clean.strongest, (seed, zlib.crc32(ThermalNoise.id.encode()), 0, frame))


def _normal(seed: int, what: str, number: int, shape: tuple[int, ...]) -> np.ndarray:
    """Normal numbers that depend on nothing but these."""
    sequence = np.random.SeedSequence((seed, zlib.crc32(what.encode()), number))
    return np.random.default_rng(sequence).standard_normal(shape)
