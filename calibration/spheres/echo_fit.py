"""Least-squares fit of the places and complex strengths of small objects to a capture's samples:

    s ≈ Σ_i (c_i·e_i + Σ_x c_ix·∂e_i/∂x) + Σ_m d_m·u_m

with the echo e_i of object i at its place, its three derivatives by the place, and further echoes
u_m. All coefficients are complex, so that a step is one linear solution: the place moves by
Re(c_ix/c_i) until the steps end. The imaginary part of c_ix/c_i is an amplitude that changes over
the array or the sweep, of which the place thus knows nothing.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray
from handbench.radar.imaging.exact import path_lengths
from handbench.radar.imaging.steering import phasor
from handbench.radar.simulation.physics.spheres import half_angle_cosine, path_gradients

MAX_STEPS = 12
SETTLED_M = 5e-6  # size of the last step; the remaining error is of second order, some nanometres


class EchoFit(NamedTuple):
    """Result of a fit to samples. places_m [n, 3], strengths [n] of the objects; spread_m2
    [n, 3, 3]: covariance of the places for noise of variance 2 per sample (1 per real and imaginary
    part); rest [f, t, r]: samples that the model does not explain."""

    places_m: np.ndarray
    strengths: np.ndarray
    spread_m2: np.ndarray
    rest: np.ndarray


def fit_places(
    samples: np.ndarray,
    columns_at: Callable[[np.ndarray], np.ndarray],
    places_m: np.ndarray,
    max_steps: int = MAX_STEPS,
) -> EchoFit:
    """Fit the places and strengths of n objects to samples [f, t, r] by Gauss–Newton steps from
    places_m [n, 3].

    columns_at: returns the model's columns [4n + m, f·t·r] for objects at places [n, 3]: each
    one's echo and its three derivatives, then m further echoes. Raises scipy's LinAlgError if the
    columns are not independent.
    """
    count = len(places_m)
    for _ in range(max_steps):
        columns = columns_at(places_m)
        conjugate = columns.conj()
        factor = cho_factor(conjugate @ columns.T)
        coefficients = cho_solve(factor, conjugate @ samples.ravel())
        of_places = coefficients[: 4 * count].reshape(count, 4)
        strengths = of_places[:, 0]
        step_m = (of_places[:, 1:] / strengths[:, None]).real
        places_m = places_m + step_m
        if np.abs(step_m).max() < SETTLED_M:
            break
    inverse = cho_solve(factor, np.eye(len(columns)))
    places = 4 * np.arange(count)[:, None] + [1, 2, 3]
    spread_m2 = inverse[places[:, :, None], places[:, None]].real
    return EchoFit(
        places_m,
        strengths,
        spread_m2 / np.abs(strengths)[:, None, None] ** 2,
        samples - (coefficients.astype(np.complex64) @ columns).reshape(samples.shape),
    )


def with_derivatives(
    echo: np.ndarray, point_m: np.ndarray, frequencies_hz: np.ndarray, array: AntennaArray
) -> np.ndarray:
    """Return an echo e scaled to unit norm, followed by its derivatives −jk·∂path/∂(x, y, z)·e by
    the position point_m of its source, without the change of a phase common to all samples, which
    the strength contains: [4, f·t·r]."""
    k = (2 * np.pi * frequencies_hz / SPEED_OF_LIGHT_M_S).astype(np.float32)
    gradient = path_gradients(point_m, array).astype(np.float32).reshape(-1, 3).T
    echo = echo.ravel() / np.linalg.norm(echo)
    phase = np.multiply.outer(k, gradient).swapaxes(0, 1).reshape(3, -1)
    phase -= (phase @ np.abs(echo) ** 2)[:, None]
    return np.concatenate([echo[None], -1j * phase * echo])


def specular_echo(
    centre_m: np.ndarray, radius_m: float, frequencies_hz: np.ndarray, array: AntennaArray
) -> np.ndarray:
    """Simulate the specular echo of a sphere of radius a, or of a point (a = 0): complex64
    [f, t, r]. It is exp(−jk(|t − c| + |c − r| − 2a·cos β))/(|t − c||c − r|) with the centre c and
    half the bistatic angle β; a²·sin²β/|c − t| of the path is neglected, about 1 µm here."""
    path_m = path_lengths(array, centre_m) - 2 * radius_m * half_angle_cosine(centre_m, array)
    spreading = np.multiply.outer(*(leg.lengths_m(centre_m) for leg in array.legs))
    phase = phasor(path_m, frequencies_hz[:, None, None], -1)
    return (phase / spreading).astype(np.complex64)
