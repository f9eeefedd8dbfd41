"""The effects of the target's surface: obliquity, shadows, skin and roughness.

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
from handbench.radar.simulation.effects.quick_estimate import (
    CENTRE_M,
    QuickEstimate,
    coarse_surface,
    near_outlines,
    visible_from,
    visible_from_centre,
)
from handbench.radar.simulation.physics.diffraction import cached_edges, outline
from handbench.radar.simulation.physics.facets import Facets, convex, face_vectors
from handbench.radar.simulation.physics.line_of_sight import facets_in_sight, lines, rays_of
from handbench.radar.simulation.physics.reflection import skin_layers_m, skin_reflection
from handbench.radar.simulation.physics.sight import NODES_M, samples_of, sight_of
from handbench.radar.simulation.scene import Body, EchoScene
from handbench.radar.simulation.scene_echoes import Echoes, front_facets, generator, require_facets

FACETS_PER_S = 6e4  # coarse facets per CPU second, each tested from all antennas
# points of an outline and facets that an estimate uses, at most
OUTLINES, LOOKED_AT = 500, 2000
WAVES = 64  # of random relief
SPREAD = 0.096  # variance of an equilateral triangle's points along an axis over its area: 1/(6√3)


def obliquity(echoes: Echoes) -> Echoes:
    """Make each facet scatter by the angle at which each antenna sees it, as in physical optics,
    instead of evenly in all directions."""
    return (
        echoes
        if echoes.surface is None
        else replace(echoes, surface=replace(echoes.surface, oblique=True))
    )


def shadow_centre(echoes: Echoes) -> Echoes:
    """Leave out the facets that face away from the aperture's centre or are hidden from it."""
    if echoes.surface is None:
        return echoes
    facets, body = echoes.surface.facets, echoes.surface.body
    corners_m = body.vertices_m[body.faces[facets.face, 0]]
    front = (face_vectors(body.vertices_m, body.faces[facets.face]) * (CENTRE_M - corners_m)).sum(
        axis=1
    ) > 0
    front[front] = rays_of(echoes.scene, body).in_sight(facets.position_m[front], CENTRE_M)
    return replace(echoes, surface=echoes.surface.where(front))


def shadows_cost_s(scene: EchoScene) -> float:
    """Estimate the CPU seconds that computing the shadows of every antenna takes, sharp or
    diffracted."""
    return len(coarse_surface(scene, scene.body)) / FACETS_PER_S


def shadow_antennas(echoes: Echoes) -> Echoes:
    """Compute for each antenna which facets it sees, with sharp shadows. Facets that no transmitter
    or no receiver sees are left out."""
    if echoes.surface is None:
        return echoes
    body, array = echoes.surface.body, echoes.array
    # all facets again: others may see what the centre does not
    facets = front_facets(echoes.scene, body)
    antennas_m = np.concatenate([array.tx_m, array.rx_m])
    seen = facets_in_sight(rays_of(echoes.scene, body), body, facets, antennas_m)
    tx, rx = np.split(seen, [len(array.tx_m)])
    surface = replace(echoes.surface, facets=facets, seen=(tx, rx))
    return replace(echoes, surface=surface.where(np.asarray(tx.any(axis=0) & rx.any(axis=0))))


def estimate_shadow_antennas(scene: EchoScene) -> QuickEstimate:
    """Estimate how much the antennas' own shadows change depths, from the share of the surface that
    only a part of the array sees. Coarse facets are tested for this, from the ends and middles of
    the antenna lines."""
    facets, visible = coarse_surface(scene, scene.body), visible_from_centre(scene)
    (tx, tx_all), (rx, rx_all) = (_from_ends(facets, leg.position_m) for leg in scene.array.legs)
    disputed = ~(tx_all & rx_all & visible) & (tx & rx | visible)
    cosine = -(facets.position_m * facets.normal).sum(axis=1) / np.linalg.norm(
        facets.position_m, axis=1
    )
    faced_m2 = facets.area_m2 * np.maximum(cosine, 0)
    ratio = float(faced_m2[disputed].sum() / max(faced_m2[visible].sum(), 1e-12))
    why = f"depth buffers hide {100 * ratio:.2g} % of the visible surface from a part of the array"
    return QuickEstimate.of_level(scene, ratio, why)


def shadow_diffraction(echoes: Echoes) -> Echoes:
    """Blur each antenna's shadows by diffraction: by waves that bend around outlines, and by waves
    that creep around round edges, which depend on polarisation.

    Left out are diffraction at two edges, change of polarisation, and bends by more than some 40°;
    shadows of multiple bounces stay sharp.
    """
    if echoes.surface is None:
        return echoes
    scene, body = echoes.scene, echoes.surface.body
    facets = front_facets(scene, body)
    sight, some = sight_of(
        scene, body, samples_of(body, facets), rays_of(scene, body), echoes.array, NODES_M
    )
    return replace(
        echoes, surface=replace(echoes.surface, facets=facets, seen=None, sight=sight).where(some)
    )


def estimate_shadow_diffraction(scene: EchoScene) -> QuickEstimate | None:
    """Estimate how much diffraction changes depths, from the share of the surface that is next to
    or behind an outline as seen from the ends of the antenna lines.

    None (unknown) if the scene has a room, since its bodies are behind the target's outline, and
    for a body that is not convex if the share is 0.
    """
    if scene.room:
        return None
    body, every = scene.body, require_facets(coarse_surface(scene, scene.body))
    facets, edges = (
        every.where(np.arange(0, len(every), 1 + len(every) // LOOKED_AT)),
        cached_edges(scene, body),
    )
    ratio = 0.0
    for leg in scene.array.legs:
        views_m = leg.position_m[np.unique([line[[0, -1]] for line in lines(leg.position_m)])]
        for view_m in views_m:
            middle_m = outline(body, edges, view_m).beside_m
            outline_m = middle_m[:: 1 + len(middle_m) // OUTLINES]
            near = near_outlines(
                facets.position_m, facets.normal, outline_m, view_m, scene.wavelength_m
            )
            faced_m2 = facets.area_m2 * np.maximum(
                ((view_m - facets.position_m) * facets.normal).sum(axis=1), 0
            )
            ratio += float(faced_m2[near].sum() / max(faced_m2.sum(), 1e-30)) / len(views_m)
    if ratio == 0 and not convex(body):
        return None
    return QuickEstimate.of_level(
        scene, ratio, f"{50 * ratio:.2g} % of the surface is next to or behind outlines"
    )


def _from_ends(facets: Facets, antennas_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return two boolean masks [p] of the facets: those visible from at least one of the views, and
    those visible from all. The views are the ends and middles of the lines of antennas."""
    views = [
        n for line in lines(antennas_m) for n in np.unique(line[[0, (len(line) - 1) // 2, -1]])
    ]
    visible = np.stack([visible_from(facets, antennas_m[n]) for n in views])
    return np.asarray(visible.any(axis=0)), np.asarray(visible.all(axis=0))


def skin(echoes: Echoes) -> Echoes:
    """Apply the reflection of skin, a half-space under a horny layer that is thick only on the
    palm: weaker than metal's, with a phase that depends on frequency.

    The reflection is that at normal incidence. An image forms where transmitter, receiver and
    surface are specular; at 0.3 m the angle of incidence is then 18° at most, between opposite
    corners of the array. Up to this angle, in either polarisation, Γ of thin skin and of a palm of
    140 µm stays within 0.3 dB and 0.04 rad of normal incidence, and the error of the depth within
    0.01 mm. A palm of 430 µm is near a quarter wave: the difference is 2.5 dB, and 1.5 mm of its
    depth error of 2.6 mm.
    """
    if echoes.surface is None:
        return echoes
    body, facets = echoes.scene.body, echoes.surface.facets
    layer = layers(body, facets.face)
    surface = replace(
        echoes.surface, reflection=reflections(body, echoes.scene.frequencies_hz), layer=layer
    )
    return replace(echoes, surface=surface)


def reflections(body: Body, frequencies_hz: np.ndarray) -> np.ndarray:
    """Return the echo amplitudes of a hand's skin relative to metal, complex [2, f]: of thin skin,
    and of the palm with its thicker horny layer."""
    layers_m = skin_layers_m(body.material)
    return np.stack(
        [skin_reflection(body.material, frequencies_hz, layer_m) for layer_m in layers_m]
    )


def layers(body: Body, face: np.ndarray) -> np.ndarray:
    """Return the kind of skin of each facet [p], as a row of `reflections`: 0 for thin skin, 1 for
    the palm. face [p]: index of the mesh's face that each facet is a part of."""
    return np.zeros(len(face), int) if body.palm is None else body.palm[face].astype(int)


def roughness(echoes: Echoes) -> Echoes:
    """Displace the facets along their normals by a random relief, and weaken each facet's echo by
    the part of the relief that is finer than the facet."""
    if echoes.surface is None:
        return echoes
    waves = waves_of(echoes.scene.causes.roughness, generator(echoes.seed("roughness")))
    facets = displace_facets(echoes.surface.facets, *waves, _wavenumber(echoes.scene))
    return replace(echoes, surface=replace(echoes.surface, facets=facets))


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
    facets: Facets,
    vectors: np.ndarray,
    amplitude_m: np.ndarray,
    phase_rad: np.ndarray,
    wavenumber: float,
) -> Facets:
    """Return the facets displaced along their normals by the relief, a sum of waves (vectors [n, 3]
    in rad/m, amplitude_m [n], phase_rad [n]).

    The part of the relief that is finer than a facet, of variance σ², reduces the facet's area by
    the factor exp(−2k²σ²), its loss of coherent echo; wavenumber: k in rad/m.
    """
    height_m, finer_m2 = np.zeros(len(facets)), np.zeros(len(facets))
    for vector, amplitude, phase in zip(vectors, amplitude_m, phase_rad, strict=True):
        tangential = vector @ vector - (facets.normal @ vector) ** 2
        kept = np.exp(-SPREAD / 2 * tangential * facets.area_m2)  # the wave's mean over a facet
        height_m += amplitude * kept * np.cos(facets.position_m @ vector + phase)
        finer_m2 += amplitude**2 / 2 * (1 - kept**2)
    position_m = facets.position_m + height_m[:, None] * facets.normal
    left = np.exp(-2 * wavenumber**2 * finer_m2)
    return replace(facets, position_m=position_m, area_m2=facets.area_m2 * left)


def _wavenumber(scene: EchoScene) -> float:
    return float(2 * np.pi * scene.frequencies_hz.mean() / SPEED_OF_LIGHT_M_S)
