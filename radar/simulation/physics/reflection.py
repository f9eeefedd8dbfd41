"""Reflection at normal incidence of what bodies are made of; time e^{+jωt}, so that losses are negative imaginary."""

from __future__ import annotations

import numpy as np

from radar.data.arrays import SPEED_OF_LIGHT_M_S
from radar.simulation.physics.material import Material
from radar.simulation.physics.tissue import HORNY, THIN_M, skin_permittivity
from radar.simulation.scene import Body


def echo_reflection(material: Material, frequencies_hz: np.ndarray) -> np.ndarray:
    """Echo amplitude of a body's surface over that of metal: complex [f]; of skin, where it is thin. It is −Γ: the
    forward model's amplitudes are metal's, whose Γ is −1."""
    if material.kind == "metal":
        return np.ones(len(frequencies_hz), complex)
    if material.kind == "skin":
        return skin_reflection(material, frequencies_hz, THIN_M)
    return -fresnel(np.full(len(frequencies_hz), dielectric_permittivity(material)))


def body_reflection(body: Body, frequencies_hz: np.ndarray) -> np.ndarray:
    """The same of a body, whose reflectivity may be known: complex [f]."""
    if body.reflectivity_db is None:
        return echo_reflection(body.material, frequencies_hz)
    return np.full(len(frequencies_hz), 10 ** (body.reflectivity_db / 20), complex)


def skin_reflection(material: Material, frequencies_hz: np.ndarray, horny_m: float) -> np.ndarray:
    """−Γ [f] of skin under a horny layer of thickness horny_m (0: the half-space)."""
    below = skin_permittivity(frequencies_hz, material.wet)
    return -layered(HORNY.permittivity(frequencies_hz), below, horny_m, frequencies_hz)


def dielectric_permittivity(material: Material) -> complex:
    """ε_r(1 − j·tan δ) of foam or plastic."""
    return material.real_permittivity * (1 - 1j * material.loss_tangent)


def fresnel(permittivity: np.ndarray) -> np.ndarray:
    """Γ = (1 − n)/(1 + n) from air, n = √ε_r: complex, of any shape."""
    n = np.sqrt(np.asarray(permittivity, complex))
    return (1 - n) / (1 + n)


def layered(layer: np.ndarray, below: np.ndarray, thickness_m: float, frequencies_hz: np.ndarray) -> np.ndarray:
    """Γ [f] from air of a layer on a half-space, permittivities [f]: (Γ₁ + Γ₂e)/(1 + Γ₁Γ₂e), e = exp(−2jkn₁d), its
    phase that of the layer's surface (Born & Wolf, Principles of Optics, sec. 1.6.4)."""
    n1, n2 = np.sqrt(np.asarray(layer, complex)), np.sqrt(np.asarray(below, complex))
    there_and_back = 4 * np.pi * np.asarray(frequencies_hz) / SPEED_OF_LIGHT_M_S * thickness_m
    first, within = fresnel(layer), (n1 - n2) / (n1 + n2) * np.exp(-1j * there_and_back * n1)
    return (first + within) / (1 + first * within)
