"""Maximum-likelihood positions of the target's steel balls, by a joint fit to the radar's samples.

The echo of an identified ball is known except for its position and strength: Mie's series with the
foam's delay, plus the echo of the foam's front, which is too close to the ball for the range
resolution to separate them. Places and complex strengths of all objects are fitted together, so
that neighbours and foam do not bias a ball's position:

    s ≈ Σ_i (c_i·e_i + Σ_x c_ix·∂e_i/∂x) + Σ_m d_m·u_m

with the echo e_i of object i at its place, its three derivatives by the place, and further echoes
u_m. All coefficients are complex, so that a step is one linear solution: the place moves by
Re(c_ix/c_i) until the steps end. The imaginary part of c_ix/c_i is an amplitude that changes over
the array or the sweep, of which the place thus knows nothing.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import combinations, product
from typing import NamedTuple

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from handbench.calibration.target import Candidate, Target
from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray
from handbench.radar.data.capture import RadarCapture
from handbench.radar.imaging.exact import exact_images, path_lengths
from handbench.radar.imaging.steering import phasor
from handbench.radar.simulation.spheres import half_angle_cosine, path_gradients, sphere_echo
from handbench.support.errors import HandbenchError

FARTHEST_M = 0.003  # largest distance of the fit from the first guess
# places beyond a ball's own peak
AROUND_M = 0.015 * np.array([p for p in product((-1, 0, 1), repeat=3) if any(p)])
OUTSIDE = 1.5  # radii of a foam sphere beyond which an echo is not the element's own
MAX_STEPS = 12
SETTLED_M = 5e-6  # size of the last step; the remaining error is of second order, some nanometres


def fit_balls(
    capture: RadarCapture,
    target: Target,
    balls: Mapping[int, Candidate],
    others: Sequence[Candidate] = (),
) -> dict[int, Candidate]:
    """Fit the centres of the target's balls to the echoes: the balls with new centres and
    covariances, by element index.

    balls: detected balls, by element index. others: further echoes; those outside all elements'
    foam are included in the fit, near fixed positions. The noise in the covariances is white noise
    as strong as the residual or, if that is stronger, the image of the residual around a ball
    (echoes of other objects there). Raises HandbenchError for balls that would overlap, for balls
    without echoes, and if the fit moves a ball too far from its peak.
    """
    # two balls at one place have one echo, and a fit of two to it fails
    for i, j in combinations(sorted(balls), 2):
        apart_m = np.linalg.norm(balls[i].centre_m - balls[j].centre_m)
        least_m = target.element[i].ball_radius_m + target.element[j].ball_radius_m
        if not apart_m >= least_m:
            raise HandbenchError(
                f"echoes: balls {i + 1} and {j + 1} would overlap, since their centres are "
                f"{1e3 * apart_m:.3g} mm apart; expected at least the sum of their radii, "
                f"{1e3 * least_m:.3g} mm; check the description of the target, and remove other "
                "objects from the view"
            )
    array, f_hz = mimo_array(capture), capture.frequencies_hz
    elements = list(balls)
    start_m = np.array([balls[i].centre_m for i in elements])
    radii_m = np.array([target.element[i].sphere_radius_m for i in elements])
    strangers = [
        with_derivatives(specular_echo(peak_m, 0.0, f_hz, array), peak_m, f_hz, array)
        for peak_m in np.unique([other.peak_m for other in others], axis=0).reshape(-1, 3)
        if (np.linalg.norm(peak_m - start_m, axis=1) > OUTSIDE * radii_m).all()
    ]

    def columns_at(centres_m: np.ndarray) -> np.ndarray:
        """Balls with derivatives, then the foam's fronts and the strangers."""
        of_balls, fronts = [], []
        for i, centre_m in zip(elements, centres_m, strict=True):
            element, delay_m = target.element[i], target.foam_delay_m[i]
            echo = sphere_echo(centre_m, element.ball_radius_m, delay_m, f_hz, array)
            of_balls.append(with_derivatives(echo, centre_m, f_hz, array))
            front = specular_echo(centre_m, element.sphere_radius_m, f_hz, array)
            front /= f_hz[:, None, None].astype(np.float32)  # a dielectric's face: amplitude ∝ 1/f
            fronts.append((front / np.linalg.norm(front)).reshape(1, -1))
        return np.concatenate([*of_balls, *fronts, *strangers])

    try:
        fit = fit_places(capture.samples[0], columns_at, start_m)
    except LinAlgError as error:
        raise HandbenchError(
            f"echoes: the echoes of balls {', '.join(str(i + 1) for i in balls)} are missing or "
            "cannot be distinguished; check that all balls are in view, or record the target again"
        ) from error
    fitted, white = {}, np.mean(np.abs(fit.rest) ** 2)
    for i, centre_m, spread_m2 in zip(elements, fit.places_m, fit.spread_m2, strict=True):
        moved_m = np.linalg.norm(centre_m - balls[i].centre_m)
        if not moved_m < FARTHEST_M:
            raise HandbenchError(
                f"echoes: the fit moves ball {i + 1} by {1e3 * moved_m:.1f} mm from its peak; "
                f"expected less than {1e3 * FARTHEST_M:.0f} mm; check the radii and the foam in "
                "the description of the target, and remove other objects from the view"
            )
        # power per sample of white noise whose image around the ball is as bright as the residual's
        image = exact_images(fit.rest, f_hz, array, centre_m + AROUND_M, False)[0]
        noise = max(white, float(np.mean(np.abs(image) ** 2)) / fit.rest.size)
        fitted[i] = replace(balls[i], centre_m=centre_m, covariance_m2=spread_m2 * noise / 2)
    return fitted


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


def mimo_array(capture: RadarCapture) -> AntennaArray:
    """Return the capture's MIMO array. Raises HandbenchError for a planar scan, for missing pairs
    of transmitter and receiver, and for a capture in another medium than air."""
    array = capture.aperture
    if not isinstance(array, AntennaArray):
        raise HandbenchError(
            "capture: is a planar scan, which cannot be calibrated with a target; use echoes of a "
            "MIMO array"
        )
    if array.measured is not None:
        raise HandbenchError(
            "capture: some pairs of a transmitter and a receiver were not measured; record the "
            "calibration target with all pairs"
        )
    if capture.wave_speed_m_s != SPEED_OF_LIGHT_M_S:
        raise HandbenchError(
            f"capture: wave_speed_m_s is {capture.wave_speed_m_s:g} m/s, which is not that of air; "
            "record the calibration target in air"
        )
    return array


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
