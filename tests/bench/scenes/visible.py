"""The facets of a scene's target that the aperture's centre sees."""

from __future__ import annotations

from handbench.bench.scenes.build import Scene
from handbench.bench.scenes.echoes import echo_scene
from handbench.radar.simulation.forward import Scatterers
from handbench.radar.simulation.physics.line_of_sight import rays_of
from handbench.radar.simulation.scene import CENTRE_M
from handbench.radar.simulation.scene_echoes import front_facets


def visible_surface(scene: Scene) -> Scatterers:
    """Facets of the target that face the aperture's centre and are not in another's shadow."""
    radar_scene = echo_scene(scene)
    facets = front_facets(radar_scene, radar_scene.body)
    rays = rays_of(radar_scene, radar_scene.body)
    return facets.where(rays.in_sight(facets.position_m, CENTRE_M))
