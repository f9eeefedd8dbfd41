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
    range_period_m,
)
from handbench.radar.data.capture import RadarCapture, even_subset, scaled_to_one
from handbench.support.config import Config, parse
from handbench.support.errors import HandbenchError
from handbench.support.files import read_json

Unknown = Literal["range_offset", "scan_step"]  # what echoes tell of the instrument
SAME_M = 1e-5  # vectors from transmitter to receiver that agree to this are those of one element
MOST_CHANNELS = 256  # from which is estimated
SOME_TONES = 4  # of the first images
DISTANCES_M = 2 ** np.linspace(-4, 2, 31)  # of the brightest point
TWICE = 5  # of these further, the distance is twice as large
TANGENTS = np.linspace(-0.6, 0.6, 101)  # of the brightest point's direction
HALF = 0.5  # of the power is explained at least; sharpness elsewhere at most


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
        raise HandbenchError("scan_step: is of an array that does not move; remove it")
    tx_m, rx_m = channel_ends(aperture)
    vectors = np.rint((rx_m - tx_m) / SAME_M)
    _, element, stops = np.unique(vectors, axis=0, return_inverse=True, return_counts=True)
    means_m = [np.bincount(element.ravel(), axis) / stops for axis in tx_m.T]
    return tx_m - np.transpose(means_m)[element.ravel()]


def from_echoes(capture: RadarCapture, unknown: Sequence[Unknown]) -> Corrections:
    """Estimate what is unknown of an instrument from the sharpness of the first frame's image.

    The path over a point p bends over the aperture by its distance and by the scan's step, so the
    image of a tone is sharp where the bend is right, whatever the range offset o; the path's length
    then tells o, or the step. From there, the value is taken with which one point explains the
    largest share of the echoes' power:

        |Σ s(f, t, r) exp(+j2πf(|p − t| + |p − r| + 2o)/c)|² / (N Σ |s|²)

    unknown: one of them, since one point does not tell both. Raises HandbenchError if that share is
    less than half, and if the image is more than half as sharp at half or twice the distance.
    """
    # not needed to apply corrections
    from scipy.optimize import least_squares

    from handbench.radar.imaging.api import image_points

    tones_hz = capture.vacuum_hz
    samples = capture.samples[0].reshape(len(tones_hz), -1)
    live = np.flatnonzero(samples.any(axis=0))
    if len(unknown) != 1 or np.ptp(tones_hz) == 0 or len(live) == 0:
        raise HandbenchError(
            f"unknown: is {list(unknown)} with {len(tones_hz)} tones of {len(live)} channels; "
            "expected range_offset or scan_step in capture.toml, and echoes of several tones"
        )
    stretched = "scan_step" in unknown
    tx_m, rx_m = channel_ends(capture.aperture)
    moves_m = scan_moves_m(capture.aperture) if stretched else 0 * tx_m
    some = np.random.default_rng(0).permutation(live)[:MOST_CHANNELS]
    samples = scaled_to_one(samples[:, some])
    tones = even_subset(len(tones_hz), SOME_TONES)
    pairs = AntennaPairs(tx_m[some], rx_m[some])
    waves = 2j * np.pi / SPEED_OF_LIGHT_M_S * tones_hz

    def unexplained(values: np.ndarray) -> np.ndarray:
        offset_m, step = (0, values[0]) if stretched else (values[0], 1)
        away_m = values[1:] - (step - 1) * moves_m[some]
        lengths_m = sum(np.linalg.norm(away_m - end_m, axis=1) for end_m in channel_ends(pairs))
        point = np.exp(-np.outer(waves, lengths_m + 2 * offset_m))
        return (samples - point * np.vdot(point, samples) / point.size).ravel().view(np.float64)

    x, y = (axis.ravel() for axis in np.meshgrid(TANGENTS, TANGENTS))
    towards = np.stack([x, y, np.ones_like(x)], axis=1) / np.sqrt(1 + x**2 + y**2)[:, None]
    points_m = (tx_m + rx_m).mean(axis=0) / 2 + DISTANCES_M[:, None, None] * towards
    image = image_points(samples[tones], tones_hz[tones], pairs, points_m, None, True)
    power = (np.abs(image) ** 2).sum(axis=0)
    sharpness = power.max(axis=1)
    best = int(sharpness.argmax())
    point_m = points_m[best, power[best].argmax()]
    image = image_points(samples, tones_hz, pairs, point_m[None], None, True)[:, 0]
    offsets_m = range_period_m(tones_hz) * np.linspace(-0.5, 0.5, 1024)
    offset_m = offsets_m[np.abs(np.exp(2 * np.outer(offsets_m, waves)) @ image).argmax()]
    start = offset_m, *point_m
    if stretched:
        farther = max(1 + offset_m / DISTANCES_M[best], 0.01)
        start = np.sqrt(farther), *farther * point_m
    fit = least_squares(unexplained, start, x_scale="jac")
    explained = 1 - 2 * fit.cost / np.linalg.norm(samples) ** 2
    elsewhere = np.take(sharpness, [best - TWICE, best + TWICE], mode="clip").max()
    if explained < HALF or elsewhere > HALF * sharpness[best]:
        raise HandbenchError(
            f"echoes: do not tell {unknown[0]}; one point explains {100 * explained:.0f} %, half "
            f"or twice its distance {100 * elsewhere / sharpness[best]:.0f} % of that; record one "
            "small metal ball before a wide aperture, and subtract the background"
        )
    name = "scan_step" if stretched else "range_offset_m"
    return parse(Corrections, {name: float(fit.x[0])}, "echoes")
