"""Echoes that go over two places of the target: between fingers, from the thumb into the palm."""

from __future__ import annotations

import numpy as np

from radar.data.arrays import AntennaArray
from radar.simulation.effects.base import NOTHING, Effect, Estimate
from radar.simulation.physics.bundles import RX_NODES_M, TX_NODES_M, Bundles, nodes
from radar.simulation.physics.double_bounce import double_bounce
from radar.simulation.physics.line_of_sight import rays_of
from radar.simulation.physics.ray_tubes import trace
from radar.simulation.physics.reflection import echo_reflection
from radar.simulation.pilot import CENTRE_M, pilot, visible_surface
from radar.simulation.scene import EchoScene
from radar.simulation.state import EchoState, Surface

PATCH = 0.25  # longest edge of a mirror, wavelengths
TURN = 0.15  # rad between two tones per relative amplitude, mean over the pixels: 0.10 to 0.22 measured on four hands
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
        ratio = float(scene.wavelength_m * np.sqrt(caught) * reflection**2 / pilot(scene).channel_rms)
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
