"""Steering phases exp(±j2πfR/c), which are computed only here (and, independently, in tests), and
the gains of antennas at points.

Convention: time e^{+jωt}; an echo over the path R has the phase exp(−j2πfR/c), and backprojection
multiplies by the conjugate. Phases are counted in turns (f R / c) and reduced to one turn in
float64 before the float32 sine, which keeps them good to 1e-7 rad at any range; computed in
float32, they would have errors of 3e-4 rad at 2 m.
"""

import numpy as np
from numpy.polynomial import chebyshev, polynomial

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.support.compiled import FAST, INNER, njit, outer

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


@njit(**INNER)
def inner_distances_m(antennas_m, points_m):  # type: ignore[no-untyped-def]
    """Compute the distances [a, p] (float64) of antennas [a, 3] to points [3, p], metres."""
    out = np.empty((len(antennas_m), points_m.shape[1]))
    for a in range(len(antennas_m)):
        ax, ay, az = antennas_m[a, 0], antennas_m[a, 1], antennas_m[a, 2]
        for p in range(points_m.shape[1]):
            dx, dy, dz = points_m[0, p] - ax, points_m[1, p] - ay, points_m[2, p] - az
            out[a, p] = np.sqrt(dx * dx + dy * dy + dz * dz)
    return out


distances_m = outer(inner_distances_m)


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
            out[p] += weight[a] * (dz / np.sqrt(dx * dx + dy * dy + dz * dz))
    return out / weight.sum()


def phasor(path_m: np.ndarray, frequency_hz: np.ndarray | float, sign: int) -> np.ndarray:
    """Compute exp(sign · j2πfR/c) in float64: complex128. R = path_m is the whole path there and
    back, in metres; path_m and frequency_hz broadcast."""
    return np.exp(sign * 2j * np.pi * np.asarray(frequency_hz) * path_m / SPEED_OF_LIGHT_M_S)


@njit(**FAST)
def steered_differences(  # type: ignore[no-untyped-def]
    antennas_m, turns_per_m, points_m, centre_m
):
    """Compute the phase factors exp(j2πf(|p − a| − |c − a|)/c₀) for points p [n, 3], antennas a [m,
    3] and the centre c [3]: float32 [2n, m], real parts above imaginary parts. turns_per_m [n]:
    f/c₀ of the tone of each point."""
    n_points, n_antennas = len(points_m), len(antennas_m)
    out = np.empty((2 * n_points, n_antennas), np.float32)
    at_centre = np.empty(n_antennas)
    for a in range(n_antennas):
        dx, dy, dz = (
            centre_m[0] - antennas_m[a, 0],
            centre_m[1] - antennas_m[a, 1],
            centre_m[2] - antennas_m[a, 2],
        )
        at_centre[a] = np.sqrt(dx * dx + dy * dy + dz * dz)
    for p in range(n_points):
        for a in range(n_antennas):
            dx, dy = points_m[p, 0] - antennas_m[a, 0], points_m[p, 1] - antennas_m[a, 1]
            dz = points_m[p, 2] - antennas_m[a, 2]
            length = np.sqrt(dx * dx + dy * dy + dz * dz) - at_centre[a]
            out[p, a], out[n_points + p, a] = cis_turns(turns_per_m[p] * length)
    return out


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
                    turns[i] += turns_per_m * passes[leg] * np.sqrt(dx * dx + dy * dy + dz * dz)
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


def probe_gains(points_m: np.ndarray, antennas_m: np.ndarray, pattern: float) -> np.ndarray:
    """Compute the gains between points [p, 3] and antennas [a, 3], from which few antennas are
    chosen that represent all: [p, a], each row with unit mean square.

    A gain is 1/R, times the pattern cosᵠθ, q = `pattern`, where that is smooth. For up to half of
    the points it is also multiplied by the obliquity √(n·û) of a facet; the normals n are spread
    over the directions that every antenna sees.
    """
    return _probe_gains(
        points_m, _normals(len(points_m)), antennas_m, float(pattern), least_cosine(pattern)
    )


def _normals(count: int) -> np.ndarray:
    """Return unit vectors [count, 3] spread evenly over the sphere; always the same ones for the
    same count."""
    plastic = 1.324717957244746  # g³ = g + 1: the ratio for two dimensions
    u = (0.5 + np.arange(count)[:, None] / plastic ** np.arange(1, 3)) % 1.0
    z, azimuth = 2 * u[:, 0] - 1, 2 * np.pi * u[:, 1]
    across = np.sqrt(1 - z**2)
    return np.stack([across * np.cos(azimuth), across * np.sin(azimuth), z], axis=1)


@njit(**FAST)
def _probe_gains(points_m, normals, antennas_m, pattern, least):  # type: ignore[no-untyped-def]
    n_points, n_antennas = len(points_m), len(antennas_m)
    gains, obliquity, axial = (
        np.empty((n_points, n_antennas)),
        np.empty(n_antennas),
        np.empty(n_antennas),
    )
    for p in range(n_points):
        nx, ny, nz = normals[p, 0], normals[p, 1], normals[p, 2]
        for a in range(n_antennas):
            dx, dy = antennas_m[a, 0] - points_m[p, 0], antennas_m[a, 1] - points_m[p, 1]
            dz = antennas_m[a, 2] - points_m[p, 2]
            nearness = 1 / np.sqrt(dx * dx + dy * dy + dz * dz)
            gains[p, a], axial[a] = nearness, -dz * nearness
            obliquity[a] = (nx * dx + ny * dy + nz * dz) * nearness
        oblique, patterned, power = True, pattern != 0.0, 0.0
        for a in range(n_antennas):
            oblique &= obliquity[a] >= GRAZING
            patterned &= axial[a] >= least
        for a in range(n_antennas):
            if oblique:
                gains[p, a] *= np.sqrt(obliquity[a])
            if patterned:
                gains[p, a] *= axial[a] ** pattern
            power += gains[p, a] ** 2
        for a in range(n_antennas):
            gains[p, a] /= np.sqrt(power / n_antennas)
    return gains
