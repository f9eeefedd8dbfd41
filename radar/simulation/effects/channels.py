"""Gain, phase and delay errors that calibration has left to each antenna."""

from __future__ import annotations

import numpy as np

from radar.imaging.cpu.steering import phasor
from radar.simulation.causes import Channels
from radar.simulation.effects.base import Effect, Estimate
from radar.simulation.pilot import change_db, change_mm, pilot, stand_in
from radar.simulation.scene import EchoScene
from radar.simulation.state import EchoState


class ChannelErrors(Effect):
    """Every antenna's signal is multiplied by its own gain, phase and delay."""

    id = "channels"
    does = "gain, phase and delay errors of each antenna"
    source = "the pilot's two tones with one set of errors of the same spread"

    def missing(self, scene: EchoScene) -> str:
        causes = scene.causes.channels
        return "" if causes.gain_db or causes.phase_rad or causes.delay_m else "[sensor.channels] with an error"

    def estimate(self, scene: EchoScene) -> Estimate:
        drawn = [stand_in(3 * count, leg).reshape(3, count) for leg, count in enumerate(scene.array.channels)]
        factor = _factor(scene.causes.channels, pilot(scene).tones_hz, drawn)
        samples = pilot(scene).samples * factor
        return Estimate(change_mm(scene, samples), change_db(scene, samples), "two tones' images with such errors")

    def apply(self, state: EchoState) -> None:
        scene = state.scene
        drawn = [
            state.random(state.seed(self.id, leg)).standard_normal((3, count))
            for leg, count in enumerate(scene.array.channels)
        ]
        factor = _factor(scene.causes.channels, scene.frequencies_hz, drawn)
        state.samples = state.samples * factor


def _factor(causes: Channels, frequencies_hz: np.ndarray, drawn: list[np.ndarray]) -> np.ndarray:
    """Factor complex64 [f, t, r]; drawn: unit normal numbers [3, n] of each leg: gain, phase, delay."""
    legs = []
    for gain, phase, delay in drawn:
        still = 10 ** (causes.gain_db * gain / 20) * np.exp(1j * causes.phase_rad * phase)
        legs.append(still * phasor(causes.delay_m * delay, frequencies_hz[:, None], -1))
    return (legs[0][:, :, None] * legs[1][:, None]).astype(np.complex64)
