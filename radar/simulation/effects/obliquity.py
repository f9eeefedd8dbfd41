"""Physical optics' obliquity: a facet scatters less the more it turns away."""

from __future__ import annotations

from radar.simulation.effects.base import Effect, Estimate
from radar.simulation.pilot import change_db, change_mm, echoes_of, pilot
from radar.simulation.scene import EchoScene
from radar.simulation.state import EchoState


class Obliquity(Effect):
    """Without it a facet scatters evenly towards every antenna."""

    id = "obliquity"
    does = "facets scatter with physical optics' obliquity, each antenna by its own angle"
    source = "the pilot's two tones without it; the integrand 2n·û of physical optics, see radar.simulation.forward"

    def missing(self, scene: EchoScene) -> str:
        return "" if scene.target is not None else "a target with a surface"

    def estimate(self, scene: EchoScene) -> Estimate:
        even = echoes_of(scene, pilot(scene).tones_hz, scene.array, oblique=False)
        why = "two tones' images of facets that scatter evenly"
        return Estimate(change_mm(scene, even), change_db(scene, even), why)

    def apply(self, state: EchoState) -> None:
        if state.surface is not None:
            state.surface.oblique = True
