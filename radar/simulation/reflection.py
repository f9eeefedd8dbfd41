"""Reflection of waves by the materials of bodies, and the dielectric properties of skin.

Time is e^{+jωt}, so that losses are negative imaginary parts.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.radar.simulation.scene import Material

VACUUM_F_M = 8.8541878128e-12


def cole_cole(
    infinity: float,
    step: tuple[float, ...],
    relaxation_s: tuple[float, ...],
    broadening: tuple[float, ...],
    conductivity_s_m: float,
    frequencies_hz: np.ndarray,
) -> np.ndarray:
    """Compute a dielectric's complex relative permittivity [f] by the Cole–Cole model, ε_r(ω) = ε_∞
    + Σ_n Δε_n / (1 + (jωτ_n)^(1−α_n)) + σ/(jωε_0), with time e^{+jωt}. infinity: ε_∞; step: Δε;
    relaxation_s: τ; broadening: α; conductivity_s_m: σ of ions."""
    omega = 2 * np.pi * np.asarray(frequencies_hz, float)[:, None]
    dispersions = step / (1 + (1j * omega * relaxation_s) ** np.subtract(1, broadening))
    ions = conductivity_s_m / (1j * omega[:, 0] * VACUUM_F_M)
    return np.asarray(infinity + dispersions.sum(axis=1) + ions)


# Skin as a whole: S. Gabriel, R. W. Lau, C. Gabriel, Phys. Med. Biol. 41 (1996) 2271, table 1;
# measured up to 20 GHz, extrapolated here. Skin at 40–110 GHz: Christ et al., Bioelectromagnetics
# 42 (2021), doi 10.1002/bem.22362.
DRY = partial(
    cole_cole,
    4.0,
    (32.0, 1100.0, 0.0, 0.0),
    (7.234e-12, 32.481e-9, 159.155e-6, 15.915e-3),
    (0.0, 0.2, 0.2, 0.2),
    0.0002,
)
WET = partial(
    cole_cole,
    4.0,
    (39.0, 280.0, 3e4, 3e4),
    (7.958e-12, 79.577e-9, 1.592e-6, 1.592e-3),
    (0.1, 0.0, 0.16, 0.2),
    0.0004,
)
# Horny layer (stratum corneum): the Debye term of free water of Alekseev & Ziskin,
# Bioelectromagnetics 28 (2007) 331.
HORNY = partial(cole_cole, 2.96, (1.5,), (6.9e-12,), (0.0,), 0.0)

# What represents arm and face in the measurements of Christ et al., and 140 µm the palm; manual
# work thickens that.
THIN_M = 15e-6


def skin_permittivity(frequencies_hz: np.ndarray, wet: bool = False) -> np.ndarray:
    """Return the complex relative permittivity [f] of skin as a whole, for time e^{+jωt}. wet: True
    for moist skin."""
    return (WET if wet else DRY)(frequencies_hz)


def dielectric_permittivity(material: Material) -> complex:
    """Return the complex relative permittivity ε_r(1 − j·tan δ) of plastic."""
    return material.permittivity * (1 - 1j * material.loss_tangent)


def reflections(
    material: Material, frequencies_hz: np.ndarray, cosine: np.ndarray | float = 1.0
) -> np.ndarray:
    """Return the reflection coefficients Γ of a material's plane surface: complex [layers, 2, ...],
    for an electric field across the plane of incidence and for one in it.

    cosine: cosine of the angle of incidence, to whose shape the frequencies broadcast. Skin has
    two layers, thin skin and the palm; other materials have one. For metal all values are −1.
    """
    f = np.asarray(frequencies_hz, float)
    if material.kind == "skin":
        layer, below = HORNY(f), skin_permittivity(f, material.wet)
        thicknesses_m = THIN_M, material.palm_thickness_m
        return np.stack([layer_reflection(layer, below, d, f, cosine) for d in thicknesses_m])
    if material.kind == "plastic":
        return interface(1.0, np.full(f.shape, dielectric_permittivity(material)), cosine)[None]
    return np.full((1, 2, *np.broadcast_shapes(f.shape, np.shape(cosine))), -1.0 + 0j)


def echo_reflections(material: Material, frequencies_hz: np.ndarray) -> np.ndarray:
    """Return the echo amplitudes of a material's layers relative to metal at normal incidence:
    complex [layers, f]. They are −Γ, since the amplitudes of the forward model are those of metal,
    whose Γ is −1."""
    return -reflections(material, frequencies_hz)[:, 0]


def interface(
    above: np.ndarray | complex, below: np.ndarray | complex, cosine: np.ndarray | float = 1.0
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
    layer: np.ndarray,
    below: np.ndarray,
    thickness_m: float,
    frequencies_hz: np.ndarray,
    cosine: np.ndarray | float = 1.0,
) -> np.ndarray:
    """Return the reflection coefficients Γ of a layer on a half-space in air: complex [2, ...], for
    an electric field across the plane of incidence and for one in it.

    Γ = (Γ₁ + Γ₂e)/(1 + Γ₁Γ₂e), e = exp(−2jk√(ε₁ − sin²θ)d) (Born & Wolf, Principles of Optics, sec.
    1.6.4). layer, below: relative permittivities of layer and half-space; cosine: cosine of the
    angle of incidence.
    """
    there_and_back = 4 * np.pi * np.asarray(frequencies_hz) / SPEED_OF_LIGHT_M_S * thickness_m
    normal = np.sqrt(np.asarray(layer, complex) - 1 + np.square(cosine))
    first = interface(1.0, layer, cosine)
    within = interface(layer, below, cosine) * np.exp(-1j * there_and_back * normal)
    return (first + within) / (1 + first * within)
