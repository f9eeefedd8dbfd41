"""Recordings: the numbers in a capture file of any layout, and their conversion to a
`RadarCapture`."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from handbench.radar.data.arrays import (
    AntennaArray,
    Aperture,
    BistaticScan,
    PlanarScan,
    positions,
    tones,
)
from handbench.radar.data.capture import RadarCapture, as_complex64
from handbench.support.cost import require_memory
from handbench.support.errors import HandbenchError

SWEEPS = ("mean", "frames")  # repeated sweeps are averaged, or become frames
# An array with more than this many times the measured pairs becomes a list of pairs.
SPARSE = 8


@dataclass(frozen=True)
class Recording:
    """The numbers in a capture file of any layout, before they are checked and converted to a
    `RadarCapture`.

    samples: [frame, sweep, frequency, …], last axes (tx, rx), (pair,) or (position,); a channel
    that was not measured is NaN throughout. places_m: antenna positions by name, either tx_m and
    rx_m or position_m, [n, 3] each, metres. pairs [n, 2]: indices of the transmitter and the
    receiver of each pair, from 0. gains: complex [channels] or [frequency, channels]; samples are
    divided by them, and 0 or NaN marks a dead channel. sweeps: "mean" to average repeated sweeps,
    "frames" to make each a frame. about: further fields of the `RadarCapture`, by name.
    """

    samples: np.ndarray
    frequencies_hz: np.ndarray
    places_m: dict[str, np.ndarray]
    pairs: np.ndarray | None = None
    gains: np.ndarray | None = None
    sweeps: str = "mean"
    about: dict[str, Any] = field(default_factory=dict)

    def capture(self) -> RadarCapture:
        """Convert the recording to a `RadarCapture`. Sweeps are averaged or become frames, samples
        are divided by the gains, and channels that were not measured are left out (of a scan or
        list of pairs) or set to 0 (of an array). Raises HandbenchError for numbers that do not fit
        together, and if no channel was measured."""
        self._check()
        with np.errstate(invalid="ignore", over="ignore"):  # RadarCapture refuses infinite samples
            samples, missing = self._divided()
            if missing.all():
                raise HandbenchError(
                    "samples: all are NaN, so no channel was measured; give numbers for the "
                    "measured channels and NaN for the others"
                )
            samples = as_complex64(np.where(missing, 0, samples) if missing.any() else samples)
        places_m = [positions(name, places) for name, places in self.places_m.items()]
        aperture: Aperture
        if "position_m" in self.places_m:
            samples, aperture = samples[..., ~missing], PlanarScan(places_m[0][~missing])
        elif self.pairs is None:
            aperture = AntennaArray(places_m[0], places_m[1], ~missing)
        else:
            t, r = self.pairs[~missing].T.astype(np.intp)
            samples, aperture = _of_pairs(samples[..., ~missing], t, r, *places_m)
        return RadarCapture(samples, self.frequencies_hz, aperture, **self.about)

    def _check(self) -> None:
        """Raise HandbenchError for invalid tones or pairs, and for arrays whose shapes do not fit
        together."""
        tones("frequencies_hz", self.frequencies_hz)
        places = [count for places in self.places_m.values() for count in places.shape[:1]]
        channels = tuple(places) if self.pairs is None else self.pairs.shape[:1]
        shape, expected = self.samples.shape, (len(self.frequencies_hz), *channels)
        if len(shape) < 3 or shape[2:] != expected or self.samples.size == 0:
            first, seen = (
                ("frame, ", shape[:1] + shape[2:])
                if shape[1:2] == (1,)
                else ("frame, sweep, ", shape)
            )
            axes = first + ", ".join(map(str, expected))
            raise HandbenchError(
                f"samples: have shape {seen}; expected [{axes}] from the numbers of frequencies "
                "and antennas"
            )
        if self.gains is not None and self.gains.shape not in (expected, channels):
            raise HandbenchError(
                f"gains: have shape {self.gains.shape}; expected {channels}, or {expected} with "
                "gains for each tone"
            )
        if self.sweeps not in SWEEPS:
            raise HandbenchError(f"sweeps: is '{self.sweeps}'; expected {' or '.join(SWEEPS)}")
        if self.pairs is not None:
            _check_pairs(self.pairs, *places)

    def _divided(self) -> tuple[np.ndarray, np.ndarray]:
        """Average the sweeps, or make each a frame, and divide the samples by the gains: (samples
        [frame, frequency, channels], boolean mask [channels] of channels that were not measured or
        are dead)."""
        samples, missing = self.samples, np.isnan(self.samples).all(axis=(0, 1, 2))
        if self.sweeps == "frames":
            samples = samples.reshape(-1, *samples.shape[2:])
        else:
            samples = (
                samples[:, 0]
                if samples.shape[1] == 1
                else samples.mean(axis=1, dtype=np.complex128)
            )
        if self.gains is None:
            return samples, missing
        alive = np.isfinite(self.gains) & (self.gains != 0)
        samples = samples / np.where(alive, self.gains, 1)
        return samples, missing | ~(alive if alive.ndim == missing.ndim else alive.all(axis=0))


def _of_pairs(
    samples: np.ndarray, t: np.ndarray, r: np.ndarray, tx_m: np.ndarray, rx_m: np.ndarray
) -> tuple[np.ndarray, Aperture]:
    """Convert samples [frame, f, n] of antenna pairs to those of an array: (samples [frame, f, t,
    r], which are 0 for pairs that were not measured, and the `AntennaArray`).

    t, r [n]: indices of each pair's transmitter and receiver. If few of all possible pairs were
    measured, the result is (unchanged samples, `BistaticScan`).
    """
    if len(tx_m) * len(rx_m) > SPARSE * len(t):
        return samples, BistaticScan(tx_m[t], rx_m[r])
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
        expected = (
            f"[n, 2] whole numbers: a transmitter from 0 to {n_tx - 1} and a receiver from 0 to "
            f"{n_rx - 1}"
        )
        raise HandbenchError(
            f"pairs: are {pairs.dtype} of shape {pairs.shape}; expected {expected}"
        )
    if (often := len(pairs) - len(np.unique(pairs, axis=0))) > 0:
        raise HandbenchError(
            f"pairs: {often} rows repeat an earlier pair; give each pair once, and repeated "
            "sweeps along the frame axis"
        )
