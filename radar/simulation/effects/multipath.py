"""The effect "multipath": echoes of waves that are reflected between two to four places of the
target, such as two fingers."""

from __future__ import annotations

import numpy as np

from handbench.radar.data.arrays import AntennaArray
from handbench.radar.simulation.physics.bundles import Bundles, traced_nodes
from handbench.radar.simulation.physics.creeping import round_ratios, roundness_of
from handbench.radar.simulation.physics.line_of_sight import rays_of
from handbench.radar.simulation.physics.ray_tubes import mirrors_of, trace
from handbench.radar.simulation.physics.reflection import echo_reflections
from handbench.radar.simulation.scene_echoes import Echoes
from handbench.support.parallel import for_each

BOUNCES = 4  # places that a wave meets, at most
PATCH = 0.25  # longest edge of a mirror, wavelengths


def multipath(echoes: Echoes) -> None:
    """Add the waves that meet two to four places of the target's surface. Every place but the last
    reflects like a mirror, and the last radiates by physical optics.

    The result is the mean of this and of the same calculation with transmitters and receivers
    exchanged, so that it is reciprocal. Left out are more than four places, and diffraction at
    edges.
    """
    surface, scene = echoes.surface, echoes.scene
    if surface is None:
        return
    body, rays, layer = (
        surface.body,
        rays_of(scene, surface.body),
        np.zeros(len(surface.body.faces), int),
    )
    layer[surface.facets.face] = surface.layer  # 0 for a face without visible facets
    longest_m = PATCH * scene.wavelength_m
    antennas_m = np.concatenate([leg.position_m for leg in echoes.array.legs])
    mirrors = mirrors_of(rays, body, antennas_m, longest_m, BOUNCES - 1)
    if not len(mirrors.face):
        return
    wavenumber = 0.0 if surface.sight is None else roundness_of(scene, body).wavenumber
    arrays = {1: echoes.array, -1: _exchanged(echoes.array)}
    found: dict[int, Bundles] = {}

    def bounce(sense: int) -> None:
        at = traced_nodes(arrays[sense])
        few = AntennaArray(arrays[sense].tx_m[at[0]], arrays[sense].rx_m[at[1]])
        traced = trace(rays, mirrors, few, wavenumber)
        found[sense] = Bundles(traced, layer, at, scene.dipole)

    for_each(bounce, arrays)
    if not any(map(len, found.values())):
        return

    reflection = echo_reflections(surface.material, scene.frequencies_hz)
    ratios = round_ratios(surface.material, float(scene.frequencies_hz.mean()))
    total = np.zeros((len(scene.frequencies_hz), *echoes.array.channels), np.complex64)
    for sense, array in arrays.items():
        one = found[sense].echo(scene.frequencies_hz, array, reflection, echoes.pattern, ratios)
        total += (one if sense > 0 else one.swapaxes(1, 2)) / 2
    echoes.bounced = total


def _exchanged(array: AntennaArray) -> AntennaArray:
    """Return the array with transmitters and receivers exchanged."""
    return AntennaArray(array.rx_m, array.tx_m)
