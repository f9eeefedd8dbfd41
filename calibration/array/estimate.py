"""Maximum-a-posteriori estimate of an array's gains, phases, delays and antenna positions from the
samples of a capture of the calibration target.

Gauss–Newton steps minimise Σ |s − model|²/σ² + Σ (offset/σ_p)² + Σ (delay/σ_d)² + Σ (shape/σ_s)²;
what no echo determines, such as a motion of the whole array, is kept fixed. `shape` is the
deviation of a ball from the described target in its best pose. The priors keep unknowns at 0 that
the echoes do not determine: antenna offsets along the line of sight are almost indistinguishable
from phases.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from handbench.calibration.array import prior
from handbench.calibration.array.array_file import ArrayCalibration, Side
from handbench.calibration.array.model import (
    EACH,
    Antennas,
    State,
    TargetEchoes,
    directions,
    normal_equations,
)
from handbench.calibration.spheres.description import Target
from handbench.radar.data.arrays import AntennaArray
from handbench.radar.data.capture import RadarCapture
from handbench.radar.imaging.cpu.exact import path_lengths
from handbench.support.errors import HandbenchError

MAX_STEPS = 20
ENOUGH = 0.1  # a step that lowers χ² by less is a small part of one standard deviation
SINGLE = 1e-5  # noise of samples in single precision, relative to their amplitude, at least
GUARD_CELLS = 3  # of the sweep's range resolution, about the balls


def estimate_array(
    capture: RadarCapture, target: Target, source: str = "target capture"
) -> ArrayCalibration:
    """Estimate the calibration of an array from the echoes of a target at rest, whose frames are
    averaged: gain, phase, delay and position of each antenna, with standard deviations.

    source: name of the capture, for the result and for messages. Raises HandbenchError for a planar
    scan, if a ball is not found, or if target and echoes contradict each other.
    """
    if not isinstance(capture.aperture, AntennaArray):
        raise HandbenchError(
            f"{source}: is a planar scan, which has no antenna array to calibrate; use a capture "
            "of a MIMO array"
        )
    mean = replace(capture, samples=capture.samples.mean(axis=0, keepdims=True), frame_times_s=None)
    samples = np.ascontiguousarray(np.moveaxis(mean.samples[0], 0, -1))
    echoes = TargetEchoes(target, capture.frequencies_hz)
    live, raw, begun = prior.initial_states(samples, prior.nominal_state(mean, target), echoes)
    samples = samples[live[0]][:, live[1]]
    state, covariance = fit_state(samples, begun, echoes)
    before, after = (unexplained_share(samples, s, echoes) for s in (raw, state))
    prior.check(state, after, target, source)
    n_tx, n_rx, _ = state.counts
    every = np.arange(n_tx + n_rx)  # antenna
    antennas = covariance[: EACH * len(every), : EACH * len(every)].reshape(
        len(every), EACH, len(every), EACH
    )
    own = np.split(antennas[every, :, every], [n_tx])  # blocks of single antennas, by side
    sides = zip(capture.aperture.legs, live, (state.tx, state.rx), own, strict=True)
    tx, rx = (
        _side(leg.position_m, lives, s, c, state.centres_m, echoes) for leg, lives, s, c in sides
    )
    levels_db = {
        "residual_before_db": 10 * np.log10(before),
        "residual_after_db": 10 * np.log10(after),
    }
    return ArrayCalibration(
        source=source, reference_hz=echoes.reference_hz, tx=tx, rx=rx, **levels_db
    )


def fit_state(samples: np.ndarray, state: State, echoes: TargetEchoes) -> tuple[State, np.ndarray]:
    """Find the most probable values of all unknowns for samples [t, r, f] by Gauss–Newton steps:
    (values, covariance [u, u]). The noise level is that of the residual.

    state: values of the unknowns to begin with; echoes: model of the target's echoes. Raises
    HandbenchError if the steps do not converge.
    """
    floor = SINGLE**2 * float(np.mean(np.abs(samples) ** 2)) / 2
    information = prior.prior_information(state, echoes.target)
    for _ in range(MAX_STEPS):
        normal, right, power = normal_equations(samples, state, echoes)
        freedom = 2 * samples.size - len(right)
        variance = max(power * samples.size / freedom, floor)  # per real and imaginary part
        pull = right / variance - information @ prior.prior_residuals(state, echoes.target)
        inverse = prior.constrained_inverse(normal / variance + information, prior.gauges(state))
        step = inverse @ pull
        state = state.moved(step)
        if step @ pull < ENOUGH:
            return state, inverse
    raise HandbenchError(
        "echoes: the errors of the array were still changing after the last step; they may be too "
        "large to focus the target"
    )


def unexplained_share(samples: np.ndarray, state: State, echoes: TargetEchoes) -> float:
    """Compute the share of the target's echo energy in samples [t, r, f] that the model with these
    unknowns does not explain. Noise is deducted; the share is at least its uncertainty by noise.

    In range profiles relative to the target's middle, the balls are within a few range cells; the
    median of the other cells gives the noise.
    """
    middle_m = state.centres_m.mean(axis=0)
    path_m = path_lengths(state.array, middle_m)
    cell_m = 2 * np.pi / np.ptp(echoes.wavenumber)
    reach_m = 2 * np.linalg.norm(state.centres_m - middle_m, axis=1).max()
    cells = np.fft.fftfreq(samples.shape[-1], 1 / samples.shape[-1])
    near = np.abs(cells) <= reach_m / cell_m + GUARD_CELLS
    profiles = np.zeros((2, samples.shape[-1]))
    for t, terms in enumerate(echoes.terms(state)):
        focus = np.exp(1j * np.multiply.outer(path_m[t], echoes.wavenumber))
        for profile, what in zip(
            profiles, (samples[t], samples[t] - terms.sum(axis=1)), strict=True
        ):
            profile += (np.abs(np.fft.fft(what * focus, axis=-1)) ** 2).sum(axis=0)
    noise = float(np.median(profiles[1][~near])) if (~near).any() else 0.0
    whole, rest = ((profile[near] - noise).sum() for profile in profiles)
    detectable = max(noise * np.sqrt(near.sum() / path_m.size), SINGLE**2 * whole)
    return float(max(rest, detectable) / whole)


def _side(
    nominal_m: np.ndarray,
    live: np.ndarray,
    found: Antennas,
    covariance: np.ndarray,
    centres_m: np.ndarray,
    echoes: TargetEchoes,
) -> Side:
    """Convert the estimated unknowns of the transmitters, or of the receivers, to their calibration
    in the file.

    nominal_m [n, 3], live [n]: positions of all antennas, and which of them work; found, covariance
    [live, 6, 6]: estimates for those that work; centres_m [i, 3]: the balls. A dead antenna has
    gain 0 and large standard deviations (of delay and position, those of the prior).
    """
    toward = directions(centres_m.mean(axis=0, keepdims=True), found)[:, 0]
    none = np.zeros(len(toward))
    # by the unknowns of `Antennas`
    seen = np.column_stack([none, none + 1, none, -echoes.wavenumber.mean() * toward])
    level_sigma, _, delay_sigma_m, *offset_sigma_m = np.sqrt(
        np.diagonal(covariance, axis1=1, axis2=2)
    ).T
    phase_sigma = np.sqrt(np.einsum("na,nab,nb->n", seen, covariance, seen))

    def all_of(values: np.ndarray, dead: float) -> list[Any]:
        everyone = np.full((len(live), *values.shape[1:]), dead)
        everyone[live] = values
        return everyone.tolist()

    gain = np.exp(found.log_gain)
    return Side(
        nominal_m=nominal_m.tolist(),
        gain=all_of(np.column_stack([gain.real, gain.imag]), 0.0),
        delay_m=all_of(found.delay_m, 0.0),
        offset_m=all_of(found.offset_m, 0.0),
        level_sigma=all_of(level_sigma, 1.0),
        phase_sigma_rad=all_of(phase_sigma, np.pi),
        delay_sigma_m=all_of(delay_sigma_m, prior.DELAY_SIGMA_M),
        offset_sigma_m=all_of(np.stack(offset_sigma_m, axis=1), prior.POSITION_SIGMA_M),
    )
