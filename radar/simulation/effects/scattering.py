"""The target's surface: obliquity, shadows, skin."""

from __future__ import annotations

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.radar.simulation.effects.base import Effect, Glance
from handbench.radar.simulation.physics.coarse import beside_outlines, visible_from
from handbench.radar.simulation.physics.diffracted import NODES_M, by_rays, samples_of, sight_of
from handbench.radar.simulation.physics.diffraction import kept_edges, outline
from handbench.radar.simulation.physics.facets import Facets, convex, face_vectors
from handbench.radar.simulation.physics.line_of_sight import facets_in_sight, lines, rays_of
from handbench.radar.simulation.physics.reflection import skin_layers_m, skin_reflection
from handbench.radar.simulation.pilot import CENTRE_M, coarse_surface, seen_from_centre
from handbench.radar.simulation.scene import Body, EchoScene
from handbench.radar.simulation.state import EchoState, facing, require_facets


class Obliquity(Effect):
    """Without it a facet scatters evenly towards every antenna."""

    id = "obliquity"

    def missing(self, scene: EchoScene) -> str:
        return "" if scene.target is not None else "a target with a surface"

    def apply(self, state: EchoState) -> None:
        if state.surface is not None:
            state.surface.oblique = True


FACETS_PER_S = 6e4  # coarse ones, each seen from all antennas


class ShadowCentre(Effect):
    """Facets that the aperture's centre does not see echo nothing."""

    id = "shadow_centre"

    def missing(self, scene: EchoScene) -> str:
        return scene.lacks_surface

    def apply(self, state: EchoState) -> None:
        if state.surface is None:
            return
        facets, body = state.surface.facets, state.surface.body
        corners_m = body.vertices_m[body.faces[facets.face, 0]]
        front = (face_vectors(body.vertices_m, body.faces[facets.face]) * (CENTRE_M - corners_m)).sum(axis=1) > 0
        front[front] = rays_of(state.scene, body).in_sight(facets.position_m[front], CENTRE_M)
        state.surface.keep(front)


class _OfEachAntenna(Effect):
    """Shadows of each antenna by itself."""

    def missing(self, scene: EchoScene) -> str:
        return scene.lacks_surface

    def cost_s(self, scene: EchoScene) -> float:
        return len(coarse_surface(scene, scene.body)) / FACETS_PER_S


class ShadowAntennas(_OfEachAntenna):
    """Each antenna sees what nothing hides from it alone."""

    id = "shadow_antennas"

    def glance(self, scene: EchoScene) -> Glance:
        """The share of the surface that not all of the array sees, as the aperture's centre sees or would see it."""
        facets, visible = coarse_surface(scene, scene.body), seen_from_centre(scene)
        (tx, tx_all), (rx, rx_all) = (_from_ends(facets, leg.position_m) for leg in scene.array.legs)
        disputed = ~(tx_all & rx_all & visible) & (tx & rx | visible)
        cosine = -(facets.position_m * facets.normal).sum(axis=1) / np.linalg.norm(facets.position_m, axis=1)
        faced_m2 = facets.area_m2 * np.maximum(cosine, 0)
        ratio = float(faced_m2[disputed].sum() / max(faced_m2[visible].sum(), 1e-12))
        why = f"buffers of depths hide {100 * ratio:.2g} % of the surface in sight from some of the array"
        return Glance.of_level(scene, ratio, why)

    def apply(self, state: EchoState) -> None:
        surface = state.surface
        if surface is None:
            return
        body = surface.body
        surface.facets = facing(state.scene, body)  # anew: what the centre does not see may be seen by others
        antennas_m = np.concatenate([state.array.tx_m, state.array.rx_m])
        seen = facets_in_sight(rays_of(state.scene, body), body, surface.facets, antennas_m)
        tx, rx = np.split(seen, [len(state.array.tx_m)])
        surface.seen = tx, rx
        surface.keep(np.asarray(tx.any(axis=0) & rx.any(axis=0)))


OUTLINES, LOOKED_AT = 500, 2000  # points of an outline and facets, at most, at which a glance looks


class ShadowDiffraction(_OfEachAntenna):
    """Waves bend around the outline of what hides, and creep around what is round of it, each polarisation by itself.
    Left out: waves that bend twice or turn their polarisation, and angles beyond some 40°; where a path bounces,
    its shadows stay sharp."""

    id = "shadow_diffraction"

    def glance(self, scene: EchoScene) -> Glance | None:
        """The share of the surface that lies behind or beside an outline, as the corners of the array see it. What
        stands around the target lies behind its outline, and hollow places are too small to be told."""
        if scene.room:
            return None
        body, every = scene.body, require_facets(coarse_surface(scene, scene.body))
        facets, edges = every.where(np.arange(0, len(every), 1 + len(every) // LOOKED_AT)), kept_edges(scene, body)
        ratio = 0.0
        for leg in scene.array.legs:
            views_m = leg.position_m[np.unique([line[[0, -1]] for line in lines(leg.position_m)])]
            for view_m in views_m:
                middle_m = outline(body, edges, view_m).beside_m
                outline_m = middle_m[:: 1 + len(middle_m) // OUTLINES]
                near = beside_outlines(facets.position_m, facets.normal, outline_m, view_m, scene.wavelength_m)
                faced_m2 = facets.area_m2 * np.maximum(((view_m - facets.position_m) * facets.normal).sum(axis=1), 0)
                ratio += float(faced_m2[near].sum() / max(faced_m2.sum(), 1e-30)) / len(views_m)
        if ratio == 0 and not convex(body):
            return None
        return Glance.of_level(scene, ratio, f"{50 * ratio:.2g} % of the surface lies beside or behind outlines")

    def apply(self, state: EchoState) -> None:
        surface, scene = state.surface, state.scene
        if surface is None:
            return
        body = surface.body
        facets = facing(scene, body)
        samples, turns_per_m = samples_of(body, facets), scene.frequencies_hz / SPEED_OF_LIGHT_M_S
        look = by_rays(rays_of(scene, body), samples.points_m)
        surface.sight, some = sight_of(scene, body, samples, look, turns_per_m, state.array, NODES_M)
        surface.facets, surface.seen = facets, None
        surface.keep(some)


def _from_ends(facets: Facets, antennas_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Masks [p] of the facets that are seen from some and from all of the ends and middles of the antennas' lines."""
    views = [n for line in lines(antennas_m) for n in np.unique(line[[0, (len(line) - 1) // 2, -1]])]
    visible = np.stack([visible_from(facets, antennas_m[n]) for n in views])
    return np.asarray(visible.any(axis=0)), np.asarray(visible.all(axis=0))


class Skin(Effect):
    """A half-space of skin under a horny layer, thin everywhere but on the palm: two surfaces, whose echo is less than
    metal's and turns with frequency.

    At normal incidence. An image forms where transmitter, receiver and surface are specular; at 0.3 m the angle of
    incidence is then 18° at most, between opposite corners of the array. Up to there, in either polarisation, Γ of thin
    skin and of a palm of 140 µm stays within 0.3 dB and 0.04 rad of normal incidence and the bias in depth within 0.01
    mm. A palm of 430 µm is near a quarter wave: 2.5 dB, and 1.5 mm of its bias of 2.6 mm.
    """

    id = "skin"

    def missing(self, scene: EchoScene) -> str:
        return "" if scene.target is not None and scene.target.material.kind == "skin" else "a target of skin"

    def apply(self, state: EchoState) -> None:
        if state.surface is not None:
            state.surface.reflection = reflections(state.scene.body, state.scene.frequencies_hz)
            state.surface.layer = layers(state.scene.body, state.surface.facets.face)


def reflections(body: Body, frequencies_hz: np.ndarray) -> np.ndarray:
    """Echo amplitudes over metal's [layers, f]: thin skin, then the palm's."""
    layers_m = skin_layers_m(body.material)
    return np.stack([skin_reflection(body.material, frequencies_hz, layer_m) for layer_m in layers_m])


def layers(body: Body, face: np.ndarray) -> np.ndarray:
    """Layer of each facet [p] of these faces: 0 thin skin, 1 the palm's."""
    return np.zeros(len(face), int) if body.palm is None else body.palm[face].astype(int)
