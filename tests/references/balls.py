"""Ball arithmetic as oracle: each number is a middle and a radius that it is proven to lie within
(Arb, 128 bits).

Arrays of objects carry the balls, so that +, −, ·, /, sum and np.sqrt are those of numbers. Floats
become balls without a rounding; `off` is where a case compares.
"""

from typing import Any

import numpy as np
from flint import acb, acb_mat, arb, ctx
from numpy.typing import NDArray

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray

ctx.prec = 128
LIGHT_M_S = int(SPEED_OF_LIGHT_M_S)
PI = arb.pi()
U, U_SINGLE = (float(np.finfo(kind).eps) / 2 for kind in (np.float64, np.float32))  # roundings
Balls = NDArray[np.object_]


def balls(values: Any) -> Balls:
    """Numbers as balls of radius 0, in their shape."""

    def ball(value: Any) -> Any:
        return acb(complex(value)) if np.iscomplexobj(values) else arb(float(value))

    return np.asarray(np.frompyfunc(ball, 1, 1)(np.asarray(values)), dtype=object)


def off(found: Any, exact: Any) -> np.ndarray:
    """The most that numbers can differ from balls: float64 in their shape; infinite where a ball is
    nowhere."""

    def most(difference: arb | acb) -> float:
        return (
            float(np.nextafter(float(difference.abs_upper()), np.inf))
            if difference.is_finite()
            else np.inf
        )

    return np.asarray(np.frompyfunc(most, 1, 1)(balls(found) - exact), np.float64)


def middles(exact: Any) -> np.ndarray:
    """Balls rounded to float64 or complex128, to tell sizes by."""
    kind = complex if any(isinstance(ball, acb) for ball in np.ravel(exact)) else float
    return np.frompyfunc(kind, 1, 1)(exact).astype(kind)


def legs_m(antennas: AntennaArray, points_m: np.ndarray) -> tuple[Balls, Balls]:
    """Distances of points to transmitters [p, t] and receivers [p, r]."""
    points = balls(points_m)[:, None]
    to, back = (
        np.sqrt(((points - balls(leg)) ** 2).sum(axis=2)) for leg in (antennas.tx_m, antennas.rx_m)
    )
    return to, back


def wave(legs: Balls, tone_hz: float) -> Balls:
    """e^{+j2πfR/c} of distances."""
    per_metre = 2 * arb(float(tone_hz)) / LIGHT_M_S
    return np.asarray(
        np.frompyfunc(lambda leg: acb(leg * per_metre).exp_pi_i(), 1, 1)(legs), dtype=object
    )


def product(a: Balls, b: Balls) -> Balls:
    """Matrix product."""
    return np.array((acb_mat(a.tolist()) * acb_mat(b.tolist())).tolist(), dtype=object)


def images(
    samples: np.ndarray, antennas: AntennaArray, tones_hz: np.ndarray, points_m: np.ndarray
) -> Balls:
    """Σ S e^{+j2πf(|p−t|+|p−r|)/c} of samples [draw, f, t, r] at points [p, 3]: [draw, p]."""
    to, back = legs_m(antennas, points_m)
    total = np.full((len(samples), len(points_m)), acb(0), dtype=object)
    for tone_hz, of_tone in zip(tones_hz, np.moveaxis(samples, 1, 0), strict=True):
        along, home = wave(to, tone_hz), wave(back, tone_hz).T
        total = total + [
            (along * product(balls(s.astype(complex)), home).T).sum(axis=1) for s in of_tone
        ]
    return total


def echoes(
    weights: np.ndarray, antennas: AntennaArray, tones_hz: np.ndarray, points_m: np.ndarray
) -> Balls:
    """Samples [f, t, r] of points that scatter evenly, each leg fading as 1/R."""
    to, back = legs_m(antennas, points_m)
    weight = balls(weights)[:, None]
    return np.array(
        [product((weight * wave(-to, f) / to).T, wave(-back, f) / back) for f in tones_hz],
        dtype=object,
    )


def rotation(source_m: np.ndarray, target_m: np.ndarray) -> Balls:
    """Rotation [3, 3] of least squares from points to points [n, 3] (Horn 1987): the quaternion
    that is the eigenvector of the greatest eigenvalue."""
    source, target = (points - points.mean(axis=0) for points in (balls(source_m), balls(target_m)))
    s = source.T @ target
    skew = [s[1, 2] - s[2, 1], s[2, 0] - s[0, 2], s[0, 1] - s[1, 0]]
    matrix = np.full((4, 4), s[0, 0] + s[1, 1] + s[2, 2], dtype=object)
    matrix[0, 1:] = matrix[1:, 0] = skew
    matrix[1:, 1:] = s + s.T - np.diag([matrix[0, 0]] * 3)
    values, vectors = acb_mat(matrix.tolist()).eig(right=True)
    best = max(range(4), key=lambda i: float(values[i].real))
    a, *v = (vectors[i, best].real for i in range(4))
    cross = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]], dtype=object)
    length2 = a * a + sum(x * x for x in v)
    eye = np.diag([arb(1)] * 3)
    return np.asarray(eye + (cross * (2 * a) + (cross @ cross) * 2) / length2, dtype=object)


def deviation(values: np.ndarray, lost: int = 0) -> Any:
    """Standard deviation over the first axis, of n − lost degrees of freedom."""
    exact = balls(values)
    return np.sqrt(((exact - exact.mean(axis=0)) ** 2).sum(axis=0) / (len(exact) - lost))


def two_sided(t: arb, freedom: int) -> arb:
    """p of Student's t: the regularised incomplete beta function of ν/(ν + t²)."""
    return (freedom / (freedom + t * t)).beta_lower(arb(freedom) / 2, arb(0.5), regularized=True)
