"""An array's errors from the echoes of the calibration target, by every second antenna of the
paper's and 32 tones."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from handbench.calibration.array.array_file import ArrayCalibration, load_array, save_array
from handbench.calibration.array.estimate import estimate_array, fit_state, unexplained_share
from handbench.calibration.array.model import Antennas, State, TargetEchoes, normal_equations
from handbench.calibration.array.prior import DELAY_SIGMA_M, POSITION_SIGMA_M, gauges
from handbench.calibration.spheres.description import Target
from handbench.calibration.transforms import perturbation_jacobian
from handbench.radar.data.arrays import AntennaArray, PlanarScan, qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.methods.fsk import depth_step_m
from handbench.radar.simulation.physics.spheres import sphere_echo
from handbench.support.errors import HandbenchError
from tests.radar.exact import backproject, tone_images

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


@pytest.fixture(scope="module")
def quiet(target, centres_m) -> tuple[Imperfect, ArrayCalibration]:
    truth = Imperfect(2)
    return truth, estimate_array(truth.of_target(target, centres_m, QUIET_RAD), target)


class Miss:
    """Errors of what was found, of the living antennas, with their standard deviations."""

    def __init__(self, truth: Imperfect, found: ArrayCalibration, centres_m: np.ndarray) -> None:
        level, phase, toward, offset, true, position = [], [], [], [], [], []
        k = 2 * np.pi * found.reference_hz / C
        sides = found.tx, found.rx
        for side, gain, off_m, leg in zip(
            sides, truth.gains, truth.offsets_m, NOMINAL.legs, strict=True
        ):
            live = gain != 0
            away = leg.position_m - centres_m.mean(axis=0)
            away /= np.linalg.norm(away, axis=1, keepdims=True)
            miss_m = np.array(side.offset_m) - off_m
            seen = (
                side.gains[live] / gain[live] * np.exp(-1j * k * (miss_m * away).sum(axis=1)[live])
            )
            seen /= np.mean(seen / np.abs(seen))
            level.append(np.log(np.abs(seen)) - np.log(np.abs(seen)).mean())
            phase.append(np.angle(seen))
            toward.append(k * (away[live] - away[live].mean(axis=0)))
            offset.append(miss_m[live])
            true.append(off_m[live])
            position.append(leg.position_m[live])
        self.level, self.phase = np.concatenate(level), np.concatenate(phase)
        self._toward, position_m = np.concatenate(toward), np.concatenate(position)
        self._rigid = perturbation_jacobian(position_m - position_m.mean(axis=0))[:, :, :6].reshape(
            -1, 6
        )
        self.offset_m, self.true_m = (
            self._in_gauge(np.concatenate(offset)),
            self._in_gauge(np.concatenate(true)),
        )

    def _in_gauge(self, values_m: np.ndarray) -> np.ndarray:
        """Without what a motion of the whole array would do, which no echo can tell."""
        flat = values_m.ravel()
        return (flat - self._rigid @ np.linalg.lstsq(self._rigid, flat)[0]).reshape(-1, 3)

    @property
    def sharpness_rad(self) -> np.ndarray:
        """Phase errors without what a shift of the whole image explains: the rest blurs."""
        return self.phase - self._toward @ np.linalg.lstsq(self._toward, self.phase)[0]


def sigmas(found: ArrayCalibration, name: str) -> np.ndarray:
    """Standard deviations of the living antennas, both sides."""
    return np.concatenate(
        [np.array(getattr(side, name))[side.gains != 0] for side in (found.tx, found.rx)]
    )


def rms(values: np.ndarray) -> np.ndarray:
    return np.sqrt(np.mean(np.square(values), axis=0))


# --- what is found
# --------------------------------------------------------------------------------------------------


def test_gains_come_back_at_the_papers_noise(noisy, centres_m):
    """0.02 in amplitude and in phase; noise alone gives 0.011 (5 balls of 47 × 32 samples each)."""
    miss = Miss(*noisy, centres_m)
    assert rms(miss.level) < 0.02
    assert rms(miss.sharpness_rad) < 0.02


def test_places_across_the_line_of_sight_come_back(noisy, quiet, centres_m):
    """x and y turn the phases of five balls differently: of 50 µm, 36 are left in one noisy frame,
    and 10 with little noise. z turns them alike, as a phase does, and is hardly told at the paper's
    noise: it stays near 0."""
    few = Miss(*noisy, centres_m)
    assert (rms(few.offset_m)[:2] < 0.8 * rms(few.true_m)[:2]).all()
    assert rms(few.offset_m)[2] < 1.05 * rms(few.true_m)[2]
    much = Miss(*quiet, centres_m)
    assert (rms(much.offset_m)[:2] < 15e-6).all()
    assert rms(much.offset_m)[2] < 0.6 * rms(much.true_m)[2]


@pytest.mark.parametrize("capture", ["noisy", "quiet"])
def test_the_standard_deviations_are_honest(capture, request, centres_m):
    """Normalised errors of 93 antennas average 1: ± 0.25 is three standard errors of independent
    ones. Phases and places share what the whole array has in common (a slope, say), one draw that
    may be small, but not 2.5 σ."""
    truth, found = request.getfixturevalue(capture)
    miss = Miss(truth, found, centres_m)
    assert rms(miss.level / sigmas(found, "level_sigma")) == pytest.approx(1, abs=0.25)
    offsets = rms(miss.offset_m / sigmas(found, "offset_sigma_m"))
    assert ((offsets > 0.3) & (offsets < 1.5)).all()
    assert rms(miss.phase / sigmas(found, "phase_sigma_rad")) < 2.5
    assert found.residual_after_db < found.residual_before_db - 10


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


def test_a_perfect_array_stays_so_within_its_uncertainty(target, centres_m):
    truth = Imperfect(4, size=0.0, dead=False)
    found = estimate_array(truth.of_target(target, centres_m, PAPER_RAD), target)
    miss = Miss(truth, found, centres_m)
    assert rms(miss.level / sigmas(found, "level_sigma")) < 1.25
    assert rms(miss.phase / sigmas(found, "phase_sigma_rad")) < 2.5
    assert (
        rms(miss.offset_m / sigmas(found, "offset_sigma_m")) < 1.1
    ).all()  # the prior is right about them
    assert rms(miss.sharpness_rad) < 0.02


# --- what it is good for
# --------------------------------------------------------------------------------------------


def test_another_capture_becomes_sharp(noisy):
    """A point elsewhere: 30° leave e^{-σ²}, three quarters, of the amplitude that its echoes could
    have together, and raise the side lobes; the calibrated image has all of it but 2 %, and the
    side lobes of a perfect array but 5 %."""
    truth, found = noisy
    point_m = np.array([[-0.03, 0.04, 0.36]])
    raw = truth.capture(sphere_echo(point_m[0], 1e-3, 0.0, TONES_HZ, truth.array), 0.0)
    perfect = np.abs(truth.gains[0] != 0)[:, None] * sphere_echo(
        point_m[0], 1e-3, 0.0, TONES_HZ, NOMINAL
    )
    x, y = np.meshgrid(np.linspace(-0.1, 0.1, 41), np.linspace(-0.1, 0.1, 41))
    plane_m = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 0.359)])
    aside = np.linalg.norm(plane_m - point_m, axis=1) > 0.02
    near_m = (
        point_m
        - [0, 0, 1e-3]
        + 2e-4 * np.stack(np.meshgrid(*[np.arange(-2, 3)] * 3), axis=-1).reshape(-1, 3)
    )

    def seen(samples: np.ndarray, array: AntennaArray) -> tuple[float, float]:
        peak, lobes = (
            np.abs(backproject(samples, TONES_HZ, array, p)) for p in (near_m, plane_m[aside])
        )
        return float(peak.max() / np.abs(samples).sum()), float(rms(lobes) / peak.max())

    ideal, before = seen(perfect, NOMINAL), seen(raw.samples[0], NOMINAL)
    calibrated = found.applied_to(raw)
    after = seen(calibrated.samples[0], calibrated.aperture)
    assert before[0] < 0.85 * ideal[0]
    assert after[0] == pytest.approx(ideal[0], rel=0.02)
    assert before[1] > 1.5 * ideal[1]
    assert after[1] < 1.05 * ideal[1]


def test_depths_by_frequency_shift_keying_come_back(noisy):
    """Many scatterers on a plate: through side lobes each other's phases depend on the tone. The
    calibrated array's depths differ by less than a third of what the raw array's do from those of a
    perfect one."""
    truth, found = noisy
    random, tones_hz = np.random.default_rng(8), np.array([79.5e9, 82e9])
    points_m = np.column_stack(
        [random.uniform(-0.04, 0.04, (60, 2)), random.uniform(0.30, 0.31, 60)]
    )

    def depths_m(samples: np.ndarray, array: AntennaArray) -> np.ndarray:
        low, high = tone_images(samples, tones_hz, array, points_m)
        strong = np.abs(perfect_images[1]) > np.median(np.abs(perfect_images[1]))
        return depth_step_m(low, high, -2.5e9)[strong]

    perfect, echoes = (
        sum(sphere_echo(p, 1e-3, 0.0, tones_hz, array) for p in points_m)
        for array in (NOMINAL, truth.array)
    )
    perfect_images = tone_images(perfect, tones_hz, NOMINAL, points_m)
    raw = truth.capture(echoes, 0.0, tones_hz)
    calibrated = found.applied_to(raw)
    ideal_m = depths_m(perfect, NOMINAL)
    before_m = np.abs(depths_m(raw.samples[0], NOMINAL) - ideal_m).mean()
    after_m = np.abs(depths_m(calibrated.samples[0], calibrated.aperture) - ideal_m).mean()
    assert after_m < before_m / 3


# --- what is refused
# ------------------------------------------------------------------------------------------------


def test_a_missing_ball_is_refused(target, centres_m):
    truth = Imperfect(5)
    balls = [
        (centres_m[i], target.element[i].ball_radius_m, target.foam_delay_m[i])
        for i in (0, 1, 3, 4)
    ]
    capture = truth.capture(
        sum(sphere_echo(*ball, TONES_HZ, truth.array) for ball in balls), PAPER_RAD
    )
    with pytest.raises(HandbenchError, match="elements 3 are not seen; expected all of them"):
        estimate_array(capture, target)


def test_another_target_is_refused(target, centres_m):
    """A corner 1.5 mm from where the description has it still matches, yet its phases tell."""
    first = target.element[0]
    x, y, z = first.centre_m
    wrong = target.model_copy(
        update={
            "element": (
                first.model_copy(update={"centre_m": (x + 0.0015, y, z)}),
                *target.element[1:],
            )
        }
    )
    capture = Imperfect(6).of_target(target, centres_m, PAPER_RAD)
    with pytest.raises(
        HandbenchError,
        match=r"TARGET: the target's element 1 is 0\.\d+ mm from where its description",
    ):
        estimate_array(capture, wrong, source="TARGET")


def test_what_else_echoes_there_is_refused(target, centres_m):
    """A sixth ball, as strong as the others, holds a sixth of the energy."""
    truth = Imperfect(7)
    balls = [(c, e.ball_radius_m, 0.0) for c, e in zip(centres_m, target.element, strict=True)]
    balls.append((centres_m.mean(axis=0) + [0.01, -0.025, 0], 0.005, 0.0))
    capture = truth.capture(
        sum(sphere_echo(*ball, TONES_HZ, truth.array) for ball in balls), PAPER_RAD
    )
    plain = target.model_copy(update={"foam_permittivity": 1.0})
    with pytest.raises(
        HandbenchError,
        match=r"the target explains 8\d\.\d % of its echoes' energy, expected at least",
    ):
        estimate_array(capture, plain)


def test_errors_far_beyond_the_expected_are_refused(target, centres_m):
    truth = Imperfect(9, dead=False)
    for side, offset_m in enumerate(truth.offsets_m):
        truth.offsets_m[side] = 6 * offset_m
    truth.array = AntennaArray(NOMINAL.tx_m + truth.offsets_m[0], NOMINAL.rx_m + truth.offsets_m[1])
    capture = truth.of_target(target, centres_m, QUIET_RAD)
    with pytest.raises(
        HandbenchError,
        match=r"antennas would be \d+ µm off, expected about 50 µm; check the target",
    ):
        estimate_array(capture, target)


def test_a_planar_scan_is_refused(target):
    scan = RadarCapture(np.ones((1, 32, 4), np.complex64), TONES_HZ, PlanarScan(np.zeros((4, 3))))
    with pytest.raises(HandbenchError, match="a planar scan has no array"):
        estimate_array(scan, target)


# --- the equations
# --------------------------------------------------------------------------------------------------


def small_state(target: Target, centres_m: np.ndarray) -> tuple[State, TargetEchoes]:
    random = np.random.default_rng(10)

    def side(position_m: np.ndarray) -> Antennas:
        n = len(position_m)
        gain = 0.2 * random.standard_normal(n) + 0.5j * random.standard_normal(n)
        return Antennas(
            position_m,
            gain,
            1e-4 * random.standard_normal(n),
            1e-4 * random.standard_normal((n, 3)),
        )

    balls = 0.1 * random.standard_normal(5) + 1j * random.standard_normal(5)
    state = State(side(NOMINAL.tx_m[::15]), side(NOMINAL.rx_m[::12]), centres_m, balls)
    return state, TargetEchoes(target, TONES_HZ[::6])


def recorded(state: State, echoes: TargetEchoes) -> np.ndarray:
    return np.stack([terms.sum(axis=1) for terms in echoes.terms(state)])


def test_the_jacobian_is_that_of_the_model(target, centres_m):
    """JᵀJ against central differences of the model itself: the specular point's way round the ball
    turns directions by less than a hundredth, and amplitudes change with distance by less than
    that."""
    state, echoes = small_state(target, centres_m)
    normal, _, _ = normal_equations(recorded(state, echoes), state, echoes)
    columns = []
    for unknown in range(len(normal)):
        step = np.zeros(len(normal))
        step[unknown] = 2e-3 / np.sqrt(normal[unknown, unknown] / normal[0, 0])
        change = recorded(state.moved(step), echoes) - recorded(state.moved(-step), echoes)
        columns.append(change.ravel().view(np.float32) / (2 * step[unknown]))
    numeric = np.array(columns, np.float64)
    scale = np.sqrt(np.diag(normal))
    difference = (numeric @ numeric.T - normal) / np.multiply.outer(scale, scale)
    assert np.abs(difference).max() < 0.02


def test_the_covariance_is_honest_in_every_direction(target, centres_m):
    """Arrays and targets drawn from the priors: the squared error in units of the covariance
    averages the number of directions that can be told, 133 less 12 gauges, over 12 trials: ± 11 %
    is three standard errors."""
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
        perfect = [
            Antennas(s.nominal_m, 0 * s.log_gain, 0 * s.delay_m, 0 * s.offset_m) for s in sides
        ]
        start = State(*perfect, centres_m, np.zeros(5, np.complex128))
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


def test_a_fit_ends_where_it_began_when_nothing_is_to_learn(target, centres_m):
    """Samples of the state itself, without noise and with its antennas in the gauge: there is
    nothing to learn."""
    state, echoes = small_state(target, centres_m)
    plain = State(
        *(
            Antennas(s.nominal_m, s.log_gain - s.log_gain.mean(), 0 * s.delay_m, 0 * s.offset_m)
            for s in (state.tx, state.rx)
        ),
        centres_m,
        state.log_ball,
    )
    found, _ = fit_state(recorded(plain, echoes), plain, echoes)
    assert np.abs(found.tx.log_gain - plain.tx.log_gain).max() < 1e-3
    assert np.abs(found.tx.offset_m).max() < 1e-6


def test_gauges_are_what_no_echo_tells(target, centres_m):
    """A gauge step of levels and phases, taken up by the balls, changes no sample."""
    state, echoes = small_state(target, centres_m)
    rows = gauges(state)
    step = 0.1 * rows[0] - 0.3 * rows[2]  # the transmitters' level and phase
    step[-10:-5], step[-5:] = -0.1, 0.3
    assert np.linalg.matrix_rank(rows) == 12
    np.testing.assert_allclose(
        recorded(state.moved(step), echoes), recorded(state, echoes), rtol=1e-4
    )


# --- the file
# -------------------------------------------------------------------------------------------------------


def test_the_file_comes_back(tmp_path, noisy):
    save_array(tmp_path / "array.json", noisy[1])
    assert load_array(tmp_path / "array.json") == noisy[1]


def test_it_is_applied_once_and_to_its_own_array_alone(noisy):
    truth, found = noisy
    capture = truth.capture(np.ones((32, *NOMINAL.channels)), QUIET_RAD)
    once = found.applied_to(capture)
    np.testing.assert_allclose(once.aperture.tx_m, NOMINAL.tx_m + np.array(found.tx.offset_m))
    with pytest.raises(HandbenchError, match="has been applied to this capture already"):
        found.applied_to(once)
    other = RadarCapture(capture.samples, TONES_HZ, AntennaArray(NOMINAL.tx_m + 1e-3, NOMINAL.rx_m))
    with pytest.raises(HandbenchError, match=r"of an array of \(47, 47\) antennas in other places"):
        found.applied_to(other)
    with pytest.raises(HandbenchError, match="planar scan"):
        found.applied_to(
            RadarCapture(np.ones((1, 32, 4), np.complex64), TONES_HZ, PlanarScan(np.zeros((4, 3))))
        )


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda c: c.update(version=2), "'version' is 2"),
        (lambda c: c.update(gian=1), "unknown key 'gian'"),
        (
            lambda c: c["tx"]["gain"].pop(),
            "'gain' has 46 entries; expected one for each of the 47 antennas",
        ),
        (lambda c: c["rx"]["offset_m"][0].pop(), "'rx.offset_m.0.2' is missing"),
        (lambda c: c["rx"]["gain"].__setitem__(0, [float("nan"), 0]), r"'rx.gain.0.0' is nan"),
        (lambda c: c["rx"]["offset_m"].__setitem__(0, [0.1, 0, 0]), r"'rx.offset_m.0.0' is 0.1"),
        (lambda c: c["rx"]["delay_sigma_m"].__setitem__(0, -1.0), r"'rx.delay_sigma_m.0' is -1.0"),
        (lambda c: c["tx"].update(gain=[[0, 0]] * 47), "every gain is 0"),
    ],
)
def test_files_that_are_none_are_refused(tmp_path, noisy, change, expected):
    path = tmp_path / "array.json"
    save_array(path, noisy[1])
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))
    with pytest.raises(HandbenchError, match=expected) as raised:
        load_array(path)
    assert str(raised.value).startswith(str(path))
    assert "\n" not in str(raised.value)


def test_a_list_is_no_calibration(tmp_path):
    (tmp_path / "array.json").write_text("[]")
    with pytest.raises(HandbenchError, match="is a list; expected an array calibration"):
        load_array(tmp_path / "array.json")


@pytest.mark.parametrize(
    ("cell", "counts"), [(0, True), (5, True), (-8, True), (14, False), (-15, False)]
)
def test_what_is_left_over_is_counted_about_the_balls_alone(target, centres_m, cell, counts):
    """An echo that the state lacks, so many range cells behind the target's middle: its part of all
    energy, or none."""
    plain = small_state(target, centres_m)[0]
    state = State(*(Antennas(s.nominal_m, 0 * s.log_gain, 0 * s.delay_m, 0 * s.offset_m) for s in (plain.tx, plain.rx)),
                  centres_m, np.zeros(5, np.complex128))  # fmt: skip
    echoes = TargetEchoes(target, TONES_HZ)
    middle_m = centres_m.mean(axis=0)
    cell_m = C / (TONES_HZ[1] - TONES_HZ[0]) / len(TONES_HZ)
    tx_m, rx_m = (
        np.linalg.norm(side.nominal_m - middle_m, axis=1) for side in (state.tx, state.rx)
    )
    path_m = np.add.outer(tx_m, rx_m)[..., None] + cell * cell_m
    known = recorded(state, echoes)
    unknown = 0.3 * rms(np.abs(known).ravel()) * np.exp(-1j * echoes.wavenumber * path_m)
    share = (np.abs(unknown) ** 2).sum() / (np.abs(known + unknown) ** 2).sum()
    found = unexplained_share(known + unknown, state, echoes)
    assert found == pytest.approx(share, rel=0.1) if counts else found < 0.02 * share
