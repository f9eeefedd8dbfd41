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
from scipy.linalg import LinAlgError

from handbench.calibration.spheres.description import Candidate, Target
from handbench.calibration.spheres.echo_fit import fit_places, specular_echo, with_derivatives
from handbench.calibration.spheres.radar_detection import mimo_array
from handbench.radar.data.capture import RadarCapture
from handbench.radar.imaging.exact import exact_images
from handbench.radar.simulation.physics.spheres import sphere_echo
from handbench.support.errors import HandbenchError

FARTHEST_M = 0.003  # largest distance of the fit from the first guess
# places beyond a ball's own peak
AROUND_M = 0.015 * np.array([p for p in product((-1, 0, 1), repeat=3) if any(p)])
OUTSIDE = 1.5  # radii of a foam sphere beyond which an echo is not the element's own


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
