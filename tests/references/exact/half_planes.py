"""Exact echoes of a metal half-plane, whose edge runs along y, before short dipoles along its edge.

Sommerfeld's solution for lines along the edge, ∫ e^{−jκR cosh μ} dμ from where the edge cuts it
off, is integrated over the spectrum along the edge and acted on by 1 + ∂²/∂y²/k²; with the path S
in the place of μ,

    D(R) = −(jk/2) ∫ [H₁(kS) + (y/S)² H₃(kS) − H₂(kS)/(kS)] dS / √(S² − R²),

S from the path over the edge,

is what a dipole R away, or its image, has in the other one's shadow; where it is seen, its own
field less D. Time is e^{+jωt}. Sommerfeld, Math. Ann. 47 (1896) 317; Macdonald, Proc. London Math.
Soc. 14 (1915) 410. `test_half_planes.py` of commit 21ae856c holds it against the wave equation, and
against no field on the metal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import hankel2e

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray

NODES = 120  # of Gauss and Legendre
DECAY = 40.0  # of the integrand's exponent, where the integral ends
CLOSEST = (
    1e-10  # in 1/k, of S to R: on the shadow's edge itself, which this moves by 1e-5 of the field
)


@dataclass(frozen=True)
class HalfPlane:
    """A metal half-plane at z_m that faces the radar, from its edge at x_m to x = ∞."""

    x_m: float
    z_m: float


def half_plane_echoes(
    plane: HalfPlane, frequencies_hz: np.ndarray, array: AntennaArray
) -> np.ndarray:
    """Samples complex128 [f, t, r] in the scale of `cylinders.cylinder_echoes`, of dipoles along
    the edge."""
    samples = np.empty((len(frequencies_hz), *array.channels), complex)
    for n, f in enumerate(frequencies_hz):
        wavelength_m = SPEED_OF_LIGHT_M_S / f
        k = 2 * np.pi / wavelength_m
        samples[n] = 1j * wavelength_m * scattered_by_half_plane(plane, k, array.tx_m, array.rx_m)
    return samples


def scattered_by_half_plane(
    plane: HalfPlane, k: float, tx_m: np.ndarray, rx_m: np.ndarray
) -> np.ndarray:
    """The scattered field [t, r] along y; a dipole's field is e^{−jkR}/R broadside."""
    (tx_rho, tx_phi), (rx_rho, rx_phi) = (_around(plane, places_m) for places_m in (tx_m, rx_m))
    along_m = rx_m[None, :, 1] - tx_m[:, None, 1]
    over_edge_m = np.hypot(tx_rho[:, None] + rx_rho, along_m)
    parts = []
    for angle in (
        tx_phi[:, None] - rx_phi,
        tx_phi[:, None] + rx_phi,
    ):  # from the dipole, from its image
        apart = tx_rho[:, None] ** 2 + rx_rho**2 - 2 * np.outer(tx_rho, rx_rho) * np.cos(angle)
        r = np.sqrt(apart + along_m**2)
        shadowed = _beyond_edge(k, r, over_edge_m, along_m)
        seen = np.cos(angle / 2) > 0
        parts.append((seen, _direct(k, r, along_m), shadowed))
    (seen, direct, shadowed), (mirrored, image, image_shadowed) = parts
    return np.where(seen, -shadowed, shadowed - direct) - np.where(
        mirrored, image - image_shadowed, image_shadowed
    )


def _around(plane: HalfPlane, places_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance from the edge and angle in 0 … 2π from the half-plane's front."""
    x, z = places_m[:, 0] - plane.x_m, plane.z_m - places_m[:, 2]
    return np.hypot(x, z), np.arctan2(z, x) % (2 * np.pi)


def _direct(k: float, r: np.ndarray, along_m: np.ndarray) -> np.ndarray:
    """A dipole's field along itself."""
    cosine, near = (along_m / r) ** 2, (1 + 1j * k * r) / (k * r) ** 2
    return np.exp(-1j * k * r) / r * ((1 - cosine) - near * (1 - 3 * cosine))


def _beyond_edge(
    k: float, r: np.ndarray, over_edge_m: np.ndarray, along_m: np.ndarray
) -> np.ndarray:
    """D(R), down the path S = over_edge − jt of steepest descent; t = τ² and τ = √Δ sinh v, Δ =
    over_edge − R, lift the root's singularity."""
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    apart = np.maximum(over_edge_m - r, CLOSEST / k)
    last = np.arcsinh(np.sqrt(DECAY / (k * apart)))
    total = np.zeros(r.shape, complex)
    for node, weight in zip((nodes + 1) / 2, weights / 2, strict=True):
        v = node * last
        t = apart * np.sinh(v) ** 2
        s = over_edge_m - 1j * t
        x = k * s
        h1, h2, h3 = (hankel2e(order, x) for order in (1, 2, 3))  # times e^{jx}
        field = (h1 + (along_m / s) ** 2 * h3 - h2 / x) * np.exp(-1j * k * over_edge_m - k * t)
        # dS = −2jτ dτ, √(S − R) = √Δ √(1 − j sinh² v)
        step = (
            -1j
            * np.sqrt(apart)
            * np.sinh(2 * v)
            / np.sqrt(1 - 1j * np.sinh(v) ** 2)
            / np.sqrt(s + r)
        )
        total += weight * last * field * step
    return -0.5j * k * total
