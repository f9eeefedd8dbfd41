"""Roughness of the target's surface and layer lines of a print: relief that its mesh does not have.

Heights are a sum of waves over the surface. What facets resolve of a wave displaces them along their normals; the rest,
of variance σ², weakens their echo by exp(−2k²σ²), which is what heights spread by σ leave of a mirrored wave (Ament
1953). What the latter scatter into other directions is left out, and so is the relief's effect on bounces.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.radar.simulation.causes import Roughness
from handbench.radar.simulation.effects.base import Effect, Glance
from handbench.radar.simulation.physics.facets import Facets
from handbench.radar.simulation.pilot import coarse_surface
from handbench.radar.simulation.scene import EchoScene
from handbench.radar.simulation.state import EchoState

WAVES = 64  # of random relief
SPREAD = 0.096  # variance of an even triangle's points along an axis, over its area: 1/(6√3)
SECONDS_PER_WAVE = 2e-8  # of each facet


class SurfaceRoughness(Effect):
    """Relief displaces facets and weakens what they mirror."""

    id = "roughness"

    def missing(self, scene: EchoScene) -> str:
        rough = scene.causes.roughness
        there = scene.target is not None and (rough.rms_m or rough.layer_depth_m)
        return "" if there else "[target.roughness] with rms_m or layer_depth_m"

    def cost_s(self, scene: EchoScene) -> float:
        return SECONDS_PER_WAVE * WAVES * 4 * len(coarse_surface(scene, scene.body))

    def glance(self, scene: EchoScene) -> Glance:
        """The turn 2kσ of the facets' echoes, as if each were another's."""
        turn = 2 * _wavenumber(scene) * scene.causes.roughness.sigma_m
        return Glance.of_level(scene, min(turn, 1.0), f"heights turn echoes by {turn:.2g} rad")

    def apply(self, state: EchoState) -> None:
        if state.surface is not None:
            waves = waves_of(state.scene.causes.roughness, state.random(state.seed(self.id)))
            state.surface.facets = roughened(state.surface.facets, *waves, _wavenumber(state.scene))


def waves_of(rough: Roughness, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Wave vectors [n, 3] in rad/m, amplitudes [n] in m and phases [n] of the relief."""
    vectors = random.normal(0, np.sqrt(2) / rough.correlation_m, (WAVES, 3))
    along = np.array(rough.layers_along) / np.linalg.norm(rough.layers_along)
    vectors = np.concatenate([vectors, 2 * np.pi / rough.layer_pitch_m * along[None]])
    amplitude_m = np.append(np.full(WAVES, rough.rms_m * np.sqrt(2 / WAVES)), rough.layer_depth_m / 2)
    there = amplitude_m > 0
    return vectors[there], amplitude_m[there], random.uniform(0, 2 * np.pi, WAVES + 1)[there]


def roughened(
    facets: Facets, vectors: np.ndarray, amplitude_m: np.ndarray, phase_rad: np.ndarray, wavenumber: float
) -> Facets:
    """The facets displaced along their normals, their areas times what finer relief leaves of their echo."""
    height_m, finer_m2 = np.zeros(len(facets)), np.zeros(len(facets))
    for vector, amplitude, phase in zip(vectors, amplitude_m, phase_rad, strict=True):
        tangential = vector @ vector - (facets.normal @ vector) ** 2
        kept = np.exp(-SPREAD / 2 * tangential * facets.area_m2)  # the wave's mean over a facet
        height_m += amplitude * kept * np.cos(facets.position_m @ vector + phase)
        finer_m2 += amplitude**2 / 2 * (1 - kept**2)
    position_m = facets.position_m + height_m[:, None] * facets.normal
    left = np.exp(-2 * wavenumber**2 * finer_m2)
    return dataclasses.replace(facets, position_m=position_m, area_m2=facets.area_m2 * left)


def _wavenumber(scene: EchoScene) -> float:
    return float(2 * np.pi * scene.frequencies_hz.mean() / SPEED_OF_LIGHT_M_S)
