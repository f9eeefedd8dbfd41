"""Least-squares estimate of an array's gains, phases and delays from the echoes of the calibration
target:

    s[f, t, r] ≈ a_t(f) · b_r(f) · Σ_i c_i · e_i[f, t, r]
    a_t(f) = a_t · exp(−j(k − k₀)·d_t), and likewise b_r(f)

with the echoes e_i of the target's balls (Mie's series), their complex strengths c_i, the gains
a_t, b_r at the middle of the sweep (wavenumber k₀) and the delays d_t, d_r. For balls at known
places each of c, a and b has a closed form for given others (alternating least squares). The balls
are found again with the calibrated array.

No echo determines the mean level, phase and delay of all transmitters, nor those of all receivers,
and a phase that changes linearly over the aperture looks almost like a motion of the target. The
means are 0; the motion is small and the same for all images.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from handbench.calibration.array_file import ArrayCalibration
from handbench.calibration.ball_fit import fit_balls, mimo_array
from handbench.calibration.radar_detection import find_balls
from handbench.calibration.target import Candidate, Target, match
from handbench.calibration.transforms import umeyama
from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.radar.data.capture import RadarCapture
from handbench.radar.simulation.spheres import sphere_echo
from handbench.support.config import parse
from handbench.support.errors import HandbenchError

SWEEPS = 20  # of alternating least squares
WEAKEST = 0.1  # antennas whose gain is less than this share of the median are dead
# a ball is stronger than the foam and than the side lobes of an imperfect array
THRESHOLD_DB = -10.0
# distance of a ball from its described place, in standard deviations of the target's manufacture
FARTHEST_SIGMAS = 4.0
LEAST_SIGMA_M = 5e-5  # of the manufacture
TINY = 1e-15  # below any gain
# Gains [n], delays_m [n], and information on the delays times the noise's variance [n]: Σ|m|²(k −
# k̄)² of the model m of their samples
Fit = tuple[np.ndarray, np.ndarray, np.ndarray]


def estimate_array(
    capture: RadarCapture, target: Target, source: str = "target capture"
) -> ArrayCalibration:
    """Estimate the calibration of an array from the echoes of a target at rest, whose frames are
    averaged: gain, phase and delay of each antenna.

    source: name of the capture, for the result and for messages. Raises HandbenchError for a planar
    scan, if a ball is not found, if something else echoes as strongly as a ball, and if the balls
    are not where the target's description has them.
    """
    mean = replace(capture, samples=capture.samples.mean(axis=0, keepdims=True), frame_times_s=None)
    balls = match(find_balls(mean, target, THRESHOLD_DB), target, "echoes")
    missing = [i + 1 for i in range(len(target.element)) if i not in balls]
    if missing:
        raise HandbenchError(
            f"{source}: does not show all elements of the target (missing: {missing}), "
            "but an array calibration needs all; check the target's description and place"
        )
    first = _fit_responses(mean, target, _placed(target, balls), source)
    balls = _fitted_balls(first.applied_to(mean), target, source)
    return _fit_responses(mean, target, _placed(target, balls), source)


def _fitted_balls(calibrated: RadarCapture, target: Target, source: str) -> dict[int, Candidate]:
    """Fit the target's balls to calibrated echoes. Raises HandbenchError if these show another
    thing as strong as a ball, or a ball that is not at its described place."""
    echoes = find_balls(calibrated, target, THRESHOLD_DB)
    balls = match(echoes, target, "echoes")
    for other in echoes:
        if all(np.any(other.peak_m != ball.peak_m) for ball in balls.values()):
            raise HandbenchError(
                f"{source}: something at {other.centre_m.round(3)} m echoes as strongly as a "
                "ball; remove it from the view, and check the description of the target"
            )
    balls = fit_balls(calibrated, target, balls, echoes)
    placed_m = _placed(target, balls)
    off_m = np.array([np.linalg.norm(ball.centre_m - placed_m[i]) for i, ball in balls.items()])
    limit_m = FARTHEST_SIGMAS * max(target.ball_offset_sigma_m, LEAST_SIGMA_M)
    if off_m.max() > limit_m:
        raise HandbenchError(
            f"{source}: element {[*balls][off_m.argmax()] + 1} of the target is "
            f"{1e3 * off_m.max():.2f} mm away from its place in the description; expected less "
            f"than {1e3 * limit_m:.2f} mm; measure the target again"
        )
    return balls


def _placed(target: Target, balls: Mapping[int, Candidate]) -> np.ndarray:
    """Return the centres [i, 3] of all balls as described, moved by the rigid motion that fits the
    measured ones best."""
    described_m = target.centres_m + target.ball_offsets_m
    pose = umeyama(described_m[list(balls)], np.array([b.centre_m for b in balls.values()]))
    return described_m @ pose[:3, :3].T + pose[:3, 3]


def _fit_responses(
    capture: RadarCapture, target: Target, centres_m: np.ndarray, source: str
) -> ArrayCalibration:
    """Fit the responses of all antennas to a capture's only frame, with the balls at centres_m
    [i, 3], by alternating least squares."""
    samples, f_hz, array = capture.samples[0], capture.frequencies_hz, mimo_array(capture)
    reference_hz = float(f_hz.mean())
    k = 2 * np.pi * (f_hz[:, None] - reference_hz) / SPEED_OF_LIGHT_M_S
    echoes = np.array(
        [
            sphere_echo(c, e.ball_radius_m, delay_m, f_hz, array)
            for c, e, delay_m in zip(centres_m, target.element, target.foam_delay_m, strict=True)
        ]
    )
    tx, rx = ((np.ones(n), np.zeros(n), np.ones(n)) for n in array.channels)
    for _ in range(SWEEPS):
        a, b = _response(tx, k)[:, :, None], _response(rx, k)[:, None]
        of_balls = (echoes * (a * b)).reshape(len(echoes), -1)
        strengths = np.linalg.solve(of_balls.conj() @ of_balls.T, of_balls.conj() @ samples.ravel())
        balls = np.tensordot(strengths.astype(np.complex64), echoes, 1)
        tx = _fit(samples, balls * b, tx[1], k)
        a = _response(tx, k)[:, :, None]
        rx = _fit(samples.swapaxes(1, 2), (balls * a).swapaxes(1, 2), rx[1], k)
    rest = samples - balls * a * _response(rx, k)[:, None]
    noise = np.mean(np.abs(rest) ** 2) / 2  # per real and imaginary part
    sides = [
        _side(leg.position_m, one, noise) for leg, one in zip(array.legs, (tx, rx), strict=True)
    ]
    values = {"source": source, "reference_hz": reference_hz, "tx": sides[0], "rx": sides[1]}
    return parse(ArrayCalibration, values, source)


def _response(fit: Fit, k: np.ndarray) -> np.ndarray:
    """Compute the responses at the wavenumbers k [f, 1], relative to the reference: complex64
    [f, n]."""
    gains, delays_m, _ = fit
    return (gains * np.exp(-1j * k * delays_m)).astype(np.complex64)


def _fit(samples: np.ndarray, model: np.ndarray, delays_m: np.ndarray, k: np.ndarray) -> Fit:
    """Fit the responses of n antennas to samples [f, n, m], by one Gauss–Newton step from given
    delays_m [n]. model [f, n, m]: the samples for responses of 1; k [f, 1]: wavenumbers."""
    power = np.einsum("fnm,fnm->fn", model, model.conj()).real
    seen = np.einsum("fnm,fnm->fn", samples, model.conj()) * np.exp(1j * k * delays_m)
    energy = power.sum(axis=0)
    centred_k = k - (k * power).sum(axis=0) / energy
    energy_k2 = (power * centred_k**2).sum(axis=0)
    gains = seen.sum(axis=0) / energy
    slopes = (centred_k * seen).sum(axis=0) * gains.conj()
    information = energy_k2 * np.maximum(np.abs(gains), TINY) ** 2
    return gains, delays_m - slopes.imag / information, information


def _side(nominal_m: np.ndarray, fit: Fit, noise: float) -> dict[str, Any]:
    """Convert the fit of the transmitters, or of the receivers, to the values of a `Side`:
    with the mean log level, phase and delay 0 over the antennas that work. Their delays are shrunk
    by the share of noise in their variance (James–Stein). noise: variance of a sample's real part.
    """
    gains, delays_m, information = fit
    level = np.maximum(np.abs(gains), TINY)
    live = level > WEAKEST * np.median(level[level > WEAKEST * level.max()])
    phase = (gains / level)[live].mean()
    gains = gains * np.exp(-np.log(level[live]).mean()) * phase.conj() / np.abs(phase)
    delays_m = delays_m - delays_m[live].mean()
    variance_m2 = (noise / information)[live].mean()
    share = 1 - min(1.0, variance_m2 / max(delays_m[live].var(), TINY**2))
    return dict(
        nominal_m=nominal_m.tolist(),
        gain=np.where(live, [gains.real, gains.imag], 0.0).T.tolist(),
        delay_m=np.where(live, share * delays_m, 0.0).tolist(),
    )
