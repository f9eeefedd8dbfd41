"""Shadows: visibility of the target's facets from each antenna, or from the aperture's centre for all of them."""

from __future__ import annotations

import dataclasses

import numpy as np

from radar.simulation.effects.base import NOTHING, Effect, Estimate
from radar.simulation.physics.facets import Facets, face_vectors
from radar.simulation.physics.line_of_sight import facets_in_sight, lines, rays_of
from radar.simulation.physics.visibility import visible_from
from radar.simulation.pilot import (
    CENTRE_M,
    TOLERANCE,
    body_echoes,
    change_db,
    change_mm,
    coarse_surface,
    pilot,
    seen_from_centre,
)
from radar.simulation.scene import EchoScene
from radar.simulation.state import EchoState, facing

FACETS_PER_S = 5e5  # of the estimate's coarse ones; on two cores


class ShadowCentre(Effect):
    """Facets that the aperture's centre does not see echo nothing."""

    id = "shadow_centre"
    does = "facets hidden from the aperture's centre, or turned away from it, echo nothing"
    source = "geometry, one ray per facet; the bound from a buffer of depths"

    def missing(self, scene: EchoScene) -> str:
        return scene.lacks_surface

    def estimate(self, scene: EchoScene) -> Estimate:
        facets, visible = coarse_surface(scene, scene.body), seen_from_centre(scene)
        share = facets.area_m2[~visible].sum() / facets.area_m2.sum()
        why = f"two tones' images with the {100 * share:.1f} % of the surface that a buffer of depths hides"
        return _estimate(scene, _pair_of(scene, facets.where(~visible)), why, FACETS_PER_S)

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

    def estimate(self, scene: EchoScene) -> Estimate:
        """Of what it changes beyond `shadow_centre`."""
        facets, visible = coarse_surface(scene, scene.body), seen_from_centre(scene)
        (tx, nearest_tx), (rx, nearest_rx) = (_from_ends(facets, leg.position_m) for leg in scene.array.legs)
        everyone = tx.all(axis=0) & rx.all(axis=0) & visible
        differ = ~everyone & ((tx.any(axis=0) & rx.any(axis=0)) | visible)
        share = facets.area_m2[differ].sum() / facets.area_m2.sum()
        change = _pair_of(scene, facets.where(differ), (tx[:, differ][nearest_tx], rx[:, differ][nearest_rx]))
        change -= _pair_of(scene, facets.where(differ & visible))
        why = f"two tones' images; buffers of depths hide {100 * share:.1f} % of the surface from some of the array"
        return _estimate(scene, change, why, FACETS_PER_S / 8)

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


def _estimate(scene: EchoScene, change: np.ndarray, why: str, facets_per_s: float) -> Estimate:
    if not change.any():
        return Estimate(0.0, NOTHING, why)
    samples = pilot(scene).samples + change
    cost_s = len(coarse_surface(scene, scene.body)) / facets_per_s
    return Estimate(change_mm(scene, samples), change_db(scene, samples), why, cost_s)
