"""The antennas' pattern."""

from __future__ import annotations

from radar.simulation.effects.base import Effect, Estimate
from radar.simulation.pilot import change_db, change_mm, echoes_of, pilot
from radar.simulation.scene import EchoScene
from radar.simulation.state import EchoState


class AntennaPattern(Effect):
    """Every antenna radiates and receives with the amplitude cosᵠθ, θ from the z axis."""

    id = "pattern"
    does = "the antennas' directivity"
    source = "the pilot's two tones with it; cosᵠ: Balanis, Antenna Theory, sec. 2.6; the QAR50's width is not public"

    def missing(self, scene: EchoScene) -> str:
        return "" if scene.causes.pattern.beamwidth_deg is not None else "[sensor.pattern] with beamwidth_deg"

    def estimate(self, scene: EchoScene) -> Estimate:
        width_deg, q = scene.causes.pattern.beamwidth_deg, scene.causes.pattern.exponent
        samples = echoes_of(scene, pilot(scene).tones_hz, scene.array, pattern=q)
        why = f"two tones' images with {width_deg:g}° between the half-power directions, cosᵠθ with q = {q:.2g}"
        return Estimate(change_mm(scene, samples), change_db(scene, samples), why)

    def apply(self, state: EchoState) -> None:
        state.pattern = state.scene.causes.pattern.exponent
