"""Range offset or scan step of an instrument, estimated from a capture's own echoes: the file
`corrections.json`."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from handbench.radar.data.arrays import (
    SPEED_OF_LIGHT_M_S,
    AntennaArray,
    AntennaPairs,
    Aperture,
    channel_ends,
    range_cell_m,
    range_period_m,
)
from handbench.radar.data.capture import RadarCapture
from handbench.support.config import Config, parse
from handbench.support.errors import HandbenchError
from handbench.support.files import read_json
from handbench.support.points import mean_by, voxels

Unknown = Literal["range_offset", "scan_step"]  # what echoes tell of the instrument
SAME_M = 1e-5  # vectors from transmitter to receiver that agree to this are those of one element
MOST = 256  # tones and channels from which is estimated
FINE = 32  # steps of a range profile in a range cell
NEAR_M = 1e-3  # peaks farther from their fit count less
HALF = 0.5  # largest share of the power that the point may leave unexplained
FARTHER = np.array([1, 2, 2, 2])  # of the value and the place of a point at twice the distance
LEAST_BEND = 1 / 16  # of the range from there, in wavelengths: half the power then remains


class Corrections(Config):
    """The content of `corrections.json`.

    range_offset_m: by how much every target appears too far away, since the instrument and its
    cables delay the echo. scan_step: factor of the distances between the stops of a scan.
    """

    range_offset_m: float = Field(default=0.0, ge=-1e3, le=1e3)
    scan_step: float = Field(default=1.0, ge=0.1, le=10)

    def applied_to(self, capture: RadarCapture) -> RadarCapture:
        """Return a capture with the samples s·exp(+j4πf·offset/c), whose scan has the true step.
        Raises HandbenchError for the step of an array."""
        aperture = capture.aperture
        if self.scan_step != 1:
            moves_m = (self.scan_step - 1) * scan_moves_m(aperture)
            aperture = AntennaPairs(*(end_m + moves_m for end_m in channel_ends(aperture)))
        turns = 2 * capture.vacuum_hz * self.range_offset_m / SPEED_OF_LIGHT_M_S
        phases = np.exp(2j * np.pi * turns).reshape(-1, *[1] * len(aperture.channels))
        samples = (capture.samples * phases).astype(np.complex64)
        return replace(capture, samples=samples, aperture=aperture)


def with_corrections(capture: RadarCapture, file: Path) -> tuple[RadarCapture, str]:
    """Apply the corrections in `file` to a capture: (new capture, message about what was applied).
    Without the file: (the same capture, "")."""
    if not file.exists():
        return capture, ""
    corrections = parse(Corrections, read_json(file, "corrections of a capture"), str(file))
    return corrections.applied_to(capture), f"{file}: applied: {corrections}"


def scan_moves_m(aperture: Aperture) -> np.ndarray:
    """Return how far each channel [n, 3] is from its element's mean place, metres: channels with
    the same vector from transmitter to receiver are one element at several stops. Raises
    HandbenchError for an array."""
    if isinstance(aperture, AntennaArray):
        raise HandbenchError("scan_step: an array that does not move has none; leave it out")
    element = voxels(aperture.rx_m - aperture.tx_m, SAME_M, 0.5)
    return aperture.tx_m - mean_by(element, aperture.tx_m)[element]


def from_echoes(capture: RadarCapture, unknown: Sequence[Unknown]) -> Corrections:
    """Estimate what is unknown of an instrument from the first frame of a capture of one point.

    Over the aperture, the path to the point p bends by its distance and by the scan's step,
    whatever the range offset o; the path's length then tells o, or the step. The peaks of the
    channels' range profiles give a first p and value. From there, the value is taken with which one
    point explains the largest share of the echoes' power:

        |Σ s(f, t, r) exp(+j2πf(|p − t| + |p − r| + 2o)/c)|² / (N Σ |s|²)

    unknown: one of them, since one point does not tell both. Raises HandbenchError if that share is
    less than half, and if the path bends too little to tell the distance from twice as much.
    """
    from scipy.optimize import least_squares  # not needed to apply corrections

    tones_hz = capture.vacuum_hz
    samples = capture.samples[0].reshape(len(tones_hz), -1).astype(complex)
    heard, live = (np.flatnonzero(samples.any(axis=axis)) for axis in (1, 0))
    if len(unknown) != 1 or np.ptp(tones_hz) == 0 or len(live) == 0:
        raise HandbenchError(
            f"unknown: is {' and '.join(unknown) or 'empty'}, and {len(live)} channels have "
            "echoes; expected one of range_offset and scan_step in capture.toml, and echoes of "
            "several tones"
        )
    stretched = "scan_step" in unknown
    tones, some = (np.random.default_rng(0).permutation(n)[:MOST] for n in (heard, live))
    samples = samples[tones][:, some]
    # each tone counts as much: the strongest alone would tell no range
    samples /= np.linalg.norm(samples, axis=1, keepdims=True) * np.sqrt(len(samples))
    waves = 4j * np.pi / SPEED_OF_LIGHT_M_S * tones_hz[tones]
    ends_m = np.array(channel_ends(capture.aperture))[:, some]
    moves_m = scan_moves_m(capture.aperture)[some] if stretched else 0

    def ranges_m(values: np.ndarray) -> np.ndarray:
        away_m = ends_m + values[0] * moves_m - values[1:]
        return np.linalg.norm(away_m, axis=2).mean(axis=0) + values[0] * (not stretched)

    def unexplained(values: np.ndarray) -> np.ndarray:
        echo = np.exp(-np.outer(waves, ranges_m(values)))
        return (samples - echo * np.vdot(echo, samples) / echo.size).ravel().view(float)

    period_m = range_period_m(tones_hz)
    profile_m = np.arange(0, period_m, range_cell_m(tones_hz) / FINE)
    peaks = np.abs(np.exp(np.outer(profile_m, waves)) @ samples).argmax(axis=0)
    peaks_m = np.unwrap(profile_m[peaks], period=period_m)
    start = [0, 0, 0, peaks_m.mean()]
    near = least_squares(lambda v: ranges_m(v) - peaks_m, start, loss="soft_l1", f_scale=NEAR_M)
    fit = least_squares(unexplained, near.x, x_scale="jac")
    bend_m = np.std(ranges_m(fit.x) - ranges_m(fit.x * FARTHER))
    if 2 * fit.cost > HALF or bend_m < LEAST_BEND * SPEED_OF_LIGHT_M_S / tones_hz.max():
        raise HandbenchError(
            f"echoes: do not tell {unknown[0]}; one point explains {100 - 200 * fit.cost:.0f} %, "
            f"and its range bends by {1e3 * bend_m:.2g} mm; record one small metal ball before a "
            "wide aperture, and subtract the background"
        )
    if stretched:
        return parse(Corrections, {"scan_step": 1 + fit.x[0]}, "echoes")
    return Corrections(range_offset_m=np.unwrap([0, fit.x[0]], period=period_m)[1])
