"""Recordings: what a file holds of a capture, in whatever form, made one `RadarCapture`."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from radar.data.arrays import AntennaArray, BistaticScan, PlanarScan, positions, tones
from radar.data.capture import RadarCapture, single
from radar.support.cost import require_free
from radar.support.errors import HandbenchError

SWEEPS = ("mean", "frames")  # what repeated sweeps of a frame become
SPARSE = 8  # times as many pairs as were measured: more are not filled in with zeros but summed pair by pair


@dataclass(frozen=True)
class Recording:
    """samples: numbers [frame, sweep, frequency, …], the last axes being (tx, rx), (pair,) or (position,); NaN
    throughout where a channel was not measured. places_m: tx_m and rx_m [n, 3], or position_m. pairs [n, 2]: numbers,
    from 0, of each pair's transmitter and receiver. gains: complex [channels] or [frequency, channels], by which the
    samples are to be divided; 0 or NaN of a channel that is dead. sweeps: whether those of a frame are averaged or
    become frames. about: further fields of the `RadarCapture`."""

    samples: np.ndarray
    frequencies_hz: np.ndarray
    places_m: dict[str, np.ndarray]
    pairs: np.ndarray | None = None
    gains: np.ndarray | None = None
    sweeps: str = "mean"
    about: dict[str, Any] = field(default_factory=dict)

    @property
    def channels(self) -> tuple[int, ...]:
        """Shape of one tone's samples, as pairs and places tell it."""
        whole = tuple(count for places in self.places_m.values() for count in places.shape[:1])
        return whole if self.pairs is None else self.pairs.shape[:1]

    def capture(self) -> RadarCapture:
        """The capture. HandbenchError for what does not fit together, and where no channel was measured."""
        self.check()
        with np.errstate(invalid="ignore", over="ignore"):  # what is infinite is refused with the capture
            samples, missing = self._divided()
            if missing.all():
                raise HandbenchError("samples: no channel was measured; expected numbers, NaN where there are none")
            samples = single(np.where(missing, 0, samples) if missing.any() else samples)
        places_m = {name: positions(name, places) for name, places in self.places_m.items()}
        if "position_m" in places_m:
            return self._of(samples[..., ~missing], PlanarScan(places_m["position_m"][~missing]))
        tx_m, rx_m = places_m["tx_m"], places_m["rx_m"]
        if self.pairs is None:
            return self._of(samples, AntennaArray(tx_m, rx_m, ~missing))
        (t, r), samples = self.pairs[~missing].T.astype(np.intp), samples[..., ~missing]
        if len(tx_m) * len(rx_m) > SPARSE * len(t):
            return self._of(samples, BistaticScan(tx_m[t], rx_m[r]))
        shape = (*samples.shape[:2], len(tx_m), len(rx_m))
        require_free(8 * float(np.prod(shape)), f"samples: {shape}", "end other programs, or cut the file into parts")
        filled, measured = np.zeros(shape, np.complex64), np.zeros(shape[2:], bool)
        filled[:, :, t, r], measured[t, r] = samples, True
        return self._of(filled, AntennaArray(tx_m, rx_m, measured))

    def check(self) -> None:
        """HandbenchError for tones that are none, shapes that do not fit together, and pairs that are none."""
        tones("frequencies_hz", self.frequencies_hz)
        shape, expected = self.samples.shape, (len(self.frequencies_hz), *self.channels)
        if len(shape) < 3 or shape[2:] != expected or self.samples.size == 0:
            once = shape[1:2] == (1,)
            axes = ", ".join(map(str, (("frame",) if once else ("frame", "sweep")) + expected))
            raise HandbenchError(
                f"samples: have shape {shape[:1] + shape[2:] if once else shape}; expected [{axes}] from the numbers of "
                "frequencies and antennas"
            )
        if self.gains is not None and self.gains.shape not in (shape[2:], shape[3:]):
            raise HandbenchError(f"gains: have shape {self.gains.shape}; expected {shape[3:]}, or {shape[2:]} by tone")
        if self.sweeps not in SWEEPS:
            raise HandbenchError(f"sweeps: is '{self.sweeps}'; expected {' or '.join(SWEEPS)}")
        if self.pairs is not None:
            _check_pairs(self.pairs, *(len(self.places_m[name]) for name in ("tx_m", "rx_m")))

    def listed(self) -> "Recording":
        """The same by a list of pairs."""
        if self.pairs is not None:
            return self
        flat = [None if a is None else a.reshape(*a.shape[:-2], -1) for a in (self.samples, self.gains)]
        pairs = np.indices(self.channels).reshape(2, -1).T
        return replace(self, samples=flat[0], gains=flat[1], pairs=pairs)

    def _divided(self) -> tuple[np.ndarray, np.ndarray]:
        """Samples [frame, frequency, channels] without sweeps and gains; which channels [channels] have none."""
        samples = self.samples
        if self.sweeps == "frames":
            samples = samples.reshape(-1, *samples.shape[2:])
        else:
            samples = samples[:, 0] if samples.shape[1] == 1 else samples.mean(axis=1, dtype=np.complex128)
        missing = np.isnan(samples).all(axis=(0, 1))
        if self.gains is None:
            return samples, missing
        alive = np.isfinite(self.gains) & (self.gains != 0)
        samples = samples / np.where(alive, self.gains, 1)
        return samples, missing | ~(alive if alive.ndim == missing.ndim else alive.all(axis=0))

    def _of(self, samples: np.ndarray, aperture: AntennaArray | PlanarScan | BistaticScan) -> RadarCapture:
        return RadarCapture(samples, self.frequencies_hz, aperture, **self.about)


def joined(arrays: Sequence[Recording]) -> Recording:
    """The recording of several arrays at once, of which each hears itself alone; HandbenchError where their frames,
    sweeps or tones differ, and for a planar scan among them."""
    if len(arrays) == 1:
        return arrays[0]
    if any("position_m" in array.places_m for array in arrays):
        raise HandbenchError("array: one of several is a planar scan; expected tx and rx of each")
    for array in arrays:
        array.check()
    if len(shapes := {array.samples.shape[:3] for array in arrays}) > 1:
        raise HandbenchError(
            f"array: samples [frame, sweep, frequency, …] of {shapes}; expected the same of all arrays"
        )
    listed, first, pairs, gains = [array.listed() for array in arrays], np.zeros(2, int), [], []
    for array in listed:
        pairs.append(first + array.pairs)
        gains.append(np.broadcast_to(1 if array.gains is None else array.gains, array.samples.shape[2:]))
        first = first + [len(array.places_m[name]) for name in ("tx_m", "rx_m")]
    return replace(
        arrays[0],
        samples=np.concatenate([array.samples for array in listed], axis=3),
        places_m={name: np.concatenate([array.places_m[name] for array in arrays]) for name in ("tx_m", "rx_m")},
        pairs=np.concatenate(pairs),
        gains=None if all(array.gains is None for array in arrays) else np.concatenate(gains, axis=1),
    )


def _check_pairs(pairs: np.ndarray, n_tx: int, n_rx: int) -> None:
    good = pairs.ndim == 2 and pairs.shape[1] == 2 and len(pairs) > 0 and pairs.dtype.kind in "iuf"
    if not good or not ((pairs >= 0) & (pairs < [n_tx, n_rx]) & (pairs == np.rint(pairs))).all():
        raise HandbenchError(
            f"pairs: {pairs.dtype} of shape {pairs.shape}; expected [n, 2] whole numbers from 0, of one of {n_tx} "
            f"transmitters and of one of {n_rx} receivers"
        )
    found, counts = np.unique(pairs, axis=0, return_counts=True)
    if len(found) < len(pairs):
        t, r = found[counts.argmax()]
        raise HandbenchError(
            f"pairs: tx {t:g} with rx {r:g} is there {counts.max()} times; expected each once: repeated sweeps have an "
            "axis of their own"
        )
