"""Maximum-likelihood positions of the target's steel balls, by a joint fit to the radar's samples.

The echo of an identified ball is known except for its position and strength: Mie's series with the
foam's delay, plus the echo of the foam's front, which is too close to the ball for the range
resolution to separate them. Positions and complex strengths of all balls are fitted to the samples
together by least squares (Gauss–Newton, maximum likelihood in white noise), so that neighbours and
foam do not bias a ball's position.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations, product

import numpy as np
from scipy.linalg import LinAlgError, block_diag, cho_factor, cho_solve

from handbench.calibration.spheres.description import Element, Target
from handbench.calibration.spheres.radar_detection import DetectedBall, mimo_array, specular_echo
from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray
from handbench.radar.data.capture import RadarCapture
from handbench.radar.imaging.cpu.exact import exact_images
from handbench.radar.simulation.physics.spheres import path_gradients, sphere_echo
from handbench.support.errors import HandbenchError

MAX_STEPS = 8
SETTLED_M = 5e-6  # size of the last step; the remaining error is of second order, some nanometres
FARTHEST_M = 0.003  # largest distance of the fit from the peak
# beyond a ball's own peak
AROUND_M = 0.015 * np.array([p for p in product((-1, 0, 1), repeat=3) if any(p)])
COLUMNS = 5  # of an element: ball, its three derivatives, foam's front
# Real unknowns [7] in complex columns [5]: strength (re, im), place (3), front (re, im).
REAL = block_diag([1, 1j], np.eye(3), [1, 1j])


def fit_balls(
    capture: RadarCapture,
    target: Target,
    balls: Mapping[int, DetectedBall],
    others: Sequence[DetectedBall] = (),
) -> dict[int, DetectedBall]:
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
        apart_m = float(np.linalg.norm(balls[i].centre_m - balls[j].centre_m))
        least_m = target.element[i].ball_radius_m + target.element[j].ball_radius_m
        if not apart_m >= least_m:
            raise HandbenchError(
                f"echoes: balls {i + 1} and {j + 1} would overlap, since their centres are "
                f"{1e3 * apart_m:.3g} mm apart; expected at least the sum of their radii, "
                f"{1e3 * least_m:.3g} mm; check the description of the target, and remove other "
                "objects from the view"
            )
    try:
        centres_m, inverse, rest = _settle(
            capture, target, {i: ball.centre_m for i, ball in balls.items()}, others
        )
    except LinAlgError as error:
        raise HandbenchError(
            f"echoes: the echoes of balls {', '.join(str(i + 1) for i in balls)} are missing or "
            "cannot be distinguished; check that all balls are in view, or record the target again"
        ) from error
    fitted, white = {}, float(np.mean(np.abs(rest) ** 2))
    for n, (i, centre_m) in enumerate(centres_m.items()):
        moved_m = float(np.linalg.norm(centre_m - balls[i].centre_m))
        if not moved_m < FARTHEST_M:
            raise HandbenchError(
                f"echoes: the fit moves ball {i + 1} by {1e3 * moved_m:.1f} mm from its peak; "
                f"expected less than {1e3 * FARTHEST_M:.0f} mm; check the radii and the foam in "
                "the description of the target, and remove other objects from the view"
            )
        place = slice(7 * n + 2, 7 * n + 5)
        # Power per sample of white noise whose image around the ball is as bright as the
        # residual's.
        image = exact_images(
            rest, capture.frequencies_hz, mimo_array(capture), centre_m + AROUND_M, False
        )[0]
        noise = max(white, float(np.mean(np.abs(image) ** 2)) / rest.size)
        covariance_m2 = inverse[place, place] * noise / 2
        fitted[i] = replace(balls[i], centre_m=centre_m, covariance_m2=covariance_m2)
    return fitted


def _settle(
    capture: RadarCapture,
    target: Target,
    centres_m: Mapping[int, np.ndarray],
    others: Sequence[DetectedBall],
) -> tuple[dict[int, np.ndarray], np.ndarray, np.ndarray]:
    """Fit the centres and strengths of all balls by Gauss–Newton steps from nearby centres_m:
    (centres by element index, inverse normal matrix of all real unknowns, residual samples [f, t,
    r]). The first unknowns are seven for each ball."""
    samples = capture.samples[0].reshape(-1)
    elements, places_m = list(centres_m), np.array(list(centres_m.values()))
    strangers = _strangers(capture, target, centres_m, others)
    strengths = None
    for _ in range(MAX_STEPS):
        columns = np.concatenate(
            [
                *(_columns(target, i, c, capture) for i, c in zip(elements, places_m, strict=True)),
                strangers,
            ]
        )
        conjugate = columns.conj()
        gram, onto = conjugate @ columns.T, conjugate @ samples
        if strengths is None:  # first of all, with every ball in its place
            strengths = _strengths(gram, onto, len(elements))
        real = _real(strengths, len(strangers))
        factor = cho_factor((real.conj().T @ gram @ real).real)
        unknowns = cho_solve(factor, (real.conj().T @ onto).real)
        of_elements = unknowns[: 7 * len(elements)].reshape(-1, 7)
        strengths = of_elements[:, :2] @ [1, 1j]
        places_m = places_m + of_elements[:, 2:5]
        if np.abs(of_elements[:, 2:5]).max() < SETTLED_M:
            break
    rest = samples - (real @ unknowns).astype(np.complex64) @ columns
    inverse = cho_solve(factor, np.eye(len(unknowns)))
    return (
        dict(zip(elements, places_m, strict=True)),
        inverse,
        rest.reshape(capture.samples[0].shape),
    )


def _columns(
    target: Target, number: int, centre_m: np.ndarray, capture: RadarCapture
) -> np.ndarray:
    """Compute the model of element `number` as five columns [5, f·t·r]: the echo of its ball at
    centre_m, the derivatives with respect to the three coordinates, and the echo of the foam's
    front."""
    element, delay_m = target.element[number], target.foam_delay_m[number]
    frequencies_hz, array = capture.frequencies_hz, mimo_array(capture)
    ball = sphere_echo(centre_m, element.ball_radius_m, delay_m, frequencies_hz, array)
    front = _front(element, centre_m, frequencies_hz, array)
    return np.concatenate(
        [_with_slopes(ball, centre_m, frequencies_hz, array), front[None]]
    ).reshape(COLUMNS, -1)


def _with_slopes(
    echo: np.ndarray, point_m: np.ndarray, frequencies_hz: np.ndarray, array: AntennaArray
) -> np.ndarray:
    """Return an echo scaled to unit norm, followed by its derivatives −jk·∂path/∂(x, y, z) with
    respect to the position point_m of its source: [4, f, t, r]."""
    echo = echo / np.linalg.norm(echo)
    k = (2 * np.pi * frequencies_hz / SPEED_OF_LIGHT_M_S).astype(np.float32)
    gradient = path_gradients(point_m, array).astype(np.float32)
    return np.stack(
        [echo, *(-1j * np.multiply.outer(k, gradient[..., axis]) * echo for axis in range(3))]
    )


def _front(
    element: Element, centre_m: np.ndarray, frequencies_hz: np.ndarray, array: AntennaArray
) -> np.ndarray:
    """Simulate the echo of the front of an element's foam sphere, scaled to unit norm: [f, t, r].
    It is a specular reflection with an amplitude ∝ 1/f."""
    echo = specular_echo(centre_m, element.sphere_radius_m, frequencies_hz, array)
    echo /= (frequencies_hz / frequencies_hz[0])[:, None, None].astype(np.float32)
    return echo / np.linalg.norm(echo)


def _strangers(
    capture: RadarCapture,
    target: Target,
    centres_m: Mapping[int, np.ndarray],
    others: Sequence[DetectedBall],
) -> np.ndarray:
    """Compute the model of other objects' echoes as columns [4·n, f·t·r]: for each of n peaks
    outside all elements' foam, the echo of a point and its derivatives by position. Each column
    gets its own complex strength in the fit, which then also suits objects larger than a point."""
    array, frequencies_hz = mimo_array(capture), capture.frequencies_hz
    peaks_m = {tuple(ball.peak_m) for ball in others}
    foreign = [
        np.array(peak_m)
        for peak_m in sorted(peaks_m)
        if all(
            np.linalg.norm(peak_m - c) > 1.5 * target.element[i].sphere_radius_m
            for i, c in centres_m.items()
        )
    ]
    columns = [np.zeros((0, capture.samples[0].size), np.complex64)]
    for peak_m in foreign:
        echo = specular_echo(peak_m, 0.0, frequencies_hz, array)
        columns.append(_with_slopes(echo, peak_m, frequencies_hz, array).reshape(4, -1))
    return np.concatenate(columns)


def _strengths(gram: np.ndarray, onto: np.ndarray, elements: int) -> np.ndarray:
    """Fit the complex strength of each ball at fixed positions, together with the strengths of foam
    fronts and other objects: [elements].

    gram [c, c], onto [c]: inner products of the c model columns with each other and with the
    samples; elements: number of balls.
    """
    fixed = np.concatenate(
        [
            *([COLUMNS * n, COLUMNS * n + 4] for n in range(elements)),
            np.arange(COLUMNS * elements, len(gram)),
        ]
    ).astype(int)
    return np.linalg.solve(gram[np.ix_(fixed, fixed)], onto[fixed])[: 2 * elements : 2]


def _real(strengths: np.ndarray, strangers: int) -> np.ndarray:
    """Return the matrix [c, u] that converts real unknowns [u] to complex coefficients of the c
    model columns. strengths: complex strengths of the balls, which multiply the derivatives by
    position; strangers: number of columns of other objects."""
    of_elements = [np.array([1, s, s, s, 1])[:, None] * REAL for s in strengths]
    return np.asarray(block_diag(*of_elements, *[[1, 1j]] * strangers))
