"""The conversion of samples of any layout to a `RadarCapture`."""

from typing import Any

import numpy as np

from handbench.radar.data.arrays import AntennaArray, AntennaPairs, Aperture, positions, tones
from handbench.radar.data.capture import RadarCapture, as_complex64
from handbench.support.cost import require_memory
from handbench.support.errors import HandbenchError

# An array with more than this many times the measured pairs becomes a list of pairs.
SPARSE = 8


def to_capture(
    samples: np.ndarray,
    frequencies_hz: np.ndarray,
    places_m: dict[str, np.ndarray],
    pairs: np.ndarray | None = None,
    gains: np.ndarray | None = None,
    sweeps: str | None = None,
    **fields: Any,
) -> RadarCapture:
    """Convert the numbers in a capture file of any layout to a `RadarCapture`. Channels that were
    not measured are left out (of a scan or list of pairs) or set to 0 (of an array).

    samples: [frame, frequency, …], last axes (tx, rx), (pair,) or (position,); a channel that was
    not measured is NaN throughout. places_m: antenna positions by name, either tx_m and rx_m or
    position_m, [n, 3] each, metres. pairs [n, 2]: indices of the transmitter and the receiver of
    each pair, from 0. gains: complex [channels] or [frequency, channels]; samples are divided by
    them, and 0 or NaN marks a dead channel. sweeps: of samples [frame, sweep, frequency, …], "mean"
    to average the sweeps, "frames" to make each a frame. fields: further ones of the capture.
    Raises HandbenchError for numbers that do not fit together, and if no channel was measured.
    """
    tones("frequencies_hz", frequencies_hz)
    ends_m = [positions(name, place_m) for name, place_m in places_m.items()]
    channels = tuple(map(len, ends_m))
    if pairs is not None:
        _check_pairs(pairs, *channels)
        channels = (len(pairs),)
    expected = len(frequencies_hz), *channels
    first = ["frame", "sweep"] if sweeps else ["frame"]
    if samples.size == 0 or samples.shape[len(first) :] != expected:
        axes = ", ".join(map(str, (*first, *expected)))
        raise HandbenchError(
            f"samples: have shape {samples.shape}; expected [{axes}] from the numbers of "
            "frequencies and antennas"
        )
    if gains is not None and gains.shape not in (expected, channels):
        raise HandbenchError(
            f"gains: have shape {gains.shape}; expected {channels}, or {expected} with gains for "
            "each tone"
        )
    missing = np.isnan(samples).all(axis=tuple(range(len(first) + 1)))
    with np.errstate(invalid="ignore", over="ignore"):  # RadarCapture refuses infinite samples
        if sweeps == "mean":
            samples = samples.mean(axis=1, dtype=np.complex128)
        samples = samples.reshape(-1, *expected)
        if gains is not None:
            alive = np.isfinite(gains) & (gains != 0)
            samples = samples / np.where(alive, gains, 1)
            missing |= ~(alive if gains.shape == channels else alive.all(axis=0))
        samples = as_complex64(np.where(missing, 0, samples) if missing.any() else samples)
    if missing.all():
        raise HandbenchError(
            "samples: all are NaN, so no channel was measured; give numbers for the measured "
            "channels and NaN for the others"
        )
    aperture: Aperture
    if len(ends_m) == 1:
        places = ends_m[0][~missing]
        samples, aperture = samples[..., ~missing], AntennaPairs(places, places)
    elif pairs is None:
        aperture = AntennaArray(ends_m[0], ends_m[1], ~missing)
    else:
        t, r = pairs[~missing].T.astype(np.intp)
        samples, aperture = _of_pairs(samples[..., ~missing], t, r, *ends_m)
    return RadarCapture(samples, frequencies_hz, aperture, **fields)


def _of_pairs(
    samples: np.ndarray, t: np.ndarray, r: np.ndarray, tx_m: np.ndarray, rx_m: np.ndarray
) -> tuple[np.ndarray, Aperture]:
    """Convert samples [frame, f, n] of antenna pairs to those of an array: (samples [frame, f, t,
    r], which are 0 for pairs that were not measured, and the `AntennaArray`).

    t, r [n]: indices of each pair's transmitter and receiver. If few of all possible pairs were
    measured, the result is (unchanged samples, `AntennaPairs`).
    """
    if len(tx_m) * len(rx_m) > SPARSE * len(t):
        return samples, AntennaPairs(tx_m[t], rx_m[r])
    shape = (*samples.shape[:2], len(tx_m), len(rx_m))
    require_memory(
        8 * float(np.prod(shape)),
        f"samples: {shape}",
        "close other programs, or cut the file into parts",
    )
    filled, measured = np.zeros(shape, np.complex64), np.zeros(shape[2:], bool)
    filled[:, :, t, r], measured[t, r] = samples, True
    return filled, AntennaArray(tx_m, rx_m, measured)


def _check_pairs(pairs: np.ndarray, n_tx: int, n_rx: int) -> None:
    good = pairs.ndim == 2 and pairs.shape[1] == 2 and pairs.dtype.kind in "iuf"
    if not good or not ((pairs >= 0) & (pairs < [n_tx, n_rx]) & (pairs == np.rint(pairs))).all():
        raise HandbenchError(
            f"pairs: are {pairs.dtype} of shape {pairs.shape}; expected [n, 2] whole numbers: a "
            f"transmitter from 0 to {n_tx - 1} and a receiver from 0 to {n_rx - 1}"
        )
    if (often := len(pairs) - len(np.unique(pairs, axis=0))) > 0:
        raise HandbenchError(
            f"pairs: {often} rows repeat an earlier pair; give each pair once, and repeated "
            "sweeps along the frame axis"
        )
