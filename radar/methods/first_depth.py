"""The depth at which FSK methods begin, from the echoes themselves: `first_depth_m = "auto"` is the
strongest peak of the range profile."""

from __future__ import annotations

import numpy as np

from handbench.radar.data.arrays import (
    SPEED_OF_LIGHT_M_S,
    channel_ends,
    range_cell_m,
    range_period_m,
)
from handbench.radar.data.capture import RadarCapture, even_subset, scaled_to_one
from handbench.support.errors import HandbenchError

ENOUGH = 8  # tones from which a range profile tells depths apart
PROFILED = 256  # channels, evenly chosen, whose profiles are summed
NEAREST_M = 0.05  # first depth that is considered
FARTHEST_M = 10.0  # last depth that is considered
LENGTHS = 500  # of paths whose waves are held at once
STANDS_OUT = 6.0  # standard deviations of a profile of noise that a peak exceeds
AS_HIGH = 0.8  # of peaks of the profile that differ by less, 1 dB, the nearest one is taken


def first_depth_m(capture: RadarCapture, frame: int = 0) -> float:
    """Find the depth of the strongest target in a frame, metres. Raises HandbenchError for fewer
    than ENOUGH tones, or if no echo stands out from the noise.

    It is the highest peak of the range profile P(z) = Σ_n |Σ_f S_f,n exp(j2πf R_n(z)/c)|² over the
    channels n, or the nearest that is nearly as high: a few tones beside an even sweep hardly tell
    its periods apart. R_n leads over the point straight before the middle of the two antennas.
    """
    tones_hz = np.unique(capture.frequencies_hz)
    if len(tones_hz) < ENOUGH:
        raise HandbenchError(
            f"first_depth_m: is 'auto', but the capture has {len(tones_hz)} tones, and a range "
            f"profile needs {ENOUGH}; give the target's distance in metres"
        )
    silence = HandbenchError(
        f"first_depth_m: is 'auto', but in frame {frame} no echo stands out from the noise; give "
        "the target's distance in metres"
    )
    samples, hz = capture.tones(tones_hz, frame)
    samples = samples.reshape(len(hz), -1)
    live = np.flatnonzero(samples.any(axis=0))
    if not len(live):
        raise silence
    live = live[even_subset(len(live), PROFILED)]
    samples, cell_m = scaled_to_one(samples[:, live]), range_cell_m(hz)
    tx_m, rx_m = (antennas_m[live] for antennas_m in channel_ends(capture.aperture))
    end_m = max(min(range_period_m(hz), FARTHEST_M), NEAREST_M + cell_m)
    depths_m = np.arange(NEAREST_M, end_m, cell_m / 4)
    points_m = (tx_m + rx_m) / 2 + np.multiply.outer(depths_m, [0, 0, 1])[:, None]
    paths_m = np.linalg.norm(points_m - tx_m, axis=2) + np.linalg.norm(points_m - rx_m, axis=2)
    # computed at path lengths a quarter of a cell apart, and linear in between
    lengths_m = np.arange(paths_m.min(), paths_m.max() + cell_m / 4, cell_m / 4)
    turns = np.multiply.outer(lengths_m / SPEED_OF_LIGHT_M_S, hz)
    parts = np.array_split(turns, 1 + len(turns) // LENGTHS)
    at_lengths = np.concatenate([np.abs(np.exp(2j * np.pi * t) @ samples) ** 2 for t in parts])
    each = zip(paths_m.T, at_lengths.T, strict=True)
    power = np.sum([np.interp(path_m, lengths_m, p) for path_m, p in each], axis=0)
    # what leaks from transmitter to receiver falls from the first depth on, and is no peak
    inner = power[1:-1]
    peaks = 1 + np.flatnonzero((inner >= power[:-2]) & (inner > power[2:]))
    noise = np.median(power) * (1 + STANDS_OUT / np.sqrt(len(live)))
    if power[peaks].max(initial=0.0) < noise:
        raise silence
    return float(depths_m[peaks[power[peaks] >= AS_HIGH * power[peaks].max()][0]])
