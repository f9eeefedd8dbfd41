"""Phase noise of the oscillator that transmitter and receiver share.

Its phase at the receiver is that of the echo's delay τ ago: what is left of a noise of density L(f) is
4 sin²(πfτ)·L(f) (range correlation; Budge & Burt 1993). With L = L₀·(f₀/f)² below the receiver's bandwidth B,

    σ² = ∫₀^B 2·L·4 sin²(πfτ) df = 8 L₀ f₀² [ πτ·Si(2πτB) − sin²(πτB)/B ].

Transmitters work one after another: the phase is another one for each tone and transmitter, and the same for all
receivers, so that an image of T transmitters averages it to σ/√T.
"""

from __future__ import annotations

import numpy as np
from scipy.special import sici

from radar.data.arrays import SPEED_OF_LIGHT_M_S
from radar.simulation.causes import Oscillator
from radar.simulation.effects.base import Effect, Estimate
from radar.simulation.scene import EchoScene
from radar.simulation.state import EchoState

OFFSET_HZ = 1e6  # where the level is given


class OscillatorNoise(Effect):
    """Every tone of every transmitter is turned by a phase of its own."""

    id = "oscillator"
    does = "phase noise of the common oscillator"
    source = "range correlation, Budge & Burt 1993; c/(4πΔf)·√2·σ/√T·√(2/π)"

    def missing(self, scene: EchoScene) -> str:
        return "" if scene.causes.oscillator.level_dbc_hz is not None else "[sensor.oscillator] with level_dbc_hz"

    def estimate(self, scene: EchoScene) -> Estimate:
        sigma_rad = phase_rad(scene.causes.oscillator, _delay_s(scene))
        depth_m = scene.depth_m_per_rad * 2 / np.sqrt(np.pi) * sigma_rad / np.sqrt(len(scene.array.tx_m))
        why = f"{1e3 * sigma_rad:.2g} mrad per tone and transmitter after range correlation, averaged over transmitters"
        return Estimate(1e3 * depth_m, 20 * np.log10(sigma_rad), why)

    def apply(self, state: EchoState) -> None:
        sigma_rad = phase_rad(state.scene.causes.oscillator, _delay_s(state.scene))
        shape = (len(state.scene.frequencies_hz), len(state.scene.array.tx_m), 1)
        turns = [
            np.exp(1j * sigma_rad * state.random(state.frame_seed(self.id, frame)).standard_normal(shape))
            for frame in range(state.frames)
        ]
        state.samples = (state.samples * np.stack(turns)).astype(np.complex64)


def phase_rad(oscillator: Oscillator, delay_s: float) -> float:
    """Standard deviation of the phase that is left after the echo's delay."""
    a, bandwidth_hz = np.pi * delay_s, oscillator.bandwidth_hz
    integral = a * sici(2 * a * bandwidth_hz)[0] - np.sin(a * bandwidth_hz) ** 2 / bandwidth_hz
    return float(np.sqrt(8 * oscillator.density * OFFSET_HZ**2 * integral))


def _delay_s(scene: EchoScene) -> float:
    """To the target's middle and back."""
    return 2 * float(np.linalg.norm(scene.middle_m)) / SPEED_OF_LIGHT_M_S
