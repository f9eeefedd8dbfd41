"""The effects of the target's surface: obliquity, shadows and roughness.

Roughness is relief that the mesh does not have: heights are a sum of waves over the surface. The
part of a wave that facets resolve displaces them along their normals; the rest, of variance σ²,
weakens their echo by exp(−2k²σ²), the coherent loss of a rough mirror (Ament 1953). Left out are
the diffuse scattering of this rest, and the effect of roughness on multiple bounces.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.radar.simulation.causes import Roughness
from handbench.radar.simulation.forward import Scatterers
from handbench.radar.simulation.physics.line_of_sight import rays_of
from handbench.radar.simulation.physics.shadows import shadowed
from handbench.radar.simulation.scene import EchoScene, generator
from handbench.radar.simulation.scene_echoes import Echoes

NODES_M = 0.025  # between the antennas of a line for which shadows are computed
WAVES = 64  # of random relief
SPREAD = 0.096  # variance of an equilateral triangle's points along an axis over its area: 1/(6√3)


def obliquity(echoes: Echoes) -> None:
    """Make each facet scatter by the angle at which each antenna sees it, as in physical optics,
    instead of evenly in all directions."""
    echoes.oblique = True


def shadow(echoes: Echoes) -> None:
    """Weaken and turn the field of each antenna at the facets by the outlines of the body (see
    `physics.shadows`). Facets that no transmitter or no receiver reaches are left out. The shadows
    of multiple bounces are sharp."""
    scene, facets = echoes.scene, echoes.facets
    if facets is None:
        return
    body, rays = scene.body, rays_of(scene, scene.body)
    facets, reached = shadowed(scene, body, body, facets, rays, echoes.array, NODES_M)
    echoes.facets = facets.where(reached)


def roughness(echoes: Echoes) -> None:
    """Displace the facets along their normals by a random relief, and weaken each facet's echo by
    the part of the relief that is finer than the facet."""
    if echoes.facets is None:
        return
    waves = waves_of(echoes.scene.roughness, generator(echoes.scene.seeds("roughness")))
    echoes.facets = displace_facets(echoes.facets, *waves, _wavenumber(echoes.scene))


def waves_of(
    rough: Roughness, random: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Draw the cosine waves whose sum is the relief: (wave vectors [n, 3] in rad/m, amplitudes [n]
    in m, phases [n] in rad).

    They are WAVES random waves for roughness and one wave for a print's layer lines; those with
    amplitude 0 are left out.
    """
    vectors = random.normal(0, np.sqrt(2) / rough.correlation_m, (WAVES, 3))
    along = np.array(rough.layers_along) / np.linalg.norm(rough.layers_along)
    vectors = np.concatenate([vectors, 2 * np.pi / rough.layer_pitch_m * along[None]])
    amplitude_m = np.append(
        np.full(WAVES, rough.rms_m * np.sqrt(2 / WAVES)), rough.layer_depth_m / 2
    )
    there = amplitude_m > 0
    return vectors[there], amplitude_m[there], random.uniform(0, 2 * np.pi, WAVES + 1)[there]


def displace_facets(
    facets: Scatterers,
    vectors: np.ndarray,
    amplitude_m: np.ndarray,
    phase_rad: np.ndarray,
    wavenumber: float,
) -> Scatterers:
    """Return the facets displaced along their normals by the relief, a sum of waves (vectors [n, 3]
    in rad/m, amplitude_m [n], phase_rad [n]).

    The part of the relief that is finer than a facet, of variance σ², reduces the facet's area by
    the factor exp(−2k²σ²), its loss of coherent echo; wavenumber: k in rad/m.
    """
    assert facets.normal is not None
    height_m = np.zeros(len(facets))
    finer_m2 = np.zeros(len(facets))
    for vector, amplitude, phase in zip(vectors, amplitude_m, phase_rad, strict=True):
        tangential = vector @ vector - (facets.normal @ vector) ** 2
        kept = np.exp(-SPREAD / 2 * tangential * facets.weight)  # the wave's mean over a facet
        height_m += amplitude * kept * np.cos(facets.position_m @ vector + phase)
        finer_m2 += amplitude**2 / 2 * (1 - kept**2)
    position_m = facets.position_m + height_m[:, None] * facets.normal
    left = np.exp(-2 * wavenumber**2 * finer_m2)
    return replace(facets, position_m=position_m, weight=facets.weight * left)


def _wavenumber(scene: EchoScene) -> float:
    return float(2 * np.pi * scene.frequencies_hz.mean() / SPEED_OF_LIGHT_M_S)
