"""The facets of a scene's target that the aperture's centre sees."""

from __future__ import annotations

from handbench.bench.scenes.build import Scene
from handbench.bench.scenes.echoes import echo_scene
from handbench.radar.simulation.effects.target_surface import shadow_centre
from handbench.radar.simulation.forward import Scatterers
from handbench.radar.simulation.scene_echoes import bare_echoes


def visible_surface(scene: Scene) -> Scatterers:
    """Facets of the target that face the aperture's centre and are not in another's shadow."""
    echoes = bare_echoes(echo_scene(scene))
    shadow_centre(echoes)
    return echoes.surface.facets.optics
