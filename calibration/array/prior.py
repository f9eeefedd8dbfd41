"""Prior knowledge and first values for the estimate of an array's calibration: tolerances of array
and target, combinations of unknowns that no echo determines, the target's pose from the
uncalibrated image, and gains by alternating least squares."""

from dataclasses import replace

import numpy as np

from handbench.calibration.array.model import (
    BALL,
    DELAY,
    EACH,
    LEVEL,
    PHASE,
    PLACE,
    Antennas,
    State,
    TargetEchoes,
    split,
)
from handbench.calibration.spheres.description import Target, match
from handbench.calibration.spheres.radar_detection import EchoSearch, find_balls
from handbench.calibration.transforms import perturbation_jacobian, umeyama
from handbench.radar.data.capture import RadarCapture
from handbench.support.errors import HandbenchError

SWEEPS = 30  # of alternating least squares, before Gauss–Newton
# manufacturing tolerances: of an antenna's position, per axis; of a cable
POSITION_SIGMA_M, DELAY_SIGMA_M = 5e-5, 1e-4
WEAKEST_DB = -20.0  # antennas that are weaker relative to the median are dead
LEAST_EXPLAINED = 0.95  # share of the target's echoes that the model must explain
MOST_SIGMAS = 2.0  # largest root mean square error in standard deviations of the prior
# a ball is stronger than the foam and than the side lobes of an imperfect array
SEARCH = EchoSearch(threshold_db=-10.0)


def prior_information(state: State, target: Target) -> np.ndarray:
    """Compute the information matrix [u, u] (1/σ²) of what is known about the unknowns without
    echoes: the tolerances of the antennas' positions and cables, and of the balls' positions in the
    target. Rigid motions of all balls together are not constrained."""
    n_tx, n_rx, n_balls = state.counts
    information = np.zeros(EACH * (n_tx + n_rx) + BALL * n_balls)
    for side in split(information, *state.counts)[:2]:
        side[:, DELAY], side[:, PLACE] = DELAY_SIGMA_M**-2, POSITION_SIGMA_M**-2
    rigid = perturbation_jacobian(state.centres_m - state.centres_m.mean(axis=0))[:, :, :6].reshape(
        -1, 6
    )
    shape = np.eye(len(rigid)) - rigid @ np.linalg.pinv(rigid)
    balls = EACH * (n_tx + n_rx) + np.arange(len(rigid))
    matrix = np.diag(information)
    matrix[balls[:, None], balls] = shape / shape_sigma_m(target) ** 2
    return matrix


def prior_residuals(state: State, target: Target) -> np.ndarray:
    """Compute the deviations [u] of all unknowns from their prior values, in the unknowns' units,
    not divided by σ.

    The prior values are 0 for the antennas' errors and, for the balls' centres, the described
    target in the pose that fits them best. The balls' strengths have no prior; their deviations are
    0.
    """
    strengths = np.zeros(2 * len(state.log_ball))
    parts = (
        state.tx.unknowns,
        state.rx.unknowns,
        state.centres_m - place_target(target, state.centres_m),
        strengths,
    )
    return np.concatenate([part.ravel() for part in parts])


def shape_sigma_m(target: Target) -> float:
    """Return the standard deviation of a ball's position in its foam sphere, per axis, from the
    target's description; at least a micrometre."""
    return max(target.ball_offset_sigma_m, 1e-6)


def check(state: State, left: float, target: Target, source: str) -> None:
    """Raise HandbenchError if the target explains too little of its echoes, or if the estimated
    errors of balls or antennas are much larger than their tolerances.

    left: share of the echoes' energy that the model does not explain; source: name of the capture,
    for the message.
    """
    if left > 1 - LEAST_EXPLAINED:
        raise HandbenchError(
            f"{source}: the target explains only {100 * (1 - left):.1f} % of the echoes' energy; "
            f"expected at least {100 * LEAST_EXPLAINED:.0f} %; check the description of the "
            "target, and remove other objects from the view"
        )
    off_m = state.centres_m - place_target(target, state.centres_m)
    worst = int(np.linalg.norm(off_m, axis=1).argmax())
    if np.linalg.norm(off_m[worst]) > 2 * MOST_SIGMAS * shape_sigma_m(target):
        raise HandbenchError(
            f"{source}: element {worst + 1} of the target is "
            f"{1e3 * np.linalg.norm(off_m[worst]):.2f} mm away from its place in the description; "
            f"expected about {1e3 * shape_sigma_m(target):.2f} mm; measure the target again"
        )
    offsets_m = np.sqrt(
        np.mean(np.concatenate([state.tx.offset_m, state.rx.offset_m]) ** 2, axis=0)
    )
    if offsets_m.max() > MOST_SIGMAS * POSITION_SIGMA_M:
        raise HandbenchError(
            f"{source}: an antenna would have to be {1e6 * offsets_m.max():.0f} µm from its "
            f"nominal place; expected about {1e6 * POSITION_SIGMA_M:.0f} µm; check the "
            "description of the target"
        )


def gauges(state: State) -> np.ndarray:
    """Return the combinations of unknowns [12, u] that no echo determines, and that the fit
    therefore keeps fixed: mean level, phase and delay of transmitters and of receivers, and the six
    rigid motions of the whole array."""
    n_tx, n_rx, n_balls = state.counts
    rows = np.zeros((12, EACH * (n_tx + n_rx) + BALL * n_balls))
    position_m = np.concatenate([state.tx.nominal_m, state.rx.nominal_m])
    rigid = perturbation_jacobian(position_m - position_m.mean(axis=0))[:, :, :6]
    for row, unknown in enumerate((LEVEL, PHASE, DELAY)):
        split(rows[2 * row], *state.counts)[0][:, unknown] = 1
        split(rows[2 * row + 1], *state.counts)[1][:, unknown] = 1
    for row in range(6):
        tx, rx, _, _ = split(rows[6 + row], *state.counts)
        tx[:, PLACE], rx[:, PLACE] = rigid[:n_tx, :, row], rigid[n_tx:, :, row]
    return rows


def constrained_inverse(normal: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Invert a normal matrix [u, u] for steps that keep the combinations `rows` [12, u] of the
    unknowns fixed, by a bordered matrix: the covariance [u, u]. The matrix is scaled to a unit
    diagonal first, since metres and radians differ."""
    scale = 1 / np.sqrt(np.diag(normal))
    rows = rows * scale
    rows /= np.linalg.norm(rows, axis=1, keepdims=True)
    bordered = np.block(
        [[normal * np.multiply.outer(scale, scale), rows.T], [rows, np.zeros((len(rows),) * 2)]]
    )
    return np.linalg.inv(bordered)[: len(normal), : len(normal)] * np.multiply.outer(scale, scale)


def nominal_state(capture: RadarCapture, target: Target) -> State:
    """Return first values of all unknowns: an array without errors, and the target's balls in the
    pose that the radar image shows, with strength 1. Raises HandbenchError if a ball is not found
    in the image."""
    found = match(find_balls(capture, target, SEARCH), target, "echoes")
    missing = [i + 1 for i in range(len(target.element)) if i not in found]
    if missing:
        raise HandbenchError(
            f"echoes: the elements {', '.join(map(str, missing))} of the target are not visible, "
            "but an array calibration needs all; check the target's description and place"
        )
    seen_m = np.array([found[i].centre_m for i in range(len(target.element))])
    places_m = [leg.position_m for leg in capture.aperture.legs]
    tx, rx = (
        Antennas(m, np.zeros(len(m), np.complex128), np.zeros(len(m)), np.zeros_like(m))
        for m in places_m
    )
    return State(tx, rx, place_target(target, seen_m), np.zeros(len(seen_m), np.complex128))


def place_target(target: Target, seen_m: np.ndarray) -> np.ndarray:
    """Return the balls' centres [i, 3] as described, moved by the rigid motion that fits the
    measured centres seen_m [i, 3] best."""
    described_m = target.centres_m + target.ball_offsets_m
    pose = umeyama(described_m, seen_m)
    return described_m @ pose[:3, :3].T + pose[:3, 3]


def fit_gains(samples: np.ndarray, state: State, echoes: TargetEchoes) -> tuple[State, State]:
    """Fit the balls' strengths and the antennas' gains to samples [t, r, f], with antennas and
    balls at fixed positions. Returns two states: one with the best strengths for the given gains,
    one with the best strengths and gains.

    By alternating least squares, the transmitters' gains follow from the receivers', and vice
    versa.
    """
    balls = echoes.balls(state.centres_m, state.array)
    matched = np.einsum("trif,trf->tri", balls.conj(), samples, optimize=True)
    gram = balls.conj() @ balls.swapaxes(2, 3)
    a, b = (np.exp(side.log_gain) for side in (state.tx, state.rx))
    first = strength = _strengths(matched, gram, a, b)
    for _ in range(SWEEPS):
        seen = matched @ strength.conj()
        power = np.einsum("i,trij,j->tr", strength.conj(), gram, strength, optimize=True).real
        a = (seen @ b.conj()) / (power @ np.abs(b) ** 2)
        b = (a.conj() @ seen) / (np.abs(a) ** 2 @ power)
        strength = _strengths(matched, gram, a, b)
    return replace(state, log_ball=_log(first)), replace(
        state,
        tx=replace(state.tx, log_gain=_log(a)),
        rx=replace(state.rx, log_gain=_log(b)),
        log_ball=_log(strength),
    )


def initial_states(
    samples: np.ndarray, nominal: State, echoes: TargetEchoes
) -> tuple[tuple[np.ndarray, np.ndarray], State, State]:
    """Find the antennas that work, and fit first values of all unknowns to samples [t, r, f].
    Antennas that are 20 dB or more weaker than the median are dead.

    Returns ((boolean masks [t] and [r] of the antennas that work), state of the nominal array with
    the balls' best strengths, state with the best gains as well). Both states have only these
    antennas.
    """
    raw, state = fit_gains(samples, nominal, echoes)
    tx, rx = (side.log_gain.real for side in (state.tx, state.rx))
    live_tx, live_rx = (
        level > np.median(level) + WEAKEST_DB / 20 * np.log(10) for level in (tx, rx)
    )
    return (live_tx, live_rx), live_part(raw, live_tx, live_rx), live_part(state, live_tx, live_rx)


def live_part(state: State, live_tx: np.ndarray, live_rx: np.ndarray) -> State:
    """Return the state without dead antennas, and with gains scaled such that the mean log level
    and mean phase of transmitters and of receivers are 0. The balls' strengths are scaled
    inversely, so that the echoes do not change. live_tx [t], live_rx [r]: True for antennas that
    work."""
    sides, taken = [], 0.0
    for side, live in ((state.tx, live_tx), (state.rx, live_rx)):
        log_gain = side.log_gain[live]
        turn = np.angle(np.exp(1j * log_gain.imag).mean())
        # about 0, where the branch cut is far
        phase = np.angle(np.exp(1j * (log_gain.imag - turn)))
        mean = log_gain.real.mean() + 1j * phase.mean()
        taken += mean + 1j * turn
        centred = log_gain.real + 1j * phase - mean
        sides.append(
            Antennas(side.nominal_m[live], centred, side.delay_m[live], side.offset_m[live])
        )
    return replace(state, tx=sides[0], rx=sides[1], log_ball=state.log_ball + taken)


def _strengths(matched: np.ndarray, gram: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Fit the balls' complex strengths [i] by least squares for given gains a [t] and b [r].

    matched [t, r, i], gram [t, r, i, i]: inner products of the balls' echoes with the samples and
    with each other, summed over frequencies.
    """
    gain = np.multiply.outer(a, b)
    together = np.einsum("tr,trij->ij", np.abs(gain) ** 2, gram, optimize=True)
    return np.linalg.solve(together, np.einsum("tr,tri->i", gain.conj(), matched, optimize=True))


def _log(values: np.ndarray) -> np.ndarray:
    """Compute the complex logarithm, log level + j · phase; the logarithm of 0 is replaced by that
    of a very small number."""
    return np.log(np.abs(values) + 1e-12) + 1j * np.angle(values)
