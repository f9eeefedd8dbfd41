"""Start of the array's estimate: the target's pose in the raw image, and gains by alternating least squares."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.array.model import Antennas, Echoes, State
from calibration.target.description import Target
from calibration.target.matching import match
from calibration.target.radar_detection import EchoSearch, find_balls
from calibration.transforms import umeyama
from radar.data.capture import RadarCapture
from radar.support.errors import HandbenchError

SWEEPS = 30  # of alternation; it starts Gauss–Newton, which ends it
SEARCH = EchoSearch(threshold_db=-10.0)  # a ball is stronger than the foam and than what an imperfect array smears


def nominal_state(capture: RadarCapture, target: Target) -> State:
    """A perfect array before the target where its image says that it is; the balls' strengths are still open.

    Raises HandbenchError when not every ball is found.
    """
    found = match(find_balls(capture, target, SEARCH), target, "echoes")
    missing = [i + 1 for i in range(len(target.element)) if i not in found]
    if missing:
        raise HandbenchError(
            f"echoes: the target's elements {', '.join(map(str, missing))} are not seen; expected all of them to "
            "calibrate an array: check the target's description and its place"
        )
    seen_m = np.array([found[i].centre_m for i in range(len(target.element))])
    tx, rx = (_perfect(leg.position_m) for leg in capture.aperture.legs)
    return State(tx, rx, placed(target, seen_m), np.zeros(len(seen_m), np.complex128))


def placed(target: Target, seen_m: np.ndarray) -> np.ndarray:
    """The balls' described centres [i, 3], moved as one body to where they are seen [i, 3]."""
    described_m = target.centres_m + target.ball_offsets_m
    pose = umeyama(described_m, seen_m)
    return described_m @ pose[:3, :3].T + pose[:3, 3]


def fitted_gains(samples: np.ndarray, state: State, echoes: Echoes) -> tuple[State, State]:
    """The state with the balls' strengths that fit best with the gains as they are, and with strengths and gains that
    fit best together; samples [t, r, f].

    For given balls, least squares give each transmitter's gain when receivers are known, and the other way round.
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
        state, tx=replace(state.tx, log_gain=_log(a)), rx=replace(state.rx, log_gain=_log(b)), log_ball=_log(strength)
    )


def alive(state: State, weakest_db: float) -> tuple[np.ndarray, np.ndarray]:
    """Masks [t] and [r] of the transmitters and receivers that are not weakest_db below their median."""
    levels = [side.log_gain.real for side in (state.tx, state.rx)]
    return tuple(level > np.median(level) + weakest_db / 20 * np.log(10) for level in levels)


def without(state: State, live_tx: np.ndarray, live_rx: np.ndarray) -> State:
    """The state of the live antennas alone, in the gauge: no mean level, phase or delay on either side; the balls take
    them over."""
    sides, taken = [], 0.0
    for side, live in ((state.tx, live_tx), (state.rx, live_rx)):
        log_gain = side.log_gain[live]
        turn = np.angle(np.exp(1j * log_gain.imag).mean())
        phase = np.angle(np.exp(1j * (log_gain.imag - turn)))  # about 0, where the branch cut is far
        mean = log_gain.real.mean() + 1j * phase.mean()
        taken += mean + 1j * turn
        centred = log_gain.real + 1j * phase - mean
        sides.append(Antennas(side.nominal_m[live], centred, side.delay_m[live], side.offset_m[live]))
    return replace(state, tx=sides[0], rx=sides[1], log_ball=state.log_ball + taken)


def _perfect(position_m: np.ndarray) -> Antennas:
    n = len(position_m)
    return Antennas(position_m, np.zeros(n, np.complex128), np.zeros(n), np.zeros((n, 3)))


def _strengths(matched: np.ndarray, gram: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The balls' complex strengths [i] for gains a [t] and b [r]."""
    gain = np.multiply.outer(a, b)
    together = np.einsum("tr,trij->ij", np.abs(gain) ** 2, gram, optimize=True)
    return np.linalg.solve(together, np.einsum("tr,tri->i", gain.conj(), matched, optimize=True))


def _log(values: np.ndarray) -> np.ndarray:
    """Complex logarithm; of 0, that of a very small number."""
    return np.log(np.abs(values) + 1e-12) + 1j * np.angle(values)
