"""The depth at which FSK methods begin, from the echoes themselves: `first_depth_m = "auto"` is the
strongest peak of the range profile."""

from __future__ import annotations

from typing import TypeVar

import numpy as np

from handbench.radar.data.arrays import (
    SPEED_OF_LIGHT_M_S,
    channel_ends,
    range_cell_m,
    range_period_m,
)
from handbench.radar.data.capture import RadarCapture, even_subset, scaled_to_one
from handbench.radar.methods.fsk_config import FskConfig
from handbench.support.errors import HandbenchError

ENOUGH = 8  # tones from which a range profile tells depths apart
PROFILED = 256  # channels, evenly chosen, whose profiles are summed
NEAREST_M, FARTHEST_M = 0.05, 10.0  # depths that are considered
LENGTHS = 500  # of paths whose waves are held at once
STANDS_OUT = 6.0  # standard deviations of a profile of noise that a peak exceeds
AS_HIGH = 0.8  # of peaks of the profile that differ by less, 1 dB, the nearest one is taken

Fsk = TypeVar("Fsk", bound=FskConfig)


def with_first_depth(capture: RadarCapture, config: Fsk, frame: int = 0) -> Fsk:
    """Return a configuration whose first_depth_m is a number: where it is "auto", the depth of the
    strongest target in a frame. Raises HandbenchError if the tones are too few for a range profile,
    or no echo stands out in it."""
    if isinstance(config.first_depth_m, float):
        return config
    count = len(np.unique(capture.frequencies_hz))
    if count < ENOUGH:
        raise HandbenchError(
            f"first_depth_m: is 'auto', but the capture has {count} tones, and a range profile "
            f"needs {ENOUGH}; give the target's distance in metres"
        )
    found_m = first_depth_m(capture, frame)
    if found_m is None:
        raise HandbenchError(
            f"first_depth_m: is 'auto', but in frame {frame} no echo stands out from the noise; "
            "give the target's distance in metres"
        )
    return config.model_copy(update={"first_depth_m": found_m})


def first_depth_m(capture: RadarCapture, frame: int = 0) -> float | None:
    """Find the depth of the strongest target in a frame, metres; None for fewer than ENOUGH tones,
    or if no echo stands out from the noise.

    It is the depth of the highest peak of the echoes' power over depth, or of the nearest that is
    nearly as high: a few tones beside an even sweep hardly tell its periods apart. An echo's path
    is taken to lead over the point straight before the middle of its two antennas.
    """
    tones_hz = np.unique(capture.frequencies_hz)
    if len(tones_hz) < ENOUGH or not capture.samples[frame].any():
        return None
    samples, waves_hz = capture.tones(tones_hz, frame)
    index = np.flatnonzero(samples.any(axis=0).ravel())
    index = index[even_subset(len(index), PROFILED)]
    samples = scaled_to_one(samples.reshape(len(tones_hz), -1)[:, index])
    tx_m, rx_m = (place_m[index] for place_m in channel_ends(capture.aperture))
    cell_m = range_cell_m(waves_hz)
    end_m = min(range_period_m(waves_hz), FARTHEST_M)
    depths_m = np.arange(NEAREST_M, max(end_m, NEAREST_M + cell_m), cell_m / 4)
    before_m = (tx_m + rx_m) / 2 + np.multiply.outer(depths_m, [0, 0, 1])[:, None]
    paths_m = np.linalg.norm(before_m - tx_m, axis=2) + np.linalg.norm(before_m - rx_m, axis=2)
    power = _power(samples, waves_hz, paths_m, cell_m / 4).sum(axis=1)
    # what leaks from transmitter to receiver falls from the first depth on, and is no peak
    inner = power[1:-1]
    peaks = 1 + np.flatnonzero((inner >= power[:-2]) & (inner > power[2:]))
    if not len(peaks):
        return None
    best = peaks[power[peaks] >= AS_HIGH * power[peaks].max()][0]
    if power[best] < np.median(power) * (1 + STANDS_OUT / np.sqrt(len(index))):
        return None
    return float(depths_m[best])


def _power(
    samples: np.ndarray, waves_hz: np.ndarray, paths_m: np.ndarray, step_m: float
) -> np.ndarray:
    """Power |Σ_f s_f exp(2πi f p/c)|² of each channel's samples [f, n] at its paths p [z, n]. It is
    computed at path lengths step_m apart, and linear in between."""
    first_m = paths_m.min()
    lengths_m = first_m + step_m * np.arange(3 + np.ptp(paths_m) // step_m)
    parts = np.array_split(lengths_m, 1 + len(lengths_m) // LENGTHS)
    waves = (np.multiply.outer(part / SPEED_OF_LIGHT_M_S, waves_hz) for part in parts)
    at_lengths = np.concatenate([np.abs(np.exp(2j * np.pi * w) @ samples) ** 2 for w in waves])
    after, below = np.modf((paths_m - first_m) / step_m)
    low, high = (np.take_along_axis(at_lengths, below.astype(int) + i, axis=0) for i in (0, 1))
    return low + after * (high - low)
