"""The target's surface: obliquity, shadows, skin."""

from __future__ import annotations

import dataclasses

import numpy as np

from radar.simulation.effects.base import NOTHING, Effect, Estimate, Glance
from radar.simulation.physics.coarse import visible_from
from radar.simulation.physics.facets import Facets, face_vectors
from radar.simulation.physics.line_of_sight import facets_in_sight, lines, rays_of
from radar.simulation.physics.reflection import THIN_M, skin_reflection
from radar.simulation.pilot import (
    CENTRE_M,
    TOLERANCE,
    body_echoes,
    coarse_surface,
    echoes_of,
    pilot,
    seen_from_centre,
    visible_surface,
)
from radar.simulation.scene import Body, EchoScene
from radar.simulation.state import EchoState, facing


class Obliquity(Effect):
    """Without it a facet scatters evenly towards every antenna."""

    id = "obliquity"
    does = "facets scatter with physical optics' obliquity, each antenna by its own angle"
    source = "the pilot's two tones without it; the integrand 2n·û of physical optics, see radar.simulation.forward"
    takes_time = False

    def missing(self, scene: EchoScene) -> str:
        return "" if scene.target is not None else "a target with a surface"

    def estimate(self, scene: EchoScene) -> Estimate:
        even = echoes_of(scene, pilot(scene).tones_hz, scene.array, oblique=False)
        return Estimate.of(scene, even, "two tones' images of facets that scatter evenly")

    def apply(self, state: EchoState) -> None:
        if state.surface is not None:
            state.surface.oblique = True


FACETS_PER_S = 5e5  # of the estimate's coarse ones


class ShadowCentre(Effect):
    """Facets that the aperture's centre does not see echo nothing."""

    id = "shadow_centre"
    does = "facets hidden from the aperture's centre, or turned away from it, echo nothing"
    source = "geometry, one ray per facet; the bound from a buffer of depths"
    takes_time = False

    def missing(self, scene: EchoScene) -> str:
        return scene.lacks_surface

    def estimate(self, scene: EchoScene) -> Estimate:
        facets, visible = coarse_surface(scene, scene.body), seen_from_centre(scene)
        share = facets.area_m2[~visible].sum() / facets.area_m2.sum()
        why = f"two tones' images with the {100 * share:.1f} % of the surface that a buffer of depths hides"
        return _of_shadow(scene, _pair_of(scene, facets.where(~visible)), why, FACETS_PER_S)

    def apply(self, state: EchoState) -> None:
        if state.surface is None:
            return
        facets, body = state.surface.facets, state.surface.body
        corners_m = body.vertices_m[body.faces[facets.face, 0]]
        front = (face_vectors(body.vertices_m, body.faces[facets.face]) * (CENTRE_M - corners_m)).sum(axis=1) > 0
        front[front] = rays_of(state.scene, body).in_sight(facets.position_m[front], CENTRE_M)
        state.surface.keep(front)


class ShadowAntennas(Effect):
    """Each antenna sees what nothing hides from it alone."""

    id = "shadow_antennas"
    does = "each antenna has shadows of its own (those from the centre are then not used)"
    source = "geometry, rays from every antenna; the bound from buffers of depths at the array's corners"

    def missing(self, scene: EchoScene) -> str:
        return scene.lacks_surface

    def cost_s(self, scene: EchoScene) -> float:
        return len(coarse_surface(scene, scene.body)) / (FACETS_PER_S / 8)

    def glance(self, scene: EchoScene) -> Glance:
        """The disputed facets' share of all, as the aperture's centre sees or would see them."""
        facets, visible = coarse_surface(scene, scene.body), seen_from_centre(scene)
        cosine = -(facets.position_m * facets.normal).sum(axis=1) / np.linalg.norm(facets.position_m, axis=1)
        faced_m2 = facets.area_m2 * np.maximum(cosine, 0)
        ratio = faced_m2[self._disputed(scene)[0]].sum() / max(faced_m2[visible].sum(), 1e-12)
        why = f"buffers of depths hide {100 * ratio:.2g} % of the surface in sight from some of the array"
        return Glance.of_level(scene, float(ratio), why)

    def _disputed(self, scene: EchoScene) -> tuple[np.ndarray, ...]:
        """Mask [p] of the coarse facets that some antennas see and some do not; from which views they are seen, and the
        view nearest to each antenna, of transmitters and of receivers. Made once."""
        return scene.kept("disputed", lambda: self._dispute(scene))

    def _dispute(self, scene: EchoScene) -> tuple[np.ndarray, ...]:
        facets, visible = coarse_surface(scene, scene.body), seen_from_centre(scene)
        (tx, nearest_tx), (rx, nearest_rx) = (_from_ends(facets, leg.position_m) for leg in scene.array.legs)
        everyone = tx.all(axis=0) & rx.all(axis=0) & visible
        differ = ~everyone & ((tx.any(axis=0) & rx.any(axis=0)) | visible)
        return differ, tx, nearest_tx, rx, nearest_rx

    def estimate(self, scene: EchoScene) -> Estimate:
        """Of what it changes beyond `shadow_centre`."""
        facets, visible = coarse_surface(scene, scene.body), seen_from_centre(scene)
        differ, tx, nearest_tx, rx, nearest_rx = self._disputed(scene)
        share = facets.area_m2[differ].sum() / facets.area_m2.sum()
        change = _pair_of(scene, facets.where(differ), (tx[:, differ][nearest_tx], rx[:, differ][nearest_rx]))
        change -= _pair_of(scene, facets.where(differ & visible))
        why = f"two tones' images; buffers of depths hide {100 * share:.1f} % of the surface from some of the array"
        return _of_shadow(scene, change, why, FACETS_PER_S / 8)

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


def _from_ends(facets: Facets, antennas_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """bool [views, p] by buffers of depths at both ends and the middle of each line of antennas, and the view [a] in
    each antenna's line that is nearest to it."""
    visible: list[np.ndarray] = []
    nearest = np.empty(len(antennas_m), int)
    for line in lines(antennas_m):
        views = np.unique([0, (len(line) - 1) // 2, len(line) - 1])
        nearest[line] = len(visible) + np.abs(np.arange(len(line))[:, None] - views).argmin(axis=1)
        visible += [visible_from(facets, antennas_m[line[n]]) for n in views]
    return np.stack(visible), nearest


def _pair_of(scene: EchoScene, facets: Facets, seen: tuple[np.ndarray, np.ndarray] | None = None) -> np.ndarray:
    """Echoes [2, t, r] of some facets at the scene's pair of tones."""
    optics = dataclasses.replace(facets.optics, seen=seen)
    return body_echoes(scene.body, optics, pilot(scene).tones_hz, scene.array, TOLERANCE)


def _of_shadow(scene: EchoScene, change: np.ndarray, why: str, facets_per_s: float) -> Estimate:
    if not change.any():
        return Estimate(0.0, NOTHING, why)
    cost_s = len(coarse_surface(scene, scene.body)) / facets_per_s
    return Estimate.of(scene, pilot(scene).samples + change, why, cost_s)


class Skin(Effect):
    """A half-space of skin under a horny layer, thin everywhere but on the palm: two surfaces, whose echo is less than
    metal's and turns with frequency.

    At normal incidence. An image forms where transmitter, receiver and surface are specular; at 0.3 m the angle of
    incidence is then 18° at most, between opposite corners of the array. Up to there, in either polarisation, Γ of thin
    skin and of a palm of 140 µm stays within 0.3 dB and 0.04 rad of normal incidence and the bias in depth within 0.01
    mm. A palm of 430 µm is near a quarter wave: 2.5 dB, and 1.5 mm of its bias of 2.6 mm.
    """

    id = "skin"
    does = "reflection of skin, with the palm's horny layer"
    source = "Gabriel et al. 1996 and Alekseev & Ziskin 2007; the slope of arg Γ between two tones"
    takes_time = False

    def missing(self, scene: EchoScene) -> str:
        return "" if scene.target is not None and scene.target.material.kind == "skin" else "a target of skin"

    def estimate(self, scene: EchoScene) -> Estimate:
        known = pilot(scene)
        reflection = reflections(scene.body, known.tones_hz)
        bias_m = scene.depth_m_per_rad * np.abs(np.angle(reflection[:, 0] * reflection[:, 1].conj()))
        facets = visible_surface(scene)
        layer = layers(scene.body, facets.face)
        area_m2 = np.bincount(layer, facets.area_m2 * np.abs(facets.normal[:, 2]), len(reflection))
        share = area_m2 / area_m2.sum()
        # The pilot reflects as one half-space: against it both layers count relative to metal, which is what "off" is.
        samples = np.zeros_like(known.samples)
        for n, of_layer in enumerate(reflection):
            echoes = body_echoes(scene.body, facets.where(layer == n).optics, known.tones_hz, scene.array, TOLERANCE)
            samples = samples + echoes * of_layer[:, None, None]
        level_db = 20 * np.log10(np.abs(reflection[:, 0]))
        why = ", ".join(
            f"{name} {100 * part:.0f} %: {db:.1f} dB, {1e3 * metres:.2f} mm from the phase's slope"
            for name, part, db, metres in zip(("thin", "palm"), share, level_db, bias_m, strict=False)
        )
        return Estimate.of(scene, samples, f"two tones' images; {why}", cost_s=0.3)

    def apply(self, state: EchoState) -> None:
        if state.surface is not None:
            state.surface.reflection = reflections(state.scene.body, state.scene.frequencies_hz)
            state.surface.layer = layers(state.scene.body, state.surface.facets.face)


def reflections(body: Body, frequencies_hz: np.ndarray) -> np.ndarray:
    """Echo amplitudes over metal's [layers, f]: thin skin, then the palm's."""
    thicknesses_m = (THIN_M, body.material.palm_thickness_m)
    return np.stack([skin_reflection(body.material, frequencies_hz, thickness_m) for thickness_m in thicknesses_m])


def layers(body: Body, face: np.ndarray) -> np.ndarray:
    """Layer of each facet [p] of these faces: 0 thin skin, 1 the palm's."""
    return np.zeros(len(face), int) if body.palm is None else body.palm[face].astype(int)
