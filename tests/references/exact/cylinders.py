"""Exact echoes of parallel, infinitely long circular cylinders, of metal or of a dielectric, before
short dipoles along their axis.

Along the cylinders' axis the field is a spectrum of waves e^{−jβa}; around each cylinder, with κ =
√(k² − β²), it is a series of J_m and H_m⁽²⁾ times e^{jmφ}. Both axial components, E_a and H_a
(times the impedance of free space), are expanded; a cylinder couples them where β ≠ 0, unless it is
of metal, around which there is no H_a of such dipoles. Graf's theorem carries the waves that one
cylinder scatters to the others, so that all orders of scattering are there. Time is e^{+jωt}.

Wait, The scattering of electromagnetic waves from dielectric cylinders, Can. J. Phys. 33 (1955)
189; Olaofe, Scattering by two cylinders, Radio Sci. 5 (1970) 1351; Abramowitz & Stegun 9.1.27
(derivatives), 9.1.79 (Graf). `test_cylinders.py` of commit fed65f85 holds it to no field along
metal, reciprocity and geometrical optics.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import hankel2, jv, jve

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray

# of the spectrum, as shares of k: sines of the angles out of the plane across the axis
TAPER = (0.4, 0.65)
FURTHER_ORDERS = 4.0  # times the cube root of κa, beyond κa: what is left out is below 1e-8


@dataclass(frozen=True)
class Cylinder:
    """A cylinder in the radar frame. Its axis is parallel to y and goes through (x_m, z_m)."""

    x_m: float
    z_m: float
    radius_m: float


def cylinder_echoes(
    cylinders: list[Cylinder],
    frequencies_hz: np.ndarray,
    array: AntennaArray,
    permittivity: np.ndarray | None = None,
) -> np.ndarray:
    """Samples complex128 [f, t, r] as `radar.simulation.forward` scales them.

    permittivity: relative, complex [f]; None for metal. A transmitter's dipole has the field
    e^{−jkR}/R broadside; jλ times the scattered one at the receivers makes the echo of a metal
    plate what physical optics' integral says at the specular point.
    """
    samples = np.empty((len(frequencies_hz), *array.channels), complex)
    for n, f in enumerate(frequencies_hz):
        wavelength_m = SPEED_OF_LIGHT_M_S / f
        filling = None if permittivity is None else complex(permittivity[n])
        k = 2 * np.pi / wavelength_m
        field = scattered(cylinders, k, array.tx_m, array.rx_m, filling)
        samples[n] = 1j * wavelength_m * field
    return samples


def scattered(
    cylinders: list[Cylinder],
    k: float,
    tx_m: np.ndarray,
    rx_m: np.ndarray,
    permittivity: complex | None,
) -> np.ndarray:
    """The scattered field [t, r] at the receivers, along their dipoles."""
    tx_across, tx_place = np.unique(tx_m[:, [2, 0]], axis=0, return_inverse=True)
    rx_across, rx_place = np.unique(rx_m[:, [2, 0]], axis=0, return_inverse=True)
    along_m = rx_m[None, :, 1] - tx_m[:, None, 1]
    farthest_m = sum(np.abs(across).max() for across in (tx_across, rx_across)) + 2 * max(
        c.z_m for c in cylinders
    )
    beta, weight = axial_spectrum(k, float(np.abs(along_m).max()), float(farthest_m))
    field = np.zeros(along_m.shape, complex)
    for b, w in zip(beta, weight, strict=True):
        wave = _Wave(k, b, np.sqrt(k**2 - b**2))
        each = [(cylinder, _highest(wave.kappa * cylinder.radius_m)) for cylinder in cylinders]
        arriving = np.concatenate([_arriving(wave, c, m, tx_across) for c, m in each])
        received = np.concatenate(
            [_outgoing(wave.kappa, m, rx_across - [c.z_m, c.x_m]) for c, m in each]
        )
        across = _scatter(wave, each, permittivity, arriving).T @ received
        field += w * np.cos(b * along_m) * across[np.ix_(tx_place, rx_place)]
    return field


def axial_spectrum(k: float, along_m: float, path_m: float) -> tuple[np.ndarray, np.ndarray]:
    """β ≥ 0 [b] and their weights in the integral of what is even in β, over 2π: sampled so finely
    that what comes back a period later has a longer way along the axis than waves below the taper's
    end take on a path of this length. The taper falls with all its derivatives, so that it adds no
    echo of its own."""
    period_m = 2 * (along_m + path_m * TAPER[1] / np.sqrt(1 - TAPER[1] ** 2))
    step = 2 * np.pi / period_m
    beta = step * np.arange(int(TAPER[1] * k / step) + 1)
    place = np.clip((beta / k - TAPER[0]) / (TAPER[1] - TAPER[0]), 2e-3, 1 - 2e-3)
    taper = 1 / (1 + np.exp(1 / (1 - place) - 1 / place))
    return beta, taper * np.where(beta > 0, 2, 1) / period_m


def _highest(size: float) -> int:
    """The highest order around a cylinder of this κa; the lowest is its negative."""
    return int(np.ceil(size + FURTHER_ORDERS * np.cbrt(size) + 3))


class _Wave(NamedTuple):
    k: float
    beta: float
    kappa: float


def _hankel(highest: int, x: np.ndarray) -> np.ndarray:
    """H_m⁽²⁾ [m, n] of the orders −highest … highest at real x [n], by the recurrence, which is
    stable upwards."""
    h = np.empty((max(highest, 1) + 1, len(x)), complex)
    h[0], h[1] = hankel2(0, x), hankel2(1, x)
    for m in range(1, highest):
        h[m + 1] = 2 * m / x * h[m] - h[m - 1]
    return _with_negative(h[: highest + 1])


def _with_negative(positive: np.ndarray) -> np.ndarray:
    """Z_m of the orders −highest … highest from those of 0 … highest, along the first axis: Z_{−m}
    = (−1)^m Z_m."""
    negative = positive[:0:-1].copy()
    negative[len(positive) % 2 :: 2] *= -1
    return np.concatenate([negative, positive])


def _outgoing(kappa: float, highest: int, across_m: np.ndarray) -> np.ndarray:
    """Ψ_m = H_m⁽²⁾(κρ) e^{jmφ} [m, n] of the orders −highest … highest at places [n, 2] across the
    axis."""
    rho, phi = np.hypot(*across_m.T), np.arctan2(across_m[:, 1], across_m[:, 0])
    return _hankel(highest, kappa * rho) * np.exp(
        1j * np.arange(-highest, highest + 1)[:, None] * phi
    )


def _arriving(wave: _Wave, cylinder: Cylinder, highest: int, tx_across_m: np.ndarray) -> np.ndarray:
    """Amplitudes [m, t] of J_m e^{jmφ} of E_a around a cylinder, from unit dipoles: E = (1 +
    ∇∇·/k²)(d g), g = e^{−jkR}/R, whose spectrum is −jπ H₀(κ|ρ − ρ'|)."""
    # from the dipole to the axis: H₀ there is Σ Ψ_{−m}(axis − dipole) J_m e^{jmφ}
    psi = _outgoing(wave.kappa, highest, [cylinder.z_m, cylinder.x_m] - tx_across_m)[::-1]
    return -1j * np.pi * wave.kappa**2 / wave.k**2 * psi


def _scatter(
    wave: _Wave,
    each: list[tuple[Cylinder, int]],
    permittivity: complex | None,
    arriving: np.ndarray,
) -> np.ndarray:
    """Amplitudes [m, t] of the waves Ψ_m of E_a that all cylinders scatter together, from those
    that arrive from the dipoles.

    (I − TG) c = T a is solved for what the waves are at the surfaces, c H_m(κa), where high orders
    are small and harm no condition."""
    single = np.concatenate([_single(wave, m, c.radius_m, permittivity) for c, m in each], axis=2)
    at_surface = np.concatenate([_hankel(m, np.array([wave.kappa * c.radius_m])) for c, m in each])
    waves = single[:, 0, :, None] * (arriving * at_surface)  # T a
    if len(each) > 1:
        carried = _translations(wave, each) * at_surface / at_surface.T  # G
        size = len(single) * len(carried)
        coupling = np.einsum("abm,mn->ambn", single, carried).reshape(size, size)  # T G
        solved = np.linalg.solve(np.eye(size) - coupling, waves.reshape(size, -1))
        waves = solved.reshape(waves.shape)
    return waves[0] / at_surface


def _translations(wave: _Wave, each: list[tuple[Cylinder, int]]) -> np.ndarray:
    """G [m, n]: amplitudes of J_m around each cylinder from waves Ψ_n of the others, by Graf's
    theorem."""
    ends = np.cumsum([0, *(2 * m + 1 for _, m in each)])
    carried = np.zeros((ends[-1], ends[-1]), complex)
    for i, (one, here) in enumerate(each):
        for j, (other, there) in enumerate(each):
            if i != j:
                between_m = np.array([[one.z_m - other.z_m, one.x_m - other.x_m]])
                steps = (
                    np.arange(2 * there + 1)[None, :] - np.arange(2 * here + 1)[:, None] + 2 * here
                )
                every = _outgoing(wave.kappa, here + there, between_m)[:, 0]
                carried[ends[i] : ends[i + 1], ends[j] : ends[j + 1]] = every[steps]
    return carried


def _single(wave: _Wave, highest: int, radius_m: float, permittivity: complex | None) -> np.ndarray:
    """T [2, 2, m] of one cylinder, from the continuity of E_a, H_a, E_φ and H_φ; of metal [1, 1,
    m], from E_a = 0."""
    k, beta, kappa = wave
    x = kappa * radius_m
    further = np.arange(highest + 2)
    j, dj = _and_derivative(_with_negative(jv(further, x)))
    h, dh = _and_derivative(_hankel(highest + 1, np.array([x]))[:, 0])
    if permittivity is None:
        return np.array([[-j / h]])
    kappa1 = np.sqrt(permittivity * k**2 - beta**2 + 0j)
    x1 = kappa1 * radius_m
    within, slope = _and_derivative(_with_negative(jve(further, x1)))
    inside = slope / (kappa1 * within)  # J'/(κ₁J): the scale of jve drops out
    mixed = (
        beta
        * np.arange(-highest, highest + 1)
        / (1j * k * radius_m)
        * (1 / kappa**2 - 1 / kappa1**2)
    )
    # [mixed·Z, Z'/κ − inside·Z; ε·inside·Z − Z'/κ, mixed·Z] (E_a, H_a), once for what goes, once
    # for what comes
    going, coming = (
        np.array(
            [
                [mixed * z, dz / kappa - inside * z],
                [permittivity * inside * z - dz / kappa, mixed * z],
            ]
        )
        for z, dz in ((h, dh), (j, dj))
    )
    return np.moveaxis(-np.linalg.solve(np.moveaxis(going, 2, 0), np.moveaxis(coming, 2, 0)), 0, 2)


def _and_derivative(wider: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Z_m and Z_m' = (Z_{m−1} − Z_{m+1})/2 [m] of Z, which has an order more on either side."""
    return wider[1:-1], (wider[:-2] - wider[2:]) / 2
