"""Detection of the target's steel balls in the radar's echoes.

Maxima of the radar's image are explained one after another, each time in what the echoes found so
far leave over (orthogonal matching pursuit, Pati et al. 1993): the places and strengths of all
echoes are fitted to the samples together, so that side lobes are not mistaken for balls.
"""

from contextlib import suppress

import numpy as np
from scipy.linalg import LinAlgError
from scipy.ndimage import maximum_filter

from handbench.calibration.ball_fit import EchoFit, fit_places, mimo_array, with_derivatives
from handbench.calibration.target import Candidate, Target
from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.radar.data.capture import RadarCapture, scaled_to_one, thin_antennas
from handbench.radar.data.grid import Axis, VoxelGrid
from handbench.radar.imaging.api import image_volume
from handbench.radar.imaging.exact import exact_images
from handbench.radar.simulation.spheres import sphere_echo
from handbench.support.errors import HandbenchError

SIDE = Axis(start_m=-0.15, stop_m=0.15, step_m=0.003)
VOLUME = VoxelGrid(  # that is searched, radar frame
    SIDE.values_m(), SIDE.values_m(), Axis(start_m=0.2, stop_m=0.45, step_m=0.006).values_m()
)
THRESHOLD_DB = -26.0  # low: weak echoes of foam and stand pull at the balls unless explained
MAX_ECHOES = 16
ANTENNAS = 2  # every second one is used, which is enough for first places
PERIOD = 1.5  # least range period of the tones that are used, over the volume's depth
STEPS = 2  # of the fit after each new echo
FARTHEST_M = 0.01  # a maximum from which the fit moves farther is no echo


def find_balls(
    capture: RadarCapture, target: Target, threshold_db: float = THRESHOLD_DB
) -> list[Candidate]:
    """Find all echoes in a capture's first frame that may be the target's balls, the strongest
    first. Their centres are first guesses for `fit_balls`.

    An echo is listed once for each element, since the centre of the ball behind it depends on the
    element's size. threshold_db: the weakest echo that counts, relative to the strongest. Raises
    HandbenchError for a capture without a MIMO array, or with tones too sparse for the volume's
    depth.
    """
    array = mimo_array(capture)
    radius_m = float(np.median([element.ball_radius_m for element in target.element]))
    centres_m, strengths = _separate_echoes(_thinned(capture), radius_m, 10 ** (threshold_db / 20))
    middle_m = np.concatenate([array.tx_m, array.rx_m]).mean(axis=0)
    balls = []
    for i in np.argsort(-strengths):
        away = (centres_m[i] - middle_m) / np.linalg.norm(centres_m[i] - middle_m)
        peak_m = centres_m[i] - radius_m * away
        for element, delay_m in enumerate(target.foam_delay_m):
            centre_m = peak_m + (target.element[element].ball_radius_m - delay_m) * away
            balls.append(Candidate(centre_m, np.eye(3), (element,), peak_m))
    return balls


def _thinned(capture: RadarCapture) -> RadarCapture:
    """Return the capture with fewer antennas and tones, which still are unambiguous over the depth
    of the volume. Raises HandbenchError for tones that are too sparse."""
    spacing_hz = np.diff(np.sort(capture.frequencies_hz)).max(initial=0.0) or np.inf
    period_m, depth_m = SPEED_OF_LIGHT_M_S / (2 * spacing_hz), np.ptp(VOLUME.z_m)
    if period_m < depth_m:
        raise HandbenchError(
            f"capture: its {len(capture.frequencies_hz)} tones are ambiguous in range beyond "
            f"{1e3 * period_m:.0f} mm, but the search needs {1e3 * depth_m:.0f} mm; record the "
            "target with a smaller step between tones"
        )
    every = slice(None, None, max(1, int(period_m / (PERIOD * depth_m))))
    few = thin_antennas(capture, ANTENNAS)
    samples = scaled_to_one(few.samples[:1, every])
    return RadarCapture(samples, few.frequencies_hz[every], few.aperture)


def _separate_echoes(
    capture: RadarCapture, radius_m: float, threshold: float
) -> tuple[np.ndarray, np.ndarray]:
    """Decompose the samples of a capture into echoes of balls of radius_m: (centres [n, 3],
    strengths [n]). threshold: strength of the weakest echo relative to the strongest.

    Each new echo starts from the maximum of the image that is brightest in the samples that the
    others leave over.
    """
    samples, f_hz, array = capture.samples[0], capture.frequencies_hz, mimo_array(capture)
    image = np.abs(image_volume(samples, f_hz, array, VOLUME, tolerance=1e-2))
    maxima = (image == maximum_filter(image, 3)) & (image > threshold * image.max())
    seeds_m = VOLUME.points_m()[maxima]

    def columns_at(centres_m: np.ndarray) -> np.ndarray:
        return np.concatenate(
            [
                with_derivatives(sphere_echo(c, radius_m, 0.0, f_hz, array), c, f_hz, array)
                for c in centres_m
            ]
        )

    fit = EchoFit(np.zeros((0, 3)), np.zeros(0), np.zeros((0, 3, 3)), samples)
    least = 0.0
    while len(seeds_m) and len(fit.places_m) < MAX_ECHOES:
        seen = np.abs(exact_images(fit.rest, f_hz, array, seeds_m, False)[0])
        brightest = seen.argmax()
        least = least or threshold * seen[brightest]
        if seen[brightest] < least:
            break
        start_m = np.concatenate([fit.places_m, seeds_m[brightest : brightest + 1]])
        seeds_m = np.delete(seeds_m, brightest, axis=0)
        with suppress(LinAlgError):
            larger = fit_places(samples, columns_at, start_m, STEPS)
            if np.abs(larger.places_m - start_m).max() < FARTHEST_M:
                fit = larger
    return fit.places_m, np.abs(fit.strengths)
