"""Echoes of steel balls by Mie's exact series."""

from __future__ import annotations

import numpy as np
from numpy.polynomial.chebyshev import chebpts1, chebvander
from scipy.special import spherical_jn, spherical_yn

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray
from handbench.radar.imaging.exact import path_lengths
from handbench.radar.imaging.steering import phasor

# angles at which the series is summed; between them a polynomial is good to 1e-5 for ka ≤ 40 and 2β
# ≤ 60°
NODES = 16


def mie_amplitude(ka: np.ndarray, cos_beta: np.ndarray) -> np.ndarray:
    """Compute the scattering amplitude F of a perfectly conducting sphere over that of geometrical
    optics, as the mean over the directions of the electric field, for bistatic angles 2β: complex
    [n, m] for ka [n] and cos β [m]. For β = 0, |F|² = σ/(πa²).

    The phase is relative to the sphere's centre (e^{+jωt}: F → e^{+2jka} for ka → ∞, an echo from
    the near surface). F = j/ka·(S₁ − S₂) with the amplitudes across and in the plane of scattering,
    S₁ = Σ (2n+1)/(n(n+1)) (aₙπₙ + bₙτₙ), S₂ likewise with πₙ and τₙ exchanged (Bohren & Huffman
    1983, sec. 4.4 with infinite conductivity); the scattering angle is π − 2β.
    """
    x = np.atleast_1d(np.asarray(ka, np.float64))[:, None]
    # Wiscombe's rule, with some to spare
    n = np.arange(1, int(np.ceil(x.max() + 4.05 * np.cbrt(x.max()) + 10)))
    j, y = spherical_jn(n, x), spherical_yn(n, x)
    h = j - 1j * y
    j_below, y_below = spherical_jn(n - 1, x), spherical_yn(n - 1, x)
    a = (x * j_below - n * j) / (x * (j_below - 1j * y_below) - n * h)
    b = j / h
    pi, tau = _angular(len(n), 1 - 2 * np.asarray(cos_beta) ** 2)
    return 1j / x * (2 * n + 1) / (n * (n + 1)) * (a - b) @ (pi - tau)


def _angular(count: int, mu: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compute the angular functions πₙ and τₙ of Mie's series by upward recurrence, for n = 1 to
    count: two arrays [count, m]. mu [m]: cosines of the scattering angle."""
    pi = np.zeros((count + 1, len(mu)))
    pi[1] = 1
    for n in range(2, count + 1):
        pi[n] = ((2 * n - 1) * mu * pi[n - 1] - n * pi[n - 2]) / (n - 1)
    order = np.arange(1, count + 1)[:, None]
    return pi[1:], order * mu * pi[1:] - (order + 1) * pi[:-1]


def sphere_echo(
    centre_m: np.ndarray,
    radius_m: float,
    delay_m: float,
    frequencies_hz: np.ndarray,
    array: AntennaArray,
) -> np.ndarray:
    """Compute the samples of a metal sphere by Mie's series, at the bistatic angle of each pair of
    transmitter and receiver: complex64 [f, t, r].

    delay_m: extra one-way path (in foam). The echo is the mean over the directions of the antennas'
    electric field. Scale and phase are those of `radar.simulation.forward`, whose surface integral
    tends to πa/(jk)·e^{2jka} for a sphere.
    """
    cos_beta = half_angle_cosine(centre_m, array)
    spreading = np.multiply.outer(*(leg.lengths_m(centre_m) for leg in array.legs))
    path_m = path_lengths(array, centre_m) + 2 * delay_m - 2 * radius_m * cos_beta
    k = 2 * np.pi * np.asarray(frequencies_hz) / SPEED_OF_LIGHT_M_S
    nodes, blend = _nodes(cos_beta)
    # the series without its specular phase is smooth
    smooth = mie_amplitude(k * radius_m, nodes) * np.exp(
        -2j * np.multiply.outer(k * radius_m, nodes)
    )
    samples = (smooth.astype(np.complex64) @ blend).reshape(len(k), *array.channels)
    samples /= spreading.astype(np.float32)
    for sample, f in zip(samples, frequencies_hz, strict=True):
        # πa/jk
        sample *= phasor(path_m, f, -1) * np.complex64(SPEED_OF_LIGHT_M_S * radius_m / (2j * f))
    return samples


def half_angle_cosine(point_m: np.ndarray, array: AntennaArray) -> np.ndarray:
    """Return cos β [t, r], where 2β is the bistatic angle: that at the point [3] between the
    directions to transmitter t and receiver r."""
    return np.linalg.norm(path_gradients(point_m, array), axis=2) / 2


def path_gradients(point_m: np.ndarray, array: AntennaArray) -> np.ndarray:
    """Return the gradient, with respect to the point [3], of the path from transmitter to point to
    receiver: [t, r, 3]. It is û_t + û_r, the sum of the unit vectors from the antennas to the
    point."""
    to, back = (leg.directions(point_m) for leg in array.legs)
    return to[:, None] + back[None]


def _nodes(cos_beta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Choose NODES cosines over the range of cos_beta [t, r]: (the cosines, matrix complex64
    [NODES, t·r] that interpolates values at them to all pairs of transmitter and receiver)."""
    low, high = float(cos_beta.min()) - 1e-6, float(cos_beta.max()) + 1e-6
    points = chebpts1(NODES)
    place = (2 * cos_beta.ravel() - low - high) / (high - low)
    blend = np.linalg.solve(chebvander(points, NODES - 1).T, chebvander(place, NODES - 1).T)
    return np.minimum((low + high) / 2 + (high - low) / 2 * points, 1.0), blend.astype(np.complex64)


def pattern_gain(point_m: np.ndarray, array: AntennaArray, pattern: float) -> np.ndarray | float:
    """Return the product of both antennas' pattern cosᵠθ towards a point [3]: float32 [t, r], or
    the number 1.0 if the exponent q = `pattern` is 0."""
    if pattern == 0:
        return 1.0
    cosines = ((point_m - leg.position_m)[:, 2] / leg.lengths_m(point_m) for leg in array.legs)
    return np.multiply.outer(*(np.maximum(cosine, 0) ** pattern for cosine in cosines)).astype(
        np.float32
    )
