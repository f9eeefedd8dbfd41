"""Reflection of waves by the materials of bodies, and the dielectric properties of skin.

Time is e^{+jωt}, so that losses are negative imaginary parts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.radar.simulation.scene import Body, Material

VACUUM_F_M = 8.8541878128e-12


@dataclass(frozen=True)
class ColeCole:
    """Cole–Cole model of a dielectric's relative permittivity: ε_r(ω) = ε_∞ + Σ_n Δε_n / (1 +
    (jωτ_n)^(1−α_n)) + σ/(jωε_0), with time e^{+jωt}. The fields are its parameters."""

    infinity: float
    step: tuple[float, ...]  # Δε
    relaxation_s: tuple[float, ...]  # τ
    broadening: tuple[float, ...]  # α
    conductivity_s_m: float = 0.0  # σ of ions

    def permittivity(self, frequencies_hz: np.ndarray) -> np.ndarray:
        """Return the complex relative permittivity at each frequency: [f]."""
        omega = 2 * np.pi * np.asarray(frequencies_hz, float)[:, None]
        step, relaxation_s, broadening = map(
            np.array, (self.step, self.relaxation_s, self.broadening)
        )
        dispersions = step / (1 + (1j * omega * relaxation_s) ** (1 - broadening))
        return (
            self.infinity
            + dispersions.sum(axis=1)
            + self.conductivity_s_m / (1j * omega[:, 0] * VACUUM_F_M)
        )


# Skin as a whole: S. Gabriel, R. W. Lau, C. Gabriel, Phys. Med. Biol. 41 (1996) 2271, table 1;
# measured up to 20 GHz, extrapolated here. Skin at 40–110 GHz: Christ et al., Bioelectromagnetics
# 42 (2021), doi 10.1002/bem.22362.
DRY = ColeCole(
    4.0,
    (32.0, 1100.0, 0.0, 0.0),
    (7.234e-12, 32.481e-9, 159.155e-6, 15.915e-3),
    (0.0, 0.2, 0.2, 0.2),
    0.0002,
)
WET = ColeCole(
    4.0,
    (39.0, 280.0, 3e4, 3e4),
    (7.958e-12, 79.577e-9, 1.592e-6, 1.592e-3),
    (0.1, 0.0, 0.16, 0.2),
    0.0004,
)
# Horny layer (stratum corneum): the Debye term of free water of Alekseev & Ziskin,
# Bioelectromagnetics 28 (2007) 331.
HORNY = ColeCole(2.96, (1.5,), (6.9e-12,), (0.0,))

# What represents arm and face in the measurements of Christ et al., and 140 µm the palm; manual
# work thickens that.
THIN_M = 15e-6


def skin_permittivity(frequencies_hz: np.ndarray, wet: bool = False) -> np.ndarray:
    """Return the complex relative permittivity [f] of skin as a whole, for time e^{+jωt}. wet: True
    for moist skin."""
    return (WET if wet else DRY).permittivity(frequencies_hz)


def echo_reflection(material: Material, frequencies_hz: np.ndarray) -> np.ndarray:
    """Return the echo amplitude of a material's surface relative to metal at normal incidence:
    complex [f]. For skin it is that of thin skin.

    It is −Γ, since the amplitudes of the forward model are those of metal, whose Γ is −1.
    """
    if material.kind == "metal":
        return np.ones(len(frequencies_hz), complex)
    if material.kind == "skin":
        return skin_reflection(material, frequencies_hz, THIN_M)
    return -fresnel(np.full(len(frequencies_hz), dielectric_permittivity(material)))


def body_reflection(body: Body, frequencies_hz: np.ndarray) -> np.ndarray:
    """Return the echo amplitude of a body's surface relative to metal: complex [f]. It comes from
    the body's reflectivity_db if that is given, else from its material (for skin, that of thin
    skin)."""
    if body.reflectivity_db is None:
        return echo_reflection(body.material, frequencies_hz)
    return np.full(len(frequencies_hz), 10 ** (body.reflectivity_db / 20), complex)


def skin_layers_m(material: Material) -> tuple[float, float]:
    """Return the thickness of the horny layer, in metres, of thin skin and of the palm."""
    return THIN_M, material.palm_thickness_m


def skin_reflection(material: Material, frequencies_hz: np.ndarray, horny_m: float) -> np.ndarray:
    """Return the echo amplitude of skin relative to metal at normal incidence, −Γ: complex [f].
    horny_m: thickness of the horny layer on the skin (0: none)."""
    below = skin_permittivity(frequencies_hz, material.wet)
    return -layer_reflection(HORNY.permittivity(frequencies_hz), below, horny_m, frequencies_hz)


def dielectric_permittivity(material: Material) -> complex:
    """Return the complex relative permittivity ε_r(1 − j·tan δ) of plastic."""
    return material.permittivity * (1 - 1j * material.loss_tangent)


def fresnel(permittivity: np.ndarray) -> np.ndarray:
    """Return the reflection coefficient Γ = (1 − n)/(1 + n) of a half-space in air at normal
    incidence, with n = √ε_r: complex, of the shape of `permittivity`."""
    return interface(1.0, permittivity, 1.0)[0]


def interface(
    above: np.ndarray | complex, below: np.ndarray | complex, cosine: np.ndarray | float
) -> np.ndarray:
    """Return the reflection coefficients Γ of a plane wave at the plane between two media: complex
    [2, ...], for an electric field across the plane of incidence and for one in it.

    above, below: complex relative permittivities; cosine: cosine of the angle of incidence in air.
    Γ is that of the field's component along the surface, so that both values agree at normal
    incidence; the admittances are √(ε_r − sin²θ) and ε_r/√(ε_r − sin²θ).
    """
    upper, lower = (np.asarray(medium, complex) for medium in (above, below))
    normal_u, normal_l = (np.sqrt(medium - 1 + np.square(cosine)) for medium in (upper, lower))
    pairs = (normal_u, normal_l), (upper / normal_u, lower / normal_l)
    return np.stack([(u - v) / (u + v) for u, v in pairs])


def layer_reflection(
    layer: np.ndarray, below: np.ndarray, thickness_m: float, frequencies_hz: np.ndarray
) -> np.ndarray:
    """Return the reflection coefficient Γ of a layer on a half-space, in air at normal incidence:
    complex [f], with the phase at the layer's surface. layer, below: relative permittivities [f] of
    layer and half-space."""
    return oblique_layer_reflection(layer, below, thickness_m, frequencies_hz, 1.0)[0]


def oblique_layer_reflection(
    layer: np.ndarray,
    below: np.ndarray,
    thickness_m: float,
    frequencies_hz: np.ndarray,
    cosine: np.ndarray | float,
) -> np.ndarray:
    """Return the reflection coefficients Γ of a layer on a half-space in air: complex [2, ...], for
    an electric field across the plane of incidence and for one in it.

    Γ = (Γ₁ + Γ₂e)/(1 + Γ₁Γ₂e), e = exp(−2jk√(ε₁ − sin²θ)d) (Born & Wolf, Principles of Optics, sec.
    1.6.4). layer, below: relative permittivities of layer and half-space; cosine: cosine of the
    angle of incidence.
    """
    there_and_back = 4 * np.pi * np.asarray(frequencies_hz) / SPEED_OF_LIGHT_M_S * thickness_m
    turned = np.exp(
        -1j * there_and_back * np.sqrt(np.asarray(layer, complex) - 1 + np.square(cosine))
    )
    first, within = interface(1.0, layer, cosine), interface(layer, below, cosine) * turned
    return (first + within) / (1 + first * within)


def oblique_reflections(material: Material, frequency_hz: float, count: int = 65) -> np.ndarray:
    """Return the reflection coefficients Γ of a plane surface: complex [layers, 2, count], for the
    electric field across the plane of incidence and in it.

    The last axis has `count` evenly spaced cosines of the angle of incidence from 0 to 1. Skin has
    two layers, thin skin and the palm; other materials have one. For metal all values are −1.
    """
    if material.kind == "metal":
        return np.full((1, 2, count), -1.0 + 0j)
    cosine = np.maximum(np.linspace(0, 1, count), 1e-6)[:, None]
    if material.kind == "skin":
        f = np.array([frequency_hz])
        media = HORNY.permittivity(f), skin_permittivity(f, material.wet)
        return np.stack(
            [
                oblique_layer_reflection(*media, layer_m, f, cosine)[..., 0]
                for layer_m in skin_layers_m(material)
            ]
        )
    return interface(1.0, dielectric_permittivity(material), cosine)[None, ..., 0]
