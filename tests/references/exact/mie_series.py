"""Exact echoes of one sphere, of metal, of a dielectric, or of a dielectric with a coat, before
short dipoles.

Green's dyadic of the scattered field is a series of spherical waves M and N that leave the sphere
(Mie's coefficients), for receiver and transmitter. The sum over the azimuthal orders of each degree
n is closed by the addition theorem of Legendre's polynomials, so that P_n(cos γ) and two
derivatives are all that depends on both. Time is e^{+jωt}.

Tai, Dyadic Green Functions in Electromagnetic Theory, 2nd ed. 1994, chapter 10; Bohren & Huffman,
Absorption and Scattering of Light by Small Particles, 1983, chapters 4 and 8 (with e^{−iωt}).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import hankel2, jv, jve

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray

FURTHER_DEGREES = 4.3  # times the cube root of ka, beyond ka: what is left out is below 1e-8


@dataclass(frozen=True)
class CoatedSphere:
    """A sphere in the radar frame. radius_m: outer radius. coat_m: thickness of an outer layer with
    another permittivity than the core (0: no layer)."""

    centre_m: tuple[float, float, float]
    radius_m: float
    coat_m: float = 0.0


def sphere_echoes(
    sphere: CoatedSphere,
    frequencies_hz: np.ndarray,
    array: AntennaArray,
    dipole: np.ndarray,
    permittivity: np.ndarray | None = None,
    coat_permittivity: np.ndarray | None = None,
) -> np.ndarray:
    """Samples complex128 [f, t, r] in the scale of `cylinders.cylinder_echoes`, of dipoles along
    the unit vector [3].

    permittivity: relative, complex [f]; None for metal. coat_permittivity: of the coat [f], where
    there is one."""
    samples = np.empty((len(frequencies_hz), *array.channels), complex)
    for n, f in enumerate(frequencies_hz):
        wavelength_m = SPEED_OF_LIGHT_M_S / f
        fillings = (None if e is None else complex(e[n]) for e in (permittivity, coat_permittivity))
        field = scattered_by_sphere(
            sphere, 2 * np.pi / wavelength_m, array.tx_m, array.rx_m, dipole, *fillings
        )
        samples[n] = 1j * wavelength_m * field
    return samples


class _End(NamedTuple):
    """Antennas [n] from the sphere's centre: unit vectors, the dipole's radial share, and the waves
    of each degree."""

    unit: np.ndarray
    radial: np.ndarray
    turned: np.ndarray  # dipole × unit [n, 3]
    h: np.ndarray  # h_n⁽²⁾ [degree, n]
    h_radial: np.ndarray  # n(n + 1) h_n/ρ
    h_tangential: np.ndarray  # (ρ h_n)'/ρ


def scattered_by_sphere(
    sphere: CoatedSphere,
    k: float,
    tx_m: np.ndarray,
    rx_m: np.ndarray,
    dipole: np.ndarray,
    permittivity: complex | None,
    coat_permittivity: complex | None = None,
) -> np.ndarray:
    """The scattered field [t, r] at the receivers, along their dipoles; a dipole's field is
    e^{−jkR}/R broadside: −jk Σ_n (2n + 1)/(n(n + 1)) of a_n M M' + b_n N N', each with its sum over
    the azimuthal orders."""
    size = k * sphere.radius_m
    degrees = np.arange(1, int(np.ceil(size + FURTHER_DEGREES * np.cbrt(size) + 3)) + 1)
    magnetic, electric = mie(sphere, k, degrees, permittivity, coat_permittivity)
    tx, rx = (
        _end(places_m - np.array(sphere.centre_m), k, degrees, dipole) for places_m in (tx_m, rx_m)
    )
    cosine = tx.unit @ rx.unit.T
    # the dipoles' shares: radial, along the gradient of P_n(cos γ), and across it, of either end
    tx_along = rx.unit @ dipole - cosine * tx.radial[:, None]
    rx_along = (tx.unit @ dipole)[:, None] - cosine * rx.radial
    tx_across, rx_across = tx.turned @ rx.unit.T, tx.unit @ rx.turned.T
    both_along = (
        1 - (tx.radial**2)[:, None] - rx.radial**2 + np.outer(tx.radial, rx.radial) * cosine
    )
    both_across = tx.turned @ rx.turned.T
    field = np.zeros(cosine.shape, complex)
    for i, (n, (p, dp, ddp)) in enumerate(
        zip(degrees, _legendre(cosine, len(degrees)), strict=True)
    ):
        m_part = both_across * dp + tx_across * rx_across * ddp
        n_part = np.outer(tx.h_radial[i] * tx.radial, rx.h_radial[i] * rx.radial) * p
        n_part = n_part + np.outer(tx.h_radial[i] * tx.radial, rx.h_tangential[i]) * rx_along * dp
        n_part += np.outer(tx.h_tangential[i], rx.h_radial[i] * rx.radial) * tx_along * dp
        gradients = both_along * dp + tx_along * rx_along * ddp
        n_part += np.outer(tx.h_tangential[i], rx.h_tangential[i]) * gradients
        weight = (2 * n + 1) / (n * (n + 1))
        field += weight * (magnetic[i] * np.outer(tx.h[i], rx.h[i]) * m_part + electric[i] * n_part)
    return -1j * k * field


def mie(
    sphere: CoatedSphere,
    k: float,
    degrees: np.ndarray,
    permittivity: complex | None,
    coat_permittivity: complex | None,
) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients [degree] of the leaving M and N over those of the arriving ones: with U = ρz(ρ)
    outside, U'/U (M) and U'/(εU) (N), d/dr, are continuous at every surface. Of metal U = 0 (M) and
    U' = 0 (N)."""
    coefficients = []
    for magnetic in (True, False):
        core_m = sphere.radius_m - sphere.coat_m
        if permittivity is None:
            slope: complex | np.ndarray = np.inf if magnetic else 0.0
        else:
            u, du = _riccati(
                jve, degrees, k * np.sqrt(permittivity + 0j) * core_m
            )  # its scale drops out
            slope = _scaled(k, permittivity, magnetic) * du / u
        if coat_permittivity is not None:
            scale = _scaled(k, coat_permittivity, magnetic)
            inner, outer = (
                k * np.sqrt(coat_permittivity + 0j) * r for r in (core_m, sphere.radius_m)
            )
            share = _leaving(degrees, inner, scale, slope)
            (u, du), (v, dv) = (_riccati(z, degrees, outer) for z in (jv, hankel2))
            slope = scale * (du + share * dv) / (u + share * v)
        coefficients.append(_leaving(degrees, k * sphere.radius_m, k, slope))
    return coefficients[0], coefficients[1]


def _scaled(k: float, permittivity: complex, magnetic: bool) -> complex:
    """The factor of U'(ρ)/U in a medium: its k for M, k/ε for N."""
    index = np.sqrt(permittivity + 0j)
    return complex(k * index if magnetic else k / index)


def _leaving(
    degrees: np.ndarray, x: complex, scale: complex, slope: complex | np.ndarray
) -> np.ndarray:
    """The share of H in J + share·H that has this slope at x [degree]."""
    (u, du), (v, dv) = (_riccati(z, degrees, x) for z in (jv, hankel2))
    if np.all(np.isinf(slope)):
        return -u / v
    return -(scale * du - slope * u) / (scale * dv - slope * v)


def _riccati(
    function: np.ufunc, degrees: np.ndarray, x: complex | np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """x z_n(x) and its derivative [degree, …] of the spherical function of J or H⁽²⁾: U_n' =
    U_{n−1} − n U_n/x."""
    n = degrees.reshape(-1, *[1] * np.ndim(x))
    root = np.sqrt(np.pi / 2 * x)
    u, below = root * function(n + 0.5, x), root * function(n - 0.5, x)
    return u, below - n * u / x


def _end(from_centre_m: np.ndarray, k: float, degrees: np.ndarray, dipole: np.ndarray) -> _End:
    distance_m = np.linalg.norm(from_centre_m, axis=1)
    unit, rho = from_centre_m / distance_m[:, None], k * distance_m
    v, dv = _riccati(hankel2, degrees, rho)
    n = degrees[:, None]
    return _End(
        unit, unit @ dipole, np.cross(dipole, unit), v / rho, n * (n + 1) * v / rho**2, dv / rho
    )


def _legendre(
    cosine: np.ndarray, highest: int
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """P_n, P_n' and P_n'' of the degrees 1 … highest."""
    one, zero = np.ones_like(cosine), np.zeros_like(cosine)
    below, now = (one, zero, zero), (cosine, one, zero)
    for n in range(1, highest + 1):
        yield now
        p = ((2 * n + 1) * cosine * now[0] - n * below[0]) / (n + 1)
        # P'_{n+1} = P'_{n−1} + (2n + 1) P_n
        below, now = now, (p, below[1] + (2 * n + 1) * now[0], below[2] + (2 * n + 1) * now[1])
