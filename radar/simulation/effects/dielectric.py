"""The effect "dielectric": weak reflection by plastic, and delay of the echoes of balls in foam.

Foam (n − 1 ≪ 1): rays are straight, and a path of length ℓ inside is longer by (n − 1)ℓ. Plastic:
only its front surface is simulated, since refraction is strong inside.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from handbench.radar.simulation.physics.reflection import echo_reflection
from handbench.radar.simulation.scene import EchoScene
from handbench.radar.simulation.scene_echoes import Echoes


def has_dielectric(scene: EchoScene) -> bool:
    """Return True if the target is of plastic, or its balls are in foam."""
    plastic = scene.target is not None and scene.target.material.kind == "plastic"
    return plastic or any(ball.foam_delay_m > 0 for ball in scene.balls)


def dielectric(echoes: Echoes) -> None:
    """Delay the echoes of balls in foam, and give a target of plastic its partial reflection."""
    scene, surface = echoes.scene, echoes.surface
    echoes.ball_delay_m = np.array([ball.foam_delay_m for ball in scene.balls])
    if surface is not None and surface.body.material.kind == "plastic":
        reflection = echo_reflection(surface.body.material, scene.frequencies_hz)[None]
        layer = np.zeros(len(surface.facets), int)
        echoes.surface = replace(surface, reflection=reflection, layer=layer)
