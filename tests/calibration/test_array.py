"""An array's errors from the echoes of the calibration target, by every fourth antenna of the
paper's and 20 tones."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from handbench.calibration.array_estimate import estimate_array
from handbench.calibration.array_file import ArrayCalibration, load_array
from handbench.calibration.target import Target
from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray, AntennaPairs, qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.simulation.spheres import sphere_echo
from handbench.support.config import parse
from handbench.support.files import write_json
from tests.refusals import refuse

NOMINAL = AntennaArray(qar50().tx_m[::4], qar50().rx_m[::4])
TONES_HZ = np.linspace(72e9, 82e9, 20)
NOISE_RAD = 0.0281  # the paper's phase noise between two tones at the strongest pixel


class Imperfect:
    """An array whose antennas err by 1 dB, 30° and 0.2 mm of cable; transmitter 3 is dead."""

    def __init__(self, seed: int) -> None:
        self.random = np.random.default_rng(seed)
        normal = self.random.standard_normal
        self.gains = [
            10 ** (normal(n) / 20) * np.exp(1j * np.radians(30) * normal(n))
            for n in NOMINAL.channels
        ]
        self.gains[0][3] = 0.0
        self.delays_m = [2e-4 * normal(n) for n in NOMINAL.channels]
        k = 2 * np.pi * (TONES_HZ - TONES_HZ.mean()) / SPEED_OF_LIGHT_M_S
        a, b = (
            g * np.exp(-1j * np.multiply.outer(k, d))
            for g, d in zip(self.gains, self.delays_m, strict=True)
        )
        self.response = a[:, :, None] * b[:, None]

    def capture(self, echoes: np.ndarray, noise_rad: float = 0.0) -> RadarCapture:
        """Echoes [f, t, r] with the antennas' responses and noise (σ = σ_φ·√N·a, with the mean
        amplitude a of one of five balls)."""
        level = noise_rad * np.sqrt(echoes[0].size * np.mean(np.abs(echoes) ** 2) / 5)
        noise = self.random.standard_normal((*echoes.shape, 2)) @ [1, 1j] * level / np.sqrt(2)
        samples = (echoes * self.response + noise)[None].astype(np.complex64)
        return RadarCapture(samples, TONES_HZ, NOMINAL)

    def of_target(self, target: Target, centres_m: np.ndarray) -> RadarCapture:
        balls = zip(centres_m, target.element, target.foam_delay_m, strict=True)
        return self.capture(
            sum(sphere_echo(c, e.ball_radius_m, d, TONES_HZ, NOMINAL) for c, e, d in balls),
            NOISE_RAD,
        )


@pytest.fixture(scope="module")
def centres_m(target) -> np.ndarray:
    turn = Rotation.from_euler("xyz", [0.1, -0.15, 0.2]).as_matrix()
    return target.centres_m @ turn.T + [0.01, -0.01, 0.31]


@pytest.fixture(scope="module")
def noisy(target, centres_m) -> tuple[Imperfect, ArrayCalibration]:
    truth = Imperfect(1)
    return truth, estimate_array(truth.of_target(target, centres_m), target)


def test_responses_come_back_at_the_papers_noise(noisy, centres_m):
    """0.02 in amplitude and in phase; noise alone gives 0.010 (5 balls of 24 × 20 samples each).
    Phases are without what a shift of the whole image explains: the rest blurs. Delays are better
    than noise leaves them, 0.16 mm: 0.12 mm, to a tenth by chance."""
    truth, found = noisy
    errors = []
    for side, gain, delay_m, leg in zip(
        (found.tx, found.rx), truth.gains, truth.delays_m, NOMINAL.legs, strict=True
    ):
        live = gain != 0
        assert np.array_equal(side.gains != 0, live)
        shift = leg.directions(centres_m.mean(axis=0))[live]
        shift -= shift.mean(axis=0)
        ratio = side.gains[live] / gain[live]
        level, phase = np.log(np.abs(ratio)), np.angle(ratio / ratio.mean())
        phase -= shift @ np.linalg.lstsq(shift, phase)[0]
        miss_m = (np.array(side.delay_m) - delay_m)[live]
        errors.append([values - values.mean() for values in (level, phase, miss_m)])
    level, phase, miss_m = np.sqrt((np.concatenate(errors, axis=1) ** 2).mean(axis=1))
    assert level < 0.02 and phase < 0.02 and miss_m < 1.5e-4


@pytest.fixture(scope="module")
def exact() -> tuple[Imperfect, ArrayCalibration]:
    """An array and its errors as they are."""
    truth = Imperfect(2)
    sides = [
        {
            "nominal_m": leg.position_m.tolist(),
            "gain": np.stack([gain.real, gain.imag], axis=1).tolist(),
            "delay_m": delay_m.tolist(),
        }
        for leg, gain, delay_m in zip(NOMINAL.legs, truth.gains, truth.delays_m, strict=True)
    ]
    values = {"source": "a", "reference_hz": TONES_HZ.mean(), "tx": sides[0], "rx": sides[1]}
    return truth, parse(ArrayCalibration, values, "a")


def test_echoes_are_as_if_antennas_were_equal_without_the_dead_one(exact):
    """To single precision."""
    truth, found = exact
    echo = sphere_echo(np.array([-0.03, 0.04, 0.36]), 1e-3, 0.0, TONES_HZ, NOMINAL)
    calibrated, live = found.applied_to(truth.capture(echo)), np.delete(echo, 3, axis=1)
    np.testing.assert_allclose(calibrated.samples[0], live, atol=1e-6 * np.abs(echo).max())
    np.testing.assert_array_equal(calibrated.aperture.tx_m, np.delete(NOMINAL.tx_m, 3, axis=0))


def _without_ball_3(target, centres_m):
    seen = [0, 1, 3, 4]
    rest = target.model_copy(update={"element": tuple(target.element[i] for i in seen)})
    return Imperfect(5).of_target(rest, centres_m[seen]), target


def _other_description(target, centres_m):
    """A corner 1.5 mm from where the description has it still matches."""
    x, y, z = target.element[0].centre_m
    first = target.element[0].model_copy(update={"centre_m": (x + 0.0015, y, z)})
    wrong = target.model_copy(update={"element": (first, *target.element[1:])})
    return Imperfect(6).of_target(target, centres_m), wrong


def _sixth_ball(target, centres_m):
    """It is as strong as the others."""
    with_it = target.model_copy(update={"element": (*target.element, target.element[0])})
    places_m = np.vstack([centres_m, centres_m.mean(axis=0) + [0.01, -0.025, 0]])
    return Imperfect(7).of_target(with_it, places_m), target


@pytest.mark.parametrize(
    ("made", "place"),
    [
        (_without_ball_3, "missing: [3]"),
        (_other_description, "element 1 of"),
        (_sixth_ball, "something at"),
    ],
)
def test_captures_that_give_no_calibration_are_refused(target, centres_m, made, place):
    capture, described = made(target, centres_m)
    refuse(lambda: estimate_array(capture, described, source="TARGET"), "TARGET", place)


@pytest.mark.parametrize(
    ("aperture", "place"),
    [
        (AntennaArray(NOMINAL.tx_m + 1e-3, NOMINAL.rx_m), "tx"),
        (AntennaArray(NOMINAL.tx_m, NOMINAL.rx_m[:23]), "24 rx antennas"),
        (AntennaPairs(np.zeros((4, 3)), np.zeros((4, 3))), "array.json"),
    ],
)
def test_it_is_applied_to_its_own_array_only(exact, aperture, place):
    samples = np.ones((1, len(TONES_HZ), *aperture.channels), np.complex64)
    capture = RadarCapture(samples, TONES_HZ, aperture)
    refuse(lambda: exact[1].applied_to(capture, "array.json"), "array.json", place)


@pytest.mark.parametrize(
    ("find", "put", "place"),
    [
        ('"gain":[', '"gain":[[1,0],', "'gain' has 25"),
        ('"gain":[[', '"gain":[[NaN,0],[', "tx.gain"),
    ],
)
def test_a_wrong_file_is_refused_and_the_right_one_comes_back(tmp_path, exact, find, put, place):
    path = tmp_path / "array.json"
    write_json(path, exact[1].model_dump())
    assert load_array(path) == exact[1]
    content = "".join(path.read_text().split())
    assert find in content
    path.write_text(content.replace(find, put, 1))
    refuse(lambda: load_array(path), str(path), place)
