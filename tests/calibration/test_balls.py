"""Steel balls in the radar's echoes, which are made here by the formula itself, channel by
channel."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from handbench.calibration.radar_detection import find_balls
from handbench.calibration.target import Target
from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray, AntennaPairs, qar50
from handbench.radar.data.capture import RadarCapture
from tests.refusals import refuse

WHOLE = qar50()
TONES_HZ = np.linspace(72e9, 82e9, 64)


def sphere_echo(
    centre_m: np.ndarray,
    radius_m: float,
    delay_m: float,
    frequencies_hz: np.ndarray,
    array: AntennaArray = WHOLE,
) -> np.ndarray:
    """(a/2)/(|p−t||p−r|)·exp(−j2πf(|p−t| + |p−r| − 2a cos β + 2δ)/c), over the sphere's specular
    points: [f, t, r]."""
    to, back = centre_m - array.tx_m, centre_m - array.rx_m
    d_to, d_back = np.linalg.norm(to, axis=1)[:, None], np.linalg.norm(back, axis=1)[None, :]
    cos_beta = np.sqrt((1 + (to / d_to) @ (back / d_back.T).T) / 2)
    path_m = d_to + d_back - 2 * radius_m * cos_beta + 2 * delay_m
    waves = -2j * np.pi / SPEED_OF_LIGHT_M_S * frequencies_hz
    return radius_m / 2 / (d_to * d_back) * np.exp(np.multiply.outer(waves, path_m))


def noise(rng: np.random.Generator, shape: tuple[int, ...], power: float) -> np.ndarray:
    return np.sqrt(power / 2) * (rng.standard_normal(shape) + 1j * rng.standard_normal(shape))


def centres(rng: np.random.Generator, target: Target) -> np.ndarray:
    """The target in front of the array, tilted by up to 20° about each axis."""
    rotation = Rotation.from_rotvec(rng.uniform(-0.35, 0.35, 3)).as_matrix()
    return target.centres_m @ rotation.T + [*rng.uniform(-0.02, 0.02, 2), rng.uniform(0.28, 0.36)]


def capture(
    rng: np.random.Generator,
    target: Target,
    centres_m: np.ndarray,
    seen: tuple[int, ...],
    foam_db: float | None,
) -> RadarCapture:
    """Balls (and, at foam_db below the first ball, the near faces of the foam spheres) with noise
    as strong as they."""
    samples = np.zeros((len(TONES_HZ), *WHOLE.channels), np.complex128)
    for i in seen:
        element, delay_m = target.element[i], target.foam_delay_m[i]
        samples += sphere_echo(centres_m[i], element.ball_radius_m, delay_m, TONES_HZ)
        if foam_db is not None:
            face = 10 ** (foam_db / 20) * element.ball_radius_m / element.sphere_radius_m
            samples += face * sphere_echo(centres_m[i], element.sphere_radius_m, 0.0, TONES_HZ)
    samples += noise(rng, samples.shape, np.mean(np.abs(samples) ** 2))
    return RadarCapture(samples[None].astype(np.complex64), TONES_HZ, WHOLE)


@pytest.fixture(scope="module")
def placed(target):
    return centres(np.random.default_rng(5), target)


def test_all_balls_are_found_and_nothing_else(rng, target, placed):
    """0.3 mm: first guesses from a quarter of the antenna pairs and half of the tones."""
    found = find_balls(capture(rng, target, placed, (0, 1, 2, 3, 4), None), target)
    assert len(found) == 5 * 5  # each echo, once for every element
    for element, place_m in enumerate(placed):
        off_m = [np.linalg.norm(b.centre_m - place_m) for b in found if element in b.elements]
        assert np.sum(np.array(off_m) < 3e-4) == 1


def test_foam_faces_pull_little_and_a_hidden_ball_is_not_invented(rng, target, placed):
    """The small sphere's face lies 12.5 mm before its ball, within the range resolution of 15
    mm."""
    recorded = capture(rng, target, placed, (0, 2, 3, 4), -20.0)
    found = find_balls(recorded, target)
    for element, place_m in enumerate(placed):
        off_m = [np.linalg.norm(b.centre_m - place_m) for b in found if element in b.elements]
        assert min(off_m) > 0.02 if element == 1 else min(off_m) < 1e-3
    assert len(find_balls(recorded, target, threshold_db=-10.0)) == 5 * 4


@pytest.mark.parametrize(
    ("aperture", "tones", "place"),
    [
        (AntennaPairs(np.zeros((4, 3)), np.zeros((4, 3))), 128, "planar scan"),
        (AntennaArray(WHOLE.tx_m[:2], WHOLE.rx_m[:2], np.eye(2, dtype=bool)), 128, "pairs"),
        (AntennaArray(WHOLE.tx_m[:2], WHOLE.rx_m[:2]), 3, "3 tones"),
    ],
)
def test_captures_that_cannot_tell_where_a_ball_is_are_refused(target, aperture, tones, place):
    silent = np.zeros((1, tones, *aperture.channels), np.complex64)
    capture = RadarCapture(silent, np.linspace(72e9, 82e9, tones), aperture)
    refuse(lambda: find_balls(capture, target), "capture", place)
