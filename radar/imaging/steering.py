"""Steering phases exp(±j2πfR/c), which are computed only here (and, independently, in tests), and
the gains of antennas at points.

Convention: time e^{+jωt}; an echo over the path R has the phase exp(−j2πfR/c), and backprojection
multiplies by the conjugate. Phases are counted in turns (f R / c) and reduced to one turn in
float64 before the float32 sine, which keeps them good to 1e-7 rad at any range; computed in
float32, they would have errors of 3e-4 rad at 2 m.
"""

import math

import numpy as np
from numpy.polynomial import chebyshev, polynomial

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.support.compiled import FAST, njit

# Gains are not smooth enough across the array for skeletons, if
GRAZING = 0.05  # a facet's cosine n·û falls below this,
FADED = 0.35  # or the pattern below this (half the tolerance was measured at 0.3 m).


def _minimax(
    function: np.ufunc, degree: int, parity: int, most: float = 1 / 4
) -> tuple[np.float32, ...]:
    """Fit a polynomial in t² to function(2πt) for |t| ≤ most, by Chebyshev interpolation: its
    float32 coefficients, constant first.

    parity: 0 for the cosine; 1 for the sine, of which function(2πt) / t is fitted.
    """
    u = (np.cos(np.linspace(0, np.pi, 2001)) + 1) / 2 * most**2
    t = np.sqrt(np.maximum(u, 1e-12))
    values = function(2 * np.pi * t) / t**parity
    series = chebyshev.Chebyshev.fit(u, values, degree).convert(kind=polynomial.Polynomial)
    return tuple(np.float32(c) for c in series.coef)


S0, S1, S2, S3, S4, S5 = _minimax(np.sin, 5, 1)
C0, C1, C2, C3, C4, C5 = _minimax(np.cos, 5, 0)
P0, P1, P2, P3, P4, P5, P6 = _minimax(np.sin, 6, 1, 1 / 2)
Q0, Q1, Q2, Q3, Q4, Q5, Q6 = _minimax(np.cos, 6, 0, 1 / 2)


@njit(inline="always")
def cis_turns(turns):  # type: ignore[no-untyped-def]
    """Compute (cos 2πt, sin 2πt) in float32 for a phase t in turns, float64."""
    half = np.rint(2.0 * turns)
    odd = half - 2.0 * np.rint(0.5 * half)  # 0 or ±1
    return _half_turn(np.float32(turns - 0.5 * half), np.float32(1.0 - 2.0 * odd * odd))


@njit(inline="always")
def cis_small(turns):  # type: ignore[no-untyped-def]
    """Compute (cos 2πt, sin 2πt) for a float32 phase t of a few turns, accurate to 5e-7. One series
    covers a whole turn, so that no sign has to be chosen."""
    t = turns - np.rint(turns)
    u = t * t
    cosine = Q0 + u * (Q1 + u * (Q2 + u * (Q3 + u * (Q4 + u * (Q5 + u * Q6)))))
    sine = t * (P0 + u * (P1 + u * (P2 + u * (P3 + u * (P4 + u * (P5 + u * P6))))))
    return cosine, sine


@njit(inline="always")
def _half_turn(t, sign):  # type: ignore[no-untyped-def]
    """Compute sign · (cos 2πt, sin 2πt) for |t| ≤ 1/4, float32."""
    u = t * t
    cosine = C0 + u * (C1 + u * (C2 + u * (C3 + u * (C4 + u * C5))))
    sine = t * (S0 + u * (S1 + u * (S2 + u * (S3 + u * (S4 + u * S5)))))
    return sign * cosine, sign * sine


@njit(**FAST)
def steering(distance_m, turns_per_m, out):  # type: ignore[no-untyped-def]
    """Write exp(j2πfR/c) of distances R [a, p], metres, to out [2a, p], float32: real parts above
    imaginary parts. turns_per_m: f/c."""
    n_antennas, n_points = distance_m.shape
    for a in range(n_antennas):
        for p in range(n_points):
            out[a, p], out[n_antennas + a, p] = cis_turns(turns_per_m * distance_m[a, p])


@njit(**FAST)
def mean_rise(antennas_m, weight, points_m):  # type: ignore[no-untyped-def]
    """Compute the derivative d|p − a|/dz at points p [n, 3], averaged over antennas a [m, 3] with
    weights [m]: [n], without unit."""
    out = np.zeros(len(points_m))
    for p in range(len(points_m)):
        for a in range(len(antennas_m)):
            dx, dy = points_m[p, 0] - antennas_m[a, 0], points_m[p, 1] - antennas_m[a, 1]
            dz = points_m[p, 2] - antennas_m[a, 2]
            out[p] += weight[a] * (dz / math.sqrt(dx * dx + dy * dy + dz * dz))
    return out / weight.sum()


def phasor(path_m: np.ndarray, frequency_hz: np.ndarray | float, sign: int) -> np.ndarray:
    """Compute exp(sign · j2πfR/c) in float64: complex128. R = path_m is the whole path there and
    back, in metres; path_m and frequency_hz broadcast."""
    return np.exp(sign * 2j * np.pi * np.asarray(frequency_hz) * path_m / SPEED_OF_LIGHT_M_S)


def steered_differences(
    lengths_m: np.ndarray, at_centre_m: np.ndarray, turns_per_m: np.ndarray
) -> np.ndarray:
    """Compute the phase factors exp(j2πf(|p − a| − |c − a|)/c₀) for points p, antennas a and a
    centre c: [2p, a], real parts above imaginary parts. lengths_m [p, a]: |p − a|; at_centre_m [a]:
    |c − a|; turns_per_m [p]: f/c₀ of the tone of each point."""
    turns = turns_per_m[:, None] * (lengths_m - at_centre_m)
    angle = ((turns - np.rint(turns)) * (2 * np.pi)).astype(np.float32)
    waves = np.empty((2, *angle.shape))
    np.cos(angle, out=waves[0])
    np.sin(angle, out=waves[1])
    return waves.reshape(-1, angle.shape[1])


@njit(**FAST)
def restore_carrier(  # type: ignore[no-untyped-def]
    re, im, x_m, y_m, z_m, turns_per_m, passes, reference_m, ramp
):
    """Multiply a volume re + j·im [nz, ny, nx] by its carrier, a fast phase that is removed before
    interpolation: complex64 [nz, ny, nx]. The arguments from turns_per_m to ramp are those of
    `GridPlan.carrier`."""
    volume, turns = np.empty(re.shape, np.complex64), np.empty(len(x_m))
    for k in range(len(z_m)):
        for j in range(len(y_m)):
            for i in range(len(x_m)):
                turns[i] = ramp[0] * x_m[i] + ramp[1] * y_m[j] + ramp[2] * z_m[k]
            for leg in range(2):
                dy, dz = y_m[j] - reference_m[leg, 1], z_m[k] - reference_m[leg, 2]
                for i in range(len(x_m)):
                    dx = x_m[i] - reference_m[leg, 0]
                    turns[i] += turns_per_m * passes[leg] * math.sqrt(dx * dx + dy * dy + dz * dz)
            for i in range(len(x_m)):
                cosine, sine = cis_turns(turns[i])
                value_re, value_im = re[k, j, i], im[k, j, i]
                volume[k, j, i] = complex(
                    value_re * cosine - value_im * sine, value_im * cosine + value_re * sine
                )
    return volume


def least_cosine(pattern: float) -> float:
    """Return the smallest cosine of the angle from the z axis at which an antenna's pattern cosᵠθ,
    q = `pattern`, is smooth enough across the array to be interpolated: there the pattern is at
    least FADED and the cosine at least GRAZING. −1 without pattern (q = 0)."""
    return max(GRAZING, FADED ** (1 / pattern)) if pattern != 0 else -1.0


def probe_gains(
    points_m: np.ndarray, antennas_m: np.ndarray, lengths_m: np.ndarray, pattern: float
) -> np.ndarray:
    """Compute the gains between points [p, 3] and antennas [a, 3], from which few antennas are
    chosen that represent all: [p, a], each row with unit mean square. lengths_m [p, a]: distances.

    A gain is 1/R, times the pattern cosᵠθ, q = `pattern`, where that is smooth. For up to half of
    the points it is also multiplied by the obliquity √(n·û) of a facet; the normals n are spread
    over the directions that every antenna sees.
    """
    gains, normals = 1 / lengths_m, _normals(len(points_m))
    heights_m = np.einsum("pi,pi->p", normals, points_m)
    obliquity = (normals @ antennas_m.T - heights_m[:, None]) * gains
    oblique = (obliquity >= GRAZING).all(axis=1)
    gains[oblique] *= np.sqrt(obliquity[oblique])
    if pattern:
        axial = (points_m[:, 2, None] - antennas_m[:, 2]) / lengths_m
        patterned = (axial >= least_cosine(pattern)).all(axis=1)
        gains[patterned] *= axial[patterned] ** pattern
    return gains / np.sqrt(np.mean(gains**2, axis=1))[:, None]


def _normals(count: int) -> np.ndarray:
    """Return unit vectors [count, 3] spread evenly over the sphere; always the same ones for the
    same count."""
    plastic = 1.324717957244746  # g³ = g + 1: the ratio for two dimensions
    u = (0.5 + np.arange(count)[:, None] / plastic ** np.arange(1, 3)) % 1.0
    z, azimuth = 2 * u[:, 0] - 1, 2 * np.pi * u[:, 1]
    across = np.sqrt(1 - z**2)
    return np.stack([across * np.cos(azimuth), across * np.sin(azimuth), z], axis=1)
