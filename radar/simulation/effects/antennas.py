"""Antennas that differ from what the capture says: places, pattern, leakage, channels, dead ones."""

from __future__ import annotations

import numpy as np

from handbench.radar.data.arrays import AntennaArray
from handbench.radar.imaging.cpu.steering import phasor
from handbench.radar.simulation.causes import Channels, Dead
from handbench.radar.simulation.effects.base import Effect
from handbench.radar.simulation.pilot import rms
from handbench.radar.simulation.scene import EchoScene
from handbench.radar.simulation.state import EchoState
from handbench.support.errors import HandbenchError


class PositionErrors(Effect):
    """Each antenna is off by a normal error per axis; the capture keeps the nominal positions."""

    id = "positions"

    def missing(self, scene: EchoScene) -> str:
        return "" if scene.causes.positions.sigma_m else "[sensor.positions] with sigma_m"

    def apply(self, state: EchoState) -> None:
        sigma_m, legs_m = state.scene.causes.positions.sigma_m, [leg.position_m for leg in state.array.legs]
        draws = [state.random(state.seed(self.id, i)) for i in range(len(legs_m))]
        moved = [m + sigma_m * draw.standard_normal(m.shape) for m, draw in zip(legs_m, draws, strict=True)]
        state.array = AntennaArray(*moved)


class AntennaPattern(Effect):
    """Every antenna radiates and receives with the amplitude cosᵠθ, θ from the z axis."""

    id = "pattern"

    def missing(self, scene: EchoScene) -> str:
        return "" if scene.causes.pattern.beamwidth_deg is not None else "[sensor.pattern] with beamwidth_deg"

    def apply(self, state: EchoState) -> None:
        state.pattern = state.scene.causes.pattern.exponent


class AntennaCoupling(Effect):
    """Every channel also receives a direct wave, falling with the distance between its antennas."""

    id = "coupling"

    def missing(self, scene: EchoScene) -> str:
        return "" if scene.causes.coupling.level_db is not None else "[sensor.coupling] with level_db"

    def apply(self, state: EchoState) -> None:
        level = state.level(self.id, lambda: state.scene.causes.coupling.amplitude * rms(state.samples))
        state.samples = state.samples + level * direct_wave(state.array, state.scene.frequencies_hz)


def direct_wave(array: AntennaArray, frequencies_hz: np.ndarray) -> np.ndarray:
    """exp(−j2πf|t − r|/c)/|t − r| in every channel, of mean power 1: complex64 [f, t, r]."""
    distance_m = np.linalg.norm(array.tx_m[:, None] - array.rx_m[None], axis=2)
    gain = 1 / np.maximum(distance_m, 1e-3)  # a transceiver's own leakage is not infinite
    gain /= np.sqrt(np.mean(gain**2))
    return np.stack([gain * phasor(distance_m, f, -1) for f in frequencies_hz]).astype(np.complex64)


class ChannelErrors(Effect):
    """Every antenna's signal is multiplied by its own gain, phase and delay."""

    id = "channels"

    def missing(self, scene: EchoScene) -> str:
        causes = scene.causes.channels
        return "" if causes.gain_db or causes.phase_rad or causes.delay_m else "[sensor.channels] with an error"

    def apply(self, state: EchoState) -> None:
        scene = state.scene
        legs = enumerate(scene.array.channels)
        drawn = [state.random(state.seed(self.id, i)).standard_normal((3, n)) for i, n in legs]
        state.samples = state.samples * _channel_factor(scene.causes.channels, scene.frequencies_hz, drawn)


def _channel_factor(causes: Channels, frequencies_hz: np.ndarray, drawn: list[np.ndarray]) -> np.ndarray:
    """Factor complex64 [f, t, r]; drawn: unit normal numbers [3, n] of each leg: gain, phase, delay."""
    legs = []
    for gain, phase, delay in drawn:
        still = 10 ** (causes.gain_db * gain / 20) * np.exp(1j * causes.phase_rad * phase)
        legs.append(still * phasor(causes.delay_m * delay, frequencies_hz[:, None], -1))
    return (legs[0][:, :, None] * legs[1][:, None]).astype(np.complex64)


class DeadElements(Effect):
    """The channels of dead antennas are zero."""

    id = "dead"

    def missing(self, scene: EchoScene) -> str:
        return "" if scene.causes.dead.tx or scene.causes.dead.rx else "[sensor.dead] with tx or rx"

    def apply(self, state: EchoState) -> None:
        state.samples = silenced(state.samples, state.scene.causes.dead)


def silenced(samples: np.ndarray, dead: Dead) -> np.ndarray:
    """Samples [..., t, r] with the dead antennas' channels zero."""
    alive = np.ones(samples.shape[-2:], np.float32)
    for name, numbers, axis in (("tx", dead.tx, 0), ("rx", dead.rx, 1)):
        wrong = [n for n in numbers if not 0 <= n < alive.shape[axis]]
        if wrong:
            last = alive.shape[axis] - 1
            raise HandbenchError(f"sensor.dead.{name}: is {wrong[0]}; expected numbers from 0 to {last}")
        alive[(slice(None),) * axis + (list(numbers),)] = 0
    return samples * alive
