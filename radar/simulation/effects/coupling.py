"""Leakage straight from the transmitters to the receivers."""

from __future__ import annotations

import numpy as np

from radar.data.arrays import AntennaArray
from radar.imaging.cpu.steering import phasor
from radar.simulation.effects.base import Effect, Estimate
from radar.simulation.pilot import change_db, change_mm, pilot, rms
from radar.simulation.scene import EchoScene
from radar.simulation.state import EchoState


class AntennaCoupling(Effect):
    """Every channel also receives a direct wave, falling with the distance between its antennas."""

    id = "coupling"
    does = "leakage from transmitters to receivers"
    source = "the pilot's two tones with the leakage added, at the level that the scene gives"

    def missing(self, scene: EchoScene) -> str:
        return "" if scene.causes.coupling.level_db is not None else "[sensor.coupling] with level_db"

    def estimate(self, scene: EchoScene) -> Estimate:
        known = pilot(scene)
        level = scene.causes.coupling.amplitude * known.channel_rms
        samples = known.samples + level * direct_wave(scene.array, known.tones_hz)
        why = f"two tones' images with a direct wave of {scene.causes.coupling.level_db:g} dB, which lies out of focus"
        return Estimate(change_mm(scene, samples), change_db(scene, samples), why)

    def apply(self, state: EchoState) -> None:
        causes, frequencies_hz = state.scene.causes, state.scene.frequencies_hz
        level = state.level(self.id, lambda: causes.coupling.amplitude * rms(state.samples))
        state.samples = state.samples + level * direct_wave(state.array, frequencies_hz)


def direct_wave(array: AntennaArray, frequencies_hz: np.ndarray) -> np.ndarray:
    """exp(−j2πf|t − r|/c)/|t − r| in every channel, of mean power 1: complex64 [f, t, r]."""
    distance_m = np.linalg.norm(array.tx_m[:, None] - array.rx_m[None], axis=2)
    gain = 1 / np.maximum(distance_m, 1e-3)  # a transceiver's own leakage is not infinite
    gain /= np.sqrt(np.mean(gain**2))
    return np.stack([gain * phasor(distance_m, f, -1) for f in frequencies_hz]).astype(np.complex64)
