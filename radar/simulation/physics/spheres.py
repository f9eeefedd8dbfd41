"""Echoes of steel balls by Mie's exact series."""

from __future__ import annotations

import numpy as np
from numpy.polynomial.chebyshev import chebpts1, chebvander
from scipy.special import spherical_jn, spherical_yn

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray
from handbench.radar.imaging.cpu.exact import path_lengths
from handbench.radar.imaging.cpu.steering import phasor
from handbench.radar.simulation.scene import EchoScene

# angles at which the series is summed; between them a polynomial is good to 1e-5 for ka ≤ 40 and 2β
# ≤ 60°
NODES = 16


def mie_amplitudes(ka: np.ndarray, cos_beta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compute the scattering amplitudes F of a perfectly conducting sphere over that of geometrical
    optics, for bistatic angles 2β: two arrays complex [n, m] for ka [n] and cos β [m], for the
    field across the plane of scattering (2j/ka·S₁ of the series) and in it (−2j/ka·S₂). For β = 0,
    |F|² = σ/(πa²).

    The phase is relative to the sphere's centre (e^{+jωt}: F → e^{+2jka} for ka → ∞, an echo from
    the near surface). Bohren & Huffman 1983, sec. 4.4 with infinite conductivity: S₁ = Σ
    (2n+1)/(n(n+1)) (aₙπₙ + bₙτₙ), S₂ likewise with πₙ and τₙ exchanged; the scattering angle is π −
    2β.
    """
    x = np.atleast_1d(np.asarray(ka, np.float64))[:, None]
    # Wiscombe's rule, with some to spare
    n = np.arange(1, int(np.ceil(x.max() + 4.05 * np.cbrt(x.max()) + 10)))
    j, y = spherical_jn(n, x), spherical_yn(n, x)
    h = j - 1j * y
    j_before, y_before = spherical_jn(n - 1, x), spherical_yn(n - 1, x)
    a = (x * j_before - n * j) / (x * (j_before - 1j * y_before) - n * h)
    b = j / h
    pi, tau = _angular(len(n), 1 - 2 * np.asarray(cos_beta) ** 2)
    weight = 2j / x * (2 * n + 1) / (n * (n + 1))
    return (weight * a) @ pi + (weight * b) @ tau, -(weight * a) @ tau - (weight * b) @ pi


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
    polarisation: np.ndarray | None = None,
) -> np.ndarray:
    """Compute the samples of a metal sphere by Mie's series, at the bistatic angle of each pair of
    transmitter and receiver: complex64 [f, t, r].

    delay_m: extra one-way path (in foam). polarisation [3]: direction of all antennas' electric
    field; None: unknown, for the mean over its directions in the array's plane. Scale and phase are
    those of `radar.simulation.forward`, whose surface integral tends to πa/(jk)·e^{2jka} for a
    sphere.
    """
    directions = (
        tuple(np.eye(3)[:2]) if polarisation is None else (np.asarray(polarisation, np.float64),)
    )
    across, along = np.mean([_shares(centre_m, array, field) for field in directions], axis=0)
    cos_beta = half_angle_cosine(centre_m, array)
    spreading = np.multiply.outer(*(leg.lengths_m(centre_m) for leg in array.legs))
    path_m = path_lengths(array, centre_m) + 2 * delay_m - 2 * radius_m * cos_beta
    k = 2 * np.pi * np.asarray(frequencies_hz) / SPEED_OF_LIGHT_M_S
    nodes, blend = _nodes(cos_beta)
    # taken out: what is left is smooth
    specular = np.exp(-2j * np.multiply.outer(k * radius_m, nodes))
    s1, s2 = (
        (s * specular).astype(np.complex64) @ blend for s in mie_amplitudes(k * radius_m, nodes)
    )
    turned = (across / spreading).ravel().astype(np.float32) * s1 + (
        along / spreading
    ).ravel().astype(np.float32) * s2
    samples = turned.reshape(len(k), *array.channels)
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


def _shares(point_m: np.ndarray, array: AntennaArray, field: np.ndarray) -> np.ndarray:
    """Compute for each pair of transmitter and receiver the product of both field components across
    the plane of scattering, and of both in that plane: [2, t, r]. field [3]: direction of the
    antennas' electric field, of which each ray has the component across itself."""
    to, back = (leg.directions(point_m) for leg in array.legs)
    normal = np.cross(to[:, None], back[None])
    length = np.linalg.norm(normal, axis=2, keepdims=True)
    normal = np.divide(normal, length, out=np.zeros_like(normal), where=length > 1e-9)
    sent, received = (field - (ray @ field)[:, None] * ray for ray in (to, back))
    sent, received = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (sent, received))
    across = np.einsum("tk,trk->tr", sent, normal) * np.einsum("rk,trk->tr", received, normal)
    in_plane_sent = np.einsum("tk,trk->tr", sent, np.cross(normal, to[:, None]))
    in_plane_received = np.einsum("rk,trk->tr", received, np.cross(normal, -back[None]))
    along = -in_plane_sent * in_plane_received
    monostatic = length[..., 0] <= 1e-9  # any plane will do: the two amplitudes are one
    return np.stack([np.where(monostatic, 1.0, across), np.where(monostatic, 0.0, along)])


def _nodes(cos_beta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Choose NODES cosines over the range of cos_beta [t, r]: (the cosines, matrix complex64
    [NODES, t·r] that interpolates values at them to all pairs of transmitter and receiver)."""
    low, high = float(cos_beta.min()) - 1e-6, float(cos_beta.max()) + 1e-6
    points = chebpts1(NODES)
    place = (2 * cos_beta.ravel() - low - high) / (high - low)
    blend = np.linalg.solve(chebvander(points, NODES - 1).T, chebvander(place, NODES - 1).T)
    return np.minimum((low + high) / 2 + (high - low) / 2 * points, 1.0), blend.astype(np.complex64)


def ball_echoes(
    scene: EchoScene,
    tones_hz: np.ndarray,
    array: AntennaArray,
    delay_m: np.ndarray | None = None,
    pattern: float = 0.0,
) -> np.ndarray:
    """Compute the samples of the scene's steel balls by Mie's series: complex64 [f, t, r].

    delay_m [n]: extra one-way path of each ball's echo (None: 0); pattern: exponent q of the
    antennas' amplitude pattern cosᵠθ.
    """
    delays_m = np.zeros(len(scene.balls)) if delay_m is None else delay_m
    samples = np.zeros((len(tones_hz), *array.channels), np.complex64)
    for ball, extra_m in zip(scene.balls, delays_m, strict=True):
        echo = sphere_echo(ball.centre_m, ball.radius_m, extra_m, tones_hz, array, scene.dipole)
        samples += echo * pattern_gain(ball.centre_m, array, pattern)
    return samples


def pattern_gain(point_m: np.ndarray, array: AntennaArray, pattern: float) -> np.ndarray | float:
    """Return the product of both antennas' pattern cosᵠθ towards a point [3]: float32 [t, r], or
    the number 1.0 if the exponent q = `pattern` is 0."""
    if pattern == 0:
        return 1.0
    cosines = ((point_m - leg.position_m)[:, 2] / leg.lengths_m(point_m) for leg in array.legs)
    return np.multiply.outer(*(np.maximum(cosine, 0) ** pattern for cosine in cosines)).astype(
        np.float32
    )
