"""The effect "dielectric": weak reflection by plastic, and delay of the echoes of balls in foam.

Foam (n − 1 ≪ 1): rays are straight, and a path of length ℓ inside is longer by (n − 1)ℓ. Plastic:
only its front surface is simulated, since refraction is strong inside.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from handbench.radar.simulation.physics.reflection import echo_reflection
from handbench.radar.simulation.physics.spheres import foam_delays_m, foam_echoes, has_foam
from handbench.radar.simulation.scene import EchoScene
from handbench.radar.simulation.scene_echoes import Echoes


def has_dielectric(scene: EchoScene) -> bool:
    """Return True if the target is of plastic, or its balls are in foam."""
    return _is_plastic(scene) or any(map(has_foam, scene.balls))


def dielectric(echoes: Echoes) -> Echoes:
    """Give a target of plastic its partial reflection. For balls in foam, their echoes are delayed
    and those of the foam are added."""
    scene = echoes.scene
    if echoes.with_target and any(map(has_foam, scene.balls)):
        array, exponent = echoes.array, echoes.pattern
        echoes = replace(echoes, ball_delay_m=foam_delays_m(scene.balls))
        echoes = echoes.add(
            "dielectric", lambda: foam_echoes(scene.balls, scene.frequencies_hz, array, exponent)
        )
    surface = echoes.surface
    if surface is None or not _is_plastic(scene):
        return echoes
    reflection = echo_reflection(scene.body.material, scene.frequencies_hz)[None]
    layer = np.zeros(len(surface.facets), int)
    return replace(echoes, surface=replace(surface, reflection=reflection, layer=layer))


def _is_plastic(scene: EchoScene) -> bool:
    return scene.target is not None and scene.target.material.kind == "plastic"
