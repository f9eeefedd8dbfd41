"""Reflection of skin: less than metal's, and on the palm from two surfaces, so that its phase turns with frequency.

At normal incidence. An image forms where transmitter, receiver and surface are specular; at 0.3 m the angle of
incidence is then 18° at most, between opposite corners of the array. Up to there, in either polarisation, Γ of thin
skin and of a palm of 140 µm stays within 0.3 dB and 0.04 rad of normal incidence and the bias in depth within 0.01
mm. A palm of 430 µm is near a quarter wave: 2.5 dB, and 1.5 mm of its bias of 2.6 mm.
"""

from __future__ import annotations

import numpy as np

from radar.simulation.effects.base import Effect, Estimate
from radar.simulation.physics.reflection import THIN_M, skin_reflection
from radar.simulation.pilot import TOLERANCE, body_echoes, change_db, change_mm, pilot, visible_surface
from radar.simulation.scene import Body, EchoScene
from radar.simulation.state import EchoState


class Skin(Effect):
    """A half-space of skin under a horny layer: thin everywhere but on the palm."""

    id = "skin"
    does = "reflection of skin, with the palm's horny layer"
    source = "Gabriel et al. 1996 and Alekseev & Ziskin 2007; the slope of arg Γ between two tones"

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
        return Estimate(change_mm(scene, samples), change_db(scene, samples), f"two tones' images; {why}", cost_s=0.3)

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
