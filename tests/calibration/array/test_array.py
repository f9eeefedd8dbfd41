"""An array's errors from the echoes of the calibration target, by every second antenna of the
paper's and 32 tones."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from handbench.calibration.array.array_file import ArrayCalibration, load_array, save_array
from handbench.calibration.array.estimate import estimate_array, fit_state
from handbench.calibration.array.model import Antennas, State, TargetEchoes
from handbench.calibration.array.prior import DELAY_SIGMA_M, POSITION_SIGMA_M, gauges
from handbench.calibration.spheres.description import Target
from handbench.radar.data.arrays import AntennaArray, PlanarScan, qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.simulation.physics.spheres import sphere_echo
from handbench.support.errors import HandbenchError
from tests.radar.exact import backproject

C = 299_792_458.0
NOMINAL = AntennaArray(qar50().tx_m[::2], qar50().rx_m[::2])
TONES_HZ = np.linspace(72e9, 82e9, 32)
PAPER_RAD, QUIET_RAD = 0.0281, 0.001  # phase noise between two tones at the strongest pixel


class Imperfect:
    """An array whose antennas err by 1 dB, 30° and 50 µm per axis (times `size`); transmitter 3 is
    dead."""

    def __init__(self, seed: int, size: float = 1.0, dead: bool = True) -> None:
        self.random = np.random.default_rng(seed)
        normal = self.random.standard_normal
        self.gains = [
            10 ** (size * normal(n) / 20) * np.exp(1j * np.radians(30) * size * normal(n))
            for n in NOMINAL.channels
        ]
        self.gains[0][3] *= 0.0 if dead else 1.0
        self.offsets_m = [5e-5 * size * normal((n, 3)) for n in NOMINAL.channels]
        self.array = AntennaArray(
            NOMINAL.tx_m + self.offsets_m[0], NOMINAL.rx_m + self.offsets_m[1]
        )

    def capture(
        self, echoes: np.ndarray, phase_noise_rad: float, tones_hz: np.ndarray = TONES_HZ
    ) -> RadarCapture:
        """Echoes [f, t, r] at the true places, with gains and noise (σ = σ_φ·√N·a: see
        radar.simulation.effects; a is the mean amplitude of five balls' echo over √5, which is that
        of one)."""
        level = (
            phase_noise_rad * np.sqrt(echoes[0].size) * np.sqrt(np.mean(np.abs(echoes) ** 2) / 5)
        )
        noise = self.random.standard_normal((*echoes.shape, 2)) @ [1, 1j] * level / np.sqrt(2)
        samples = echoes * np.multiply.outer(*self.gains) + noise
        return RadarCapture(samples[None].astype(np.complex64), tones_hz, NOMINAL)

    def of_target(
        self, target: Target, centres_m: np.ndarray, phase_noise_rad: float
    ) -> RadarCapture:
        balls = zip(centres_m, target.element, target.foam_delay_m, strict=True)
        echoes = [
            sphere_echo(centre_m, e.ball_radius_m, d, TONES_HZ, self.array)
            for centre_m, e, d in balls
        ]
        return self.capture(sum(echoes), phase_noise_rad)


@pytest.fixture(scope="module")
def centres_m(target) -> np.ndarray:
    return target.centres_m @ Rotation.from_euler("xyz", [0.1, -0.15, 0.2]).as_matrix().T + [
        0.01,
        -0.01,
        0.31,
    ]


@pytest.fixture(scope="module")
def noisy(target, centres_m) -> tuple[Imperfect, ArrayCalibration]:
    truth = Imperfect(1)
    return truth, estimate_array(truth.of_target(target, centres_m, PAPER_RAD), target)


def rms(values: np.ndarray) -> float:
    return np.sqrt(np.mean(np.square(values), axis=0))


def test_gains_come_back_at_the_papers_noise_as_far_as_they_promise(noisy, centres_m):
    """0.02 in amplitude and in phase; noise alone gives 0.011 (5 balls of 47 × 32 samples each).
    Of the phases without what an offset towards the target does, and without what a shift of the
    whole image explains: the rest blurs. Normalised levels of 93 antennas average 1: ± 0.25 is
    three standard errors of independent ones."""
    truth, found = noisy
    k = 2 * np.pi * found.reference_hz / C
    normalised = []
    for side, gain, off_m, leg in zip(
        (found.tx, found.rx), truth.gains, truth.offsets_m, NOMINAL.legs, strict=True
    ):
        live = gain != 0
        away = (leg.position_m - centres_m.mean(axis=0))[live]
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        toward_m = ((np.array(side.offset_m) - off_m)[live] * away).sum(axis=1)
        seen = side.gains[live] / gain[live] * np.exp(-1j * k * toward_m)
        level = np.log(np.abs(seen)) - np.log(np.abs(seen)).mean()
        phase, shift = np.angle(seen / seen.mean()), away - away.mean(axis=0)
        assert rms(level) < 0.02
        assert rms(phase - shift @ np.linalg.lstsq(shift, phase)[0]) < 0.02
        normalised.extend(level / np.array(side.level_sigma)[live])
    assert rms(normalised) == pytest.approx(1, abs=0.25)
    assert found.residual_after_db < found.residual_before_db - 10


def test_an_antennas_phase_towards_the_target_is_known_better_than_its_place(noisy):
    """Place along the line of sight and phase do the same to an echo, and only their sum shows:
    0.043 rad are left of it (measured), against 0.076 rad that the place alone leaves open."""
    found = noisy[1]
    k = 2 * np.pi * found.reference_hz / C
    for side in (found.tx, found.rx):
        along = np.array(side.offset_sigma_m)[:, 2]
        assert np.median(side.phase_sigma_rad) < 0.8 * k * np.median(along)


def test_a_dead_antenna_is_named_and_gives_nothing(noisy):
    truth, found = noisy
    assert found.tx.gains[3] == 0
    assert (np.delete(found.tx.gains, 3) != 0).all()
    assert (found.rx.gains != 0).all()
    assert found.tx.offset_m[3] == (0, 0, 0)
    ones = truth.capture(np.ones((32, *NOMINAL.channels)), QUIET_RAD)
    corrected = found.applied_to(ones).samples[0]
    assert (corrected[:, 3] == 0).all()
    assert (np.delete(corrected, 3, axis=1) != 0).all()


def test_another_capture_becomes_sharp(noisy):
    """A point elsewhere: 30° leave e^{-σ²}, three quarters, of the amplitude that its echoes could
    have together; the calibrated image has all of it but 2 %."""
    truth, found = noisy
    point_m = np.array([[-0.03, 0.04, 0.36]])
    raw = truth.capture(sphere_echo(point_m[0], 1e-3, 0.0, TONES_HZ, truth.array), 0.0)
    perfect = np.abs(truth.gains[0] != 0)[:, None] * sphere_echo(
        point_m[0], 1e-3, 0.0, TONES_HZ, NOMINAL
    )
    around = np.stack(np.meshgrid(*[np.arange(-2, 3)] * 3), axis=-1).reshape(-1, 3)
    near_m = point_m - [0, 0, 1e-3] + 2e-4 * around

    def coherent(samples: np.ndarray, array: AntennaArray) -> float:
        peak = np.abs(backproject(samples, TONES_HZ, array, near_m)).max()
        return float(peak / np.abs(samples).sum())

    ideal, calibrated = coherent(perfect, NOMINAL), found.applied_to(raw)
    assert coherent(raw.samples[0], NOMINAL) < 0.85 * ideal
    after = coherent(calibrated.samples[0], calibrated.aperture)
    assert after == pytest.approx(ideal, rel=0.02)


def _without_ball_3(target, centres_m):
    seen = [0, 1, 3, 4]
    rest = target.model_copy(update={"element": tuple(target.element[i] for i in seen)})
    return Imperfect(5).of_target(rest, centres_m[seen], PAPER_RAD), target


def _other_description(target, centres_m):
    """A corner 1.5 mm from where the description has it still matches, yet its phases tell."""
    x, y, z = target.element[0].centre_m
    first = target.element[0].model_copy(update={"centre_m": (x + 0.0015, y, z)})
    wrong = target.model_copy(update={"element": (first, *target.element[1:])})
    return Imperfect(6).of_target(target, centres_m, PAPER_RAD), wrong


def _sixth_ball(target, centres_m):
    """As strong as the others, it holds a sixth of the energy."""
    plain = target.model_copy(update={"foam_permittivity": 1.0})
    with_it = plain.model_copy(update={"element": (*plain.element, plain.element[0])})
    places_m = np.vstack([centres_m, centres_m.mean(axis=0) + [0.01, -0.025, 0]])
    return Imperfect(7).of_target(with_it, places_m, PAPER_RAD), plain


def _far_antennas(target, centres_m):
    truth = Imperfect(9, dead=False)
    sides = zip((NOMINAL.tx_m, NOMINAL.rx_m), truth.offsets_m, strict=True)
    truth.array = AntennaArray(*(nominal_m + 6 * off_m for nominal_m, off_m in sides))
    return truth.of_target(target, centres_m, QUIET_RAD), target


SCAN = RadarCapture(np.ones((1, 32, 4), np.complex64), TONES_HZ, PlanarScan(np.zeros((4, 3))))


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (_without_ball_3, "elements 3 of the target are not visible"),
        (
            _other_description,
            r"TARGET: element 1 of the target is 0\.\d+ mm away from its place in the",
        ),
        (_sixth_ball, r"the target explains only 8\d\.\d % of the echoes' energy"),
        (_far_antennas, r"\d+ µm from its nominal place; expected about 50 µm"),
        (lambda target, _: (SCAN, target), "is a planar scan, which has no antenna array"),
    ],
)
def test_what_no_array_can_be_estimated_from_is_refused(target, centres_m, made, words):
    capture, described = made(target, centres_m)
    with pytest.raises(HandbenchError, match=words):
        estimate_array(capture, described, source="TARGET")


def perfect(nominal_m: np.ndarray) -> Antennas:
    n = len(nominal_m)
    return Antennas(nominal_m, np.zeros(n, complex), np.zeros(n), np.zeros((n, 3)))


def recorded(state: State, echoes: TargetEchoes) -> np.ndarray:
    return np.stack([terms.sum(axis=1) for terms in echoes.terms(state)])


def test_the_covariance_is_honest_in_every_direction(target, centres_m):
    """Arrays and targets drawn from the priors: the squared error in units of the covariance
    averages the number of observable directions, 133 less 12 gauges, over 12 trials: ± 11 % is
    three standard errors."""
    random, nees = np.random.default_rng(11), []
    echoes = TargetEchoes(target, TONES_HZ[::2])
    for _ in range(12):
        sides = [
            Antennas(
                position_m,
                0.1 * random.standard_normal(9) + 0.3j * random.standard_normal(9),
                DELAY_SIGMA_M * random.standard_normal(9),
                POSITION_SIGMA_M * random.standard_normal((9, 3)),
            )
            for position_m in (NOMINAL.tx_m[2::5][:9], NOMINAL.rx_m[2::5][:9])
        ]
        balls_m = centres_m + target.ball_offset_sigma_m * random.standard_normal(centres_m.shape)
        any_gauge = State(*sides, balls_m, np.zeros(5, np.complex128))
        rows = gauges(any_gauge)
        antennas = np.concatenate([side.unknowns.ravel() for side in sides])
        excess = rows[:, : len(antennas)]
        step = np.zeros(rows.shape[1])
        step[: len(antennas)] = -np.linalg.pinv(excess) @ (excess @ antennas)
        true = any_gauge.moved(step)
        samples = recorded(true, echoes)
        sigma = rms(np.abs(samples).ravel())
        samples = samples + (
            sigma / np.sqrt(2) * random.standard_normal((*samples.shape, 2)) @ [1, 1j]
        )
        start = State(*(perfect(s.nominal_m) for s in sides), centres_m, np.zeros(5, complex))
        found, covariance = fit_state(samples.astype(np.complex64), start, echoes)
        miss = [
            (f.unknowns - t.unknowns).ravel() for f, t in ((found.tx, true.tx), (found.rx, true.rx))
        ]
        strength = found.log_ball - true.log_ball
        error = np.concatenate(
            [*miss, (found.centres_m - true.centres_m).ravel(), strength.real, strength.imag]
        )
        scale = np.sqrt(np.diag(covariance))
        values, vectors = np.linalg.eigh(covariance / np.multiply.outer(scale, scale))
        along = (vectors[:, 12:].T @ (error / scale)) ** 2 / values[12:]
        nees.append(along.sum() / len(along))
    assert np.mean(nees) == pytest.approx(1, abs=0.11)


def test_it_is_applied_once_and_to_its_own_array_alone(noisy):
    truth, found = noisy
    capture = truth.capture(np.ones((32, *NOMINAL.channels)), QUIET_RAD)
    once = found.applied_to(capture)
    np.testing.assert_allclose(once.aperture.tx_m, NOMINAL.tx_m + np.array(found.tx.offset_m))
    elsewhere = AntennaArray(NOMINAL.tx_m + 1e-3, NOMINAL.rx_m)
    for wrong, words in (
        (once, "is already applied to this capture"),
        (
            RadarCapture(capture.samples, TONES_HZ, elsewhere),
            r"for an array of \(47, 47\) antennas .*positions differ",
        ),
        (SCAN, "planar scan"),
    ):
        with pytest.raises(HandbenchError, match=words):
            found.applied_to(wrong)


@pytest.mark.parametrize(
    ("find", "put", "expected"),
    [
        ('"version": 1', '"version": 2', "'version' is 2"),
        ('"version"', '"gian": 1, "version"', "unknown key 'gian'"),
        ('"gain": [', '"gain": [[1, 0], ', "has 48 entries, but 'nominal_m' has 47"),
        ('"gain": [[', '"gain": [[NaN, 0], [', r"'tx.gain.0.0' is nan"),
        ('"offset_m": [[', '"offset_m": [[0.1, 0, 0], [', r"'tx.offset_m.0.0' is 0.1"),
        ('"delay_sigma_m": [', '"delay_sigma_m": [-1.0, ', r"'tx.delay_sigma_m.0' is -1.0"),
        ("{", "[{}]; {", "expected a table, the array calibration"),
    ],
)
def test_a_wrong_file_is_refused_in_one_line_and_the_right_one_comes_back(
    tmp_path, noisy, find, put, expected
):
    path = tmp_path / "array.json"
    save_array(path, noisy[1])
    assert load_array(path) == noisy[1]
    content = json.dumps(json.loads(path.read_text()))
    assert find in content
    path.write_text(content.replace(find, put, 1).split(";")[0])
    with pytest.raises(HandbenchError, match=expected) as raised:
        load_array(path)
    assert str(raised.value).startswith(str(path))
    assert "\n" not in str(raised.value)
