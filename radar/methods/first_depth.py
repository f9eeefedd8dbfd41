"""The depth at which FSK methods begin, from the echoes themselves: `first_depth_m = "auto"`.

With enough tones it is the strongest peak of the range profile. With fewer, two close tones leave
depths that are c/2Δf apart, and the plane whose image is sharpest is taken.
"""

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
from handbench.radar.methods.fsk_config import FskConfig, TwoToneConfig
from handbench.support.errors import HandbenchError

ENOUGH = 8  # tones from which a range profile tells depths apart
PROFILED = 256  # channels, evenly chosen, whose profiles are summed
NEAREST_M, FARTHEST_M = 0.05, 10.0  # depths that are considered
LENGTHS = 500  # of paths whose waves are held at once
STANDS_OUT = 6.0  # standard deviations of a profile of noise that a peak exceeds
LEAST_COHERENCE = 0.5  # of the images of a target at two close tones; noise has less
STRONGEST = 200  # pixels that show the coherence
BEGUN_M = 0.45  # depth of the plane by which the others are found, or nearer
MOST_PLANES = 40  # that are compared
AS_HIGH = 0.8  # of peaks of the profile that differ by less, 1 dB, the nearest one is taken
AS_SHARP = 0.99  # of two planes with peaks that differ by less, the nearer one is taken

Fsk = TypeVar("Fsk", bound=FskConfig)


def with_first_depth(capture: RadarCapture, config: Fsk, frame: int = 0) -> Fsk:
    """Return a configuration whose first_depth_m is a number: where it is "auto", the depth of the
    strongest target in a frame. Raises HandbenchError if no echo stands out there."""
    if isinstance(config.first_depth_m, float):
        return config
    found_m = first_depth_m(capture, config, frame)
    if found_m is None:
        raise HandbenchError(
            f"first_depth_m: is 'auto', but in frame {frame} no echo stands out from the noise; "
            "give the target's distance in metres"
        )
    return config.model_copy(update={"first_depth_m": found_m})


def first_depth_m(capture: RadarCapture, config: FskConfig, frame: int = 0) -> float | None:
    """Find the depth of the strongest target in a frame, metres; None if no echo stands out from
    the noise. config: gives the pixels of the images that are compared, where tones are few."""
    tones_hz = np.unique(capture.frequencies_hz)
    if len(tones_hz) < 2 or not capture.samples[frame].any():
        return None
    found = _by_range_profile if len(tones_hz) >= ENOUGH else _by_sharpness
    return found(capture, config, frame, tones_hz)


def _by_range_profile(
    capture: RadarCapture, config: FskConfig, frame: int, tones_hz: np.ndarray
) -> float | None:
    """Depth of the highest peak of the echoes' power over depth, or of the nearest that is nearly
    as high: a few tones beside an even sweep hardly tell its periods apart. An echo's path is taken
    to lead over the point straight before the middle of its two antennas."""
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


def _by_sharpness(
    capture: RadarCapture, config: FskConfig, frame: int, tones_hz: np.ndarray
) -> float | None:
    """Depth of the sharpest of the planes that the two closest tones cannot tell apart."""
    from handbench.radar.methods.fsk import FskStep, Tones, depth_step_m

    first = int(np.diff(tones_hz).argmin())
    samples, waves_hz = capture.tones(tones_hz[first : first + 2], frame)
    two = TwoToneConfig(x=config.x, y=config.y, tolerance=config.tolerance)
    pair, grid = Tones(scaled_to_one(samples), waves_hz, capture.aperture, two), config.grid()

    def strongest(plane: FskStep, count: int) -> np.ndarray:
        return plane.images[:, np.argsort(plane.amplitude.ravel())[-count:]]

    def coherence(plane: FskStep) -> float:
        a, b = strongest(plane, STRONGEST)
        return float(np.abs(np.vdot(a, b)) / (np.linalg.norm(a) * np.linalg.norm(b)))

    def corrected_m(plane: FskStep) -> float:
        a, b = strongest(plane, 1)
        return float(plane.formed_m + depth_step_m(b, a, waves_hz[1] - waves_hz[0])[0])

    period_m = range_period_m(waves_hz)
    begun_m = corrected_m(pair.plane(grid, min(period_m / 2, BEGUN_M)))
    depths_m = begun_m + period_m * np.arange(
        np.ceil((NEAREST_M - begun_m) / period_m), MOST_PLANES
    )
    planes = [pair.plane(grid, depth_m) for depth_m in depths_m if depth_m < FARTHEST_M]
    peaks = np.array([plane.amplitude.max() for plane in planes])
    sharpest = planes[np.flatnonzero(peaks >= AS_SHARP * peaks.max())[0]]
    return corrected_m(sharpest) if coherence(sharpest) > LEAST_COHERENCE else None
