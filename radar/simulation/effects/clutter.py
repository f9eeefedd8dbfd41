"""Clutter: echoes of the bodies around the target, which stay when the target moves or is taken away."""

from __future__ import annotations

import numpy as np

from radar.simulation.effects.base import Effect, Estimate
from radar.simulation.physics.facets import Facets, joined
from radar.simulation.physics.visibility import visible_from
from radar.simulation.pilot import CENTRE_M, TOLERANCE, body_echoes, coarse_surface, pilot
from radar.simulation.scene import Body, EchoScene
from radar.simulation.state import EchoState, facing
from radar.support.rays import Rays


class Clutter(Effect):
    """The room's bodies by physical optics, in the target's shadow as the aperture's centre casts it; waves that go by
    way of both target and room are left out."""

    id = "clutter"
    does = "echoes of what stands around the target"
    source = "the pilot's two tones with physical optics of the room, cut out where the target stands before it"

    def missing(self, scene: EchoScene) -> str:
        return "" if scene.room else "[stand] with reflectivity_db"

    def estimate(self, scene: EchoScene) -> Estimate:
        known = pilot(scene)
        samples = known.samples.copy()
        for body in scene.room:
            facets = coarse_surface(scene, body)
            facets = facets.where(_beside_target(scene, facets))
            samples += body_echoes(body, facets.optics, known.tones_hz, scene.array, TOLERANCE)
        why = f"two tones' images with the room's {len(scene.room)} bodies, but where the target stands before them"
        return Estimate.of(scene, samples, why, cost_s=5.0)

    def apply(self, state: EchoState) -> None:
        scene = state.scene
        rays = _rays([*scene.room, *_opaque_target(scene, state.with_target)])
        clutter = np.zeros(state.samples.shape[1:], np.complex64)
        for body in scene.room:
            facets = facing(scene, body)
            optics = facets.where(rays.in_sight(facets.position_m, CENTRE_M)).optics
            clutter += body_echoes(body, optics, scene.frequencies_hz, state.array, state.tolerance, state.pattern)
        state.samples = state.samples + clutter


def _opaque_target(scene: EchoScene, with_target: bool) -> tuple[Body, ...]:
    """The target, if it stands there and casts a shadow: foam does not."""
    body = scene.target if with_target else None
    return () if body is None or body.transparent else (body,)


def _beside_target(scene: EchoScene, facets: Facets) -> np.ndarray:
    """Mask [p] of the room's facets that the target does not hide from the aperture's centre, without rays."""
    target = [coarse_surface(scene, body) for body in _opaque_target(scene, True)]
    return visible_from(joined([*target, facets]), CENTRE_M)[sum(map(len, target)) :]


def _rays(bodies: list[Body]) -> Rays:
    """All bodies as one."""
    counts = np.cumsum([0, *(len(body.vertices_m) for body in bodies[:-1])])
    vertices_m = np.concatenate([body.vertices_m for body in bodies])
    return Rays(vertices_m, np.concatenate([body.faces + n for body, n in zip(bodies, counts, strict=True)]))
