"""The ray caster of a body."""

from __future__ import annotations

from handbench.radar.simulation.scene import Body, EchoScene
from handbench.support.rays import Rays


def rays_of(scene: EchoScene, body: Body) -> Rays:
    """Return the ray caster of a body's mesh, built once per scene."""
    return scene.cached(("rays", id(body)), lambda: Rays(body.vertices_m, body.faces))
