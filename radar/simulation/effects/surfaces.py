"""The effects of surfaces: the target's obliquity, shadows, roughness, skin and plastic, with the
foam around balls; and the echoes of the room around it.

Roughness is relief that the mesh does not have: heights are a sum of waves over the surface. The
part of a wave that facets resolve displaces them along their normals; the rest, of variance σ²,
weakens their echo by exp(−2k²σ²), the coherent loss of a rough mirror (Ament 1953). Left out are
the diffuse scattering of this rest, and the effect of roughness on multiple bounces.

Foam (n − 1 ≪ 1): rays are straight, and a path of length ℓ inside is longer by (n − 1)ℓ. Plastic:
only its front surface is simulated, since refraction is strong inside.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.radar.simulation.forward import Scatterers, simulate
from handbench.radar.simulation.scene import CENTRE_M, Body, EchoScene, Roughness, generator
from handbench.radar.simulation.scene_echoes import Echoes, front_facets
from handbench.radar.simulation.shadows import shadowed
from handbench.support.rays import Rays

NODES_M = 0.025  # between the antennas of a line for which shadows are computed,
ROOM_NODES_M = 0.03  # and those of the target on the room
ROOM_LONGEST = 0.5  # edge of a facet of the room, wavelengths
WAVES = 64  # of random relief
SPREAD = 0.096  # variance of an equilateral triangle's points along an axis over its area: 1/(6√3)


def obliquity(echoes: Echoes) -> None:
    """Make each facet scatter by the angle at which each antenna sees it, as in physical optics,
    instead of evenly in all directions."""
    echoes.oblique = True


def shadow(echoes: Echoes) -> None:
    """Weaken and turn the field of each antenna at the facets by the outlines of the body (see
    `radar.simulation.shadows`). Facets that no transmitter or no receiver reaches are left out. The
    shadows of multiple bounces are sharp."""
    scene, facets = echoes.scene, echoes.facets
    if facets is None:
        return
    body, rays = scene.body, scene.rays_of(scene.body)
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


def skin(echoes: Echoes) -> None:
    """Apply the reflection of skin, a half-space under a horny layer that is thick only on the
    palm: weaker than metal's, with a phase that depends on frequency.

    The reflection is that at normal incidence. An image forms where transmitter, receiver and
    surface are specular; at 0.3 m the angle of incidence is then 18° at most, between opposite
    corners of the array. Up to this angle, in either polarisation, Γ of thin skin and of a palm of
    140 µm stays within 0.3 dB and 0.04 rad of normal incidence, and the error of the depth within
    0.01 mm. A palm of 430 µm is near a quarter wave: the difference is 2.5 dB, and 1.5 mm of its
    depth error of 2.6 mm.
    """
    if echoes.scene.target is not None:
        echoes.material = echoes.scene.target.material


def dielectric(echoes: Echoes) -> None:
    """Delay the echoes of balls in foam, and give a target of plastic its partial reflection."""
    echoes.ball_delay_m = np.array([ball.foam_delay_m for ball in echoes.scene.balls])
    target = echoes.scene.target
    if target is not None and target.material.kind == "plastic":
        echoes.material = target.material


def clutter(echoes: Echoes, samples: np.ndarray) -> np.ndarray:
    """Add the echoes of the room's bodies, which do not move with the target, by physical optics.
    Waves that meet both target and room are not simulated."""
    rooms = [room_echoes(echoes, echoes.scene.target)] * echoes.frames
    if echoes.empty:
        rooms.append(room_echoes(echoes, None))
    return samples + np.stack(rooms)


def room_echoes(echoes: Echoes, target: Body | None) -> np.ndarray:
    """Simulate the echoes of the room's bodies behind a target, or of the room without it:
    complex64 [f, t, r].

    Facets that are hidden from the aperture's centre are left out. With the effect "shadow", each
    antenna has its own blurred shadow of the target instead.
    """
    scene, array = echoes.scene, echoes.array
    rays = _rays([*scene.room, *([] if target is None else [target])])
    samples = np.zeros((len(scene.frequencies_hz), *array.channels), np.complex64)
    for body in scene.room:
        facets = front_facets(scene, body, ROOM_LONGEST)
        if target is None or echoes.facets is None or echoes.facets.sight is None:
            facets = facets.where(rays.in_sight(facets.position_m, CENTRE_M))
        else:
            facets, reached = shadowed(scene, target, body, facets, rays, array, ROOM_NODES_M)
            facets = facets.where(reached)
        echo = simulate(
            facets, scene.frequencies_hz, array, tolerance=echoes.tolerance, pattern=echoes.pattern
        )
        samples += echo * np.float32(10 ** (body.reflectivity_db / 20))
    return samples


def _rays(bodies: list[Body]) -> Rays:
    """Return one ray caster for all bodies together."""
    counts = np.cumsum([0, *(len(body.vertices_m) for body in bodies[:-1])])
    vertices_m = np.concatenate([body.vertices_m for body in bodies])
    return Rays(
        vertices_m, np.concatenate([body.faces + n for body, n in zip(bodies, counts, strict=True)])
    )
