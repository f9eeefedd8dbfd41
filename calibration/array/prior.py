"""Prior knowledge of an array and a target, and the gauge freedoms that no echo determines."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from calibration.array.model import BALL, DELAY, EACH, LEVEL, PHASE, PLACE, State, split
from calibration.array.start import placed
from calibration.target.description import Target
from calibration.transforms import perturbation_jacobian
from radar.support.config import Config


class Settings(Config):
    """Prior knowledge of an array before it is calibrated, and limits of the estimates that are accepted.

    Standard deviations of what manufacture leaves: position_sigma_m of an antenna, per axis, delay_sigma_m of a cable;
    that of a ball's place comes with the target. weakest_db: antennas that are weaker against the median are dead.
    least_explained: part of the target's echoes that the model must explain; most_sigmas: how many standard deviations
    the errors may have on average.
    """

    position_sigma_m: float = Field(default=5e-5, gt=0, le=1e-3)
    delay_sigma_m: float = Field(default=1e-4, gt=0, le=1e-2)
    weakest_db: float = Field(default=-20.0, lt=0)
    least_explained: float = Field(default=0.95, gt=0, lt=1)
    most_sigmas: float = Field(default=2.0, ge=1)


def prior(state: State, target: Target, settings: Settings) -> np.ndarray:
    """Information [u, u] (1/σ²) that is there before any echo. Of the balls, it says nothing about a motion of them
    all as one body."""
    n_tx, n_rx, n_balls = state.counts
    information = np.zeros(EACH * (n_tx + n_rx) + BALL * n_balls)
    for side in split(information, *state.counts)[:2]:
        side[:, DELAY], side[:, PLACE] = settings.delay_sigma_m**-2, settings.position_sigma_m**-2
    rigid = perturbation_jacobian(state.centres_m - state.centres_m.mean(axis=0))[:, :, :6].reshape(-1, 6)
    shape = np.eye(len(rigid)) - rigid @ np.linalg.pinv(rigid)
    balls = EACH * (n_tx + n_rx) + np.arange(len(rigid))
    matrix = np.diag(information)
    matrix[balls[:, None], balls] = shape / shape_sigma_m(target) ** 2
    return matrix


def surprises(state: State, target: Target) -> np.ndarray:
    """Deviations [u] that the priors expect to be 0: the antennas' unknowns and the balls' misplacements."""
    strengths = np.zeros(2 * len(state.log_ball))
    parts = state.tx.unknowns, state.rx.unknowns, misplaced_m(state.centres_m, target), strengths
    return np.concatenate([part.ravel() for part in parts])


def misplaced_m(centres_m: np.ndarray, target: Target) -> np.ndarray:
    """Displacements [i, 3] of the balls from the described target in its best-fitting pose."""
    return centres_m - placed(target, centres_m)


def shape_sigma_m(target: Target) -> float:
    """Standard deviation of a ball's place, per axis; a micrometre at least, which no one measures."""
    return max(target.ball_offset_sigma_m, 1e-6)


def gauges(state: State) -> np.ndarray:
    """Gauge freedoms [12, u], which no echo determines: the mean level, phase and delay of each side, and the rigid
    motion of the whole array; a step leaves each where it is."""
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
    """Inverse of the normal matrix among steps that leave every gauge row at 0 (bordered matrix), scaled so that metres
    and radians weigh alike."""
    scale = 1 / np.sqrt(np.diag(normal))
    rows = rows * scale
    rows /= np.linalg.norm(rows, axis=1, keepdims=True)
    bordered = np.block([[normal * np.multiply.outer(scale, scale), rows.T], [rows, np.zeros((len(rows),) * 2)]])
    return np.linalg.inv(bordered)[: len(normal), : len(normal)] * np.multiply.outer(scale, scale)
