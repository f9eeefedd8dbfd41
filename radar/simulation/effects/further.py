"""Further echoes: those over two places of the target, as between fingers, and those of what stands around it."""

from __future__ import annotations

import dataclasses

import numpy as np

from radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray
from radar.simulation.effects.base import NOTHING, Effect, Estimate
from radar.simulation.forward import Scatterers
from radar.simulation.physics.bundles import RX_NODES_M, TX_NODES_M, Bundles, nodes
from radar.simulation.physics.coarse import double_bounce, visible_from
from radar.simulation.physics.diffracted import by_rays, samples_of, sights_of
from radar.simulation.physics.facets import Facets, joined
from radar.simulation.physics.line_of_sight import rays_of
from radar.simulation.physics.ray_tubes import trace
from radar.simulation.physics.reflection import echo_reflection
from radar.simulation.pilot import (
    CENTRE_M,
    LONGEST,
    TOLERANCE,
    body_echoes,
    coarse_surface,
    pilot,
    rms,
    visible_surface,
)
from radar.simulation.scene import Body, EchoScene
from radar.simulation.state import EchoState, Surface, facing
from radar.support.rays import Rays

PATCH = 0.25  # longest edge of a mirror, wavelengths
TURN = 0.15  # rad between two tones per relative amplitude, mean over the pixels: 0.10 to 0.22 measured on four hands
NODES_M, SAMPLES_M = (
    0.03,
    8e-3,
)  # between antennas and points of the room for which the target's diffraction is computed
SECONDS, SECONDS_PER_TUBE = 0.5, 1.6e-6  # on two cores


class Multipath(Effect):
    """Two bounces on the target's own surface, the first as a mirror and the second by physical optics.

    Left out: more bounces, edges, the reflection's dependence on the angle, the field's quarter turn at caustics."""

    id = "multipath"
    does = "echoes over two places of the target, such as two fingers"
    source = "shooting and bouncing rays: Ling, Chou & Lee 1989; the bound: the energy that geometrical optics returns"

    def missing(self, scene: EchoScene) -> str:
        return scene.lacks_surface

    def estimate(self, scene: EchoScene) -> Estimate:
        caught, count = double_bounce(visible_surface(scene), scene.array, CENTRE_M)
        why = f"geometrical optics of {count} facets that mirror onto others"
        reflection = np.abs(echo_reflection(scene.body.material, pilot(scene).tones_hz)).max()
        ratio = float(scene.wavelength_m * np.sqrt(caught) * reflection**2 / rms(pilot(scene).samples))
        if ratio == 0:
            return Estimate(0.0, NOTHING, why, SECONDS)
        tubes = count * 4 * len(nodes(scene.array.tx_m, TX_NODES_M))  # the estimate's facets are twice as coarse
        depth_mm = 1e3 * scene.depth_m_per_rad * min(TURN * ratio, np.pi / 2)
        return Estimate(depth_mm, float(20 * np.log10(ratio)), why, SECONDS + tubes * SECONDS_PER_TUBE)

    def apply(self, state: EchoState) -> None:
        surface = state.surface
        if surface is None:
            return
        body, longest_m = surface.body, PATCH * state.scene.wavelength_m
        array = state.array
        at = nodes(array.tx_m, TX_NODES_M), nodes(array.rx_m, RX_NODES_M)
        few = AntennaArray(array.tx_m[at[0]], array.rx_m[at[1]])
        traced = trace(rays_of(state.scene, body), body, few, longest_m)
        if len(traced.hits.face) == 0:
            return
        bundles = Bundles(traced, _layers(surface), at)

        def echo() -> np.ndarray:
            return bundles.echo(state.scene.frequencies_hz, state.array, surface.reflection, state.pattern)

        state.extra.append(echo)


def _layers(surface: Surface) -> np.ndarray:
    """The layer of each face of the body [m]; 0 where no facet of it is in sight."""
    layer = np.zeros(len(surface.body.faces), int)
    if surface.layer is not None:
        layer[surface.facets.face] = surface.layer
    return layer


class Clutter(Effect):
    """Echoes of the bodies around the target, which stay when it moves or is taken away: by physical optics, in its
    shadow as the aperture's centre casts it, or diffracted as each antenna does; waves that go by way of both target
    and room are left out."""

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
            optics = _seen_behind(state, rays, body)
            clutter += body_echoes(body, optics, scene.frequencies_hz, state.array, state.tolerance, state.pattern)
        state.samples = state.samples + clutter


def _seen_behind(state: EchoState, rays: Rays, body: Body) -> Scatterers:
    """A body's facets as the aperture's centre sees them behind the target; where that diffracts, coarser ones as each
    antenna does."""
    scene, surface = state.scene, state.surface
    if surface is None or surface.sight is None:
        facets = facing(scene, body)
        return facets.where(rays.in_sight(facets.position_m, CENTRE_M)).optics
    facets = facing(scene, body, LONGEST)
    samples, turns_per_m = samples_of(body, facets, SAMPLES_M), scene.frequencies_hz / SPEED_OF_LIGHT_M_S
    look = by_rays(rays, samples.points_m)
    sight, _, some = sights_of(scene, surface.body, samples, look, turns_per_m, state.array, NODES_M)
    return dataclasses.replace(facets.optics, sight=sight).where(some)


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
