"""All balls fitted to the echoes together; their echoes come from Mie's series, the foam's from a
formula here."""

from __future__ import annotations

import numpy as np
import pytest

from handbench.calibration.ball_fit import fit_balls
from handbench.calibration.target import Candidate, Target
from handbench.radar.data.arrays import AntennaArray
from handbench.radar.data.capture import RadarCapture
from handbench.radar.simulation.spheres import sphere_echo
from tests.calibration.test_balls import WHOLE, centres, noise
from tests.calibration.test_balls import sphere_echo as specular_echo
from tests.refusals import refuse

ARRAY = AntennaArray(WHOLE.tx_m[::8], WHOLE.rx_m[::8])
TONES_HZ = np.linspace(72e9, 82e9, 16)
FACE = 0.02  # of the foam's front against its ball, about −34 dB; the real one's


def echoes(target: Target, centres_m: np.ndarray, array: AntennaArray = ARRAY) -> np.ndarray:
    """Balls, and the fronts of their foam at FACE of the balls' norm."""
    samples = np.zeros((len(TONES_HZ), *array.channels), np.complex128)
    for element, delay_m, centre_m in zip(
        target.element, target.foam_delay_m, centres_m, strict=True
    ):
        ball = sphere_echo(centre_m, element.ball_radius_m, delay_m, TONES_HZ, array)
        face = specular_echo(centre_m, element.sphere_radius_m, 0.0, TONES_HZ, array)
        face /= TONES_HZ[:, None, None]
        samples += ball + FACE * np.linalg.norm(ball) / np.linalg.norm(face) * face
    return samples


def seeds(centres_m: np.ndarray, off_m: float = 3e-4) -> dict[int, Candidate]:
    """Balls as recognised in the image, off_m from their places along each axis."""
    return {i: Candidate(c + off_m, np.eye(3), (i,), c) for i, c in enumerate(centres_m)}


def captured(samples: np.ndarray, array: AntennaArray = ARRAY) -> RadarCapture:
    return RadarCapture(samples[None].astype(np.complex64), TONES_HZ, array)


@pytest.fixture(scope="module")
def placed(target):
    return centres(np.random.default_rng(8), target)


def test_without_noise_the_balls_come_back(target, placed):
    """To 3 µm (single precision), foam or not: the small
    sphere's front lies 12 mm before its ball, within the range resolution of 15 mm."""
    found = fit_balls(captured(echoes(target, placed)), target, seeds(placed))
    assert max(np.linalg.norm(found[i].centre_m - placed[i]) for i in found) < 3e-6


def test_the_covariance_is_honest(rng, target, placed):
    """Noise as strong as the echoes: the normalised squared errors of 5 balls × 8 trials average 3,
    the degrees of freedom, within four standard errors of √(6/40)."""
    samples, nees = echoes(target, placed), []
    for _ in range(8):
        noisy = samples + noise(rng, samples.shape, np.mean(np.abs(samples) ** 2))
        for i, ball in fit_balls(captured(noisy), target, seeds(placed, 1e-4)).items():
            miss = ball.centre_m - placed[i]
            nees.append(miss @ np.linalg.solve(ball.covariance_m2, miss))
    assert np.mean(nees) == pytest.approx(3, abs=4 * np.sqrt(6 / 40))


@pytest.mark.slow
def test_a_neighbour_that_is_no_ball_of_the_target_pulls_little(rng, target, placed):
    """Metal of 20 mm radius 70 mm beside the target, four times as strong: balls stay within four
    of the standard deviations given, which know of it, the nearest within 0.3 mm, the others within
    0.07 mm."""
    samples = echoes(target, placed, WHOLE)
    samples += noise(rng, samples.shape, np.mean(np.abs(samples) ** 2))
    beside_m = placed[0] - [0.07, 0.0, 0.0]
    clutter = sphere_echo(beside_m, 0.02, 0.0, TONES_HZ, WHOLE)
    peak = Candidate(beside_m, np.eye(3), (0,), beside_m * (1 - 0.02 / np.linalg.norm(beside_m)))
    calm = fit_balls(captured(samples, WHOLE), target, seeds(placed, 1e-4))
    found = fit_balls(captured(samples + clutter, WHOLE), target, seeds(placed, 1e-4), [peak])
    for i, ball in found.items():
        miss = ball.centre_m - placed[i]
        assert np.linalg.norm(miss) < (7e-5 if i else 3e-4)
        assert miss @ np.linalg.solve(ball.covariance_m2, miss) < 16
    assert np.trace(found[0].covariance_m2) > np.trace(calm[0].covariance_m2)


def test_a_ball_that_is_not_there_is_refused(rng, target, placed):
    samples = echoes(target, placed)
    wrong = placed.copy()
    wrong[2] += [0.0, 0.0, 0.02]
    refuse(lambda: fit_balls(captured(samples), target, seeds(wrong)), "ball 3")
