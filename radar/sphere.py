"""Echo of a metal sphere: Mie's exact series."""

from __future__ import annotations

import numpy as np
from scipy.special import spherical_jn, spherical_yn

from radar.arrays import SPEED_OF_LIGHT_M_S, AntennaArray
from radar.backprojection import path_lengths
from radar.steering import phasor


def mie_backscatter(ka: np.ndarray) -> np.ndarray:
    """Backscattering amplitude of a perfectly conducting sphere over that of geometrical optics: complex [n].

    |F|² = σ/(πa²); its phase counts from the sphere's centre (e^{+jωt}: F → e^{+2jka} for ka → ∞, an echo from the near
    surface). F(ka) = (−j/ka) Σ_n (−1)ⁿ (2n + 1)(a_n − b_n); Ruck et al., Radar Cross Section Handbook, 1970, sec. 3.2.
    """
    x = np.atleast_1d(np.asarray(ka, np.float64))[:, None]
    n = np.arange(1, int(np.ceil(x.max() + 4.05 * np.cbrt(x.max()) + 10)))  # Wiscombe's rule, with some to spare
    j, y = spherical_jn(n, x), spherical_yn(n, x)
    h = j - 1j * y
    j_before, y_before = spherical_jn(n - 1, x), spherical_yn(n - 1, x)
    a = (x * j_before - n * j) / (x * (j_before - 1j * y_before) - n * h)
    b = j / h
    return -1j * ((-1.0) ** n * (2 * n + 1) * (a - b)).sum(axis=1) / x[:, 0]


def sphere_echo(
    centre_m: np.ndarray, radius_m: float, delay_m: float, frequencies_hz: np.ndarray, array: AntennaArray
) -> np.ndarray:
    """Samples complex64 [f, t, r] of a metal sphere: Mie's backscatter, turned to the bistatic angle 2β of each channel
    by the path of its specular point, 2a·cos β instead of 2a. delay_m: extra one-way path (foam).

    Scale and phase are those of `radar.forward`, whose surface integral tends to πa/(jk)·e^{2jka} here.
    """
    cos_beta = half_angle_cosine(centre_m, array)
    spreading = np.multiply.outer(*(leg.lengths_m(centre_m) for leg in array.legs))
    path_m = path_lengths(array, centre_m) + 2 * delay_m
    samples = np.empty((len(frequencies_hz), *array.channels), np.complex64)
    wavenumbers = 2 * np.pi * np.asarray(frequencies_hz) / SPEED_OF_LIGHT_M_S
    for f, (k, echo) in enumerate(zip(wavenumbers, mie_backscatter(wavenumbers * radius_m), strict=True)):
        turned_m = path_m - 2 * radius_m * (cos_beta - 1)
        samples[f] = np.pi * radius_m / (1j * k) * echo * phasor(turned_m, frequencies_hz[f], -1) / spreading
    return samples


def half_angle_cosine(point_m: np.ndarray, array: AntennaArray) -> np.ndarray:
    """cos β of each channel [t, r], 2β the angle between transmitter and receiver as the point [3] sees them."""
    unit_t, unit_r = ((leg.position_m - point_m) / leg.lengths_m(point_m)[:, None] for leg in array.legs)
    return np.linalg.norm(unit_t[:, None] + unit_r[None], axis=2) / 2
