"""Channels of a capture, one a pair of a transmitter and a receiver at one place, with what they
share: gains, and the moves of a scan."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np

from handbench.radar.data.arrays import AntennaArray, Aperture, channel_ends

SAME_M = 1e-5  # vectors from transmitter to receiver that agree to this are those of one element


@dataclass(frozen=True)
class GainSide:
    """Parts of the instrument that have one gain each: all transmitters, all receivers, or all
    elements (fixed pairs of both) of an array that is moved. of [n]: which part each channel uses;
    place_m [parts, 3]: the parts' mean positions."""

    of: np.ndarray
    place_m: np.ndarray

    @property
    def count(self) -> int:
        """The number of parts."""
        return len(self.place_m)


@dataclass(frozen=True)
class CaptureChannels:
    """The channels of a capture, in the order of one tone's flattened samples.

    tx_m, rx_m [n, 3]: positions of each channel's transmitter and receiver, metres. moves_m [n, 3]:
    how far a scan had moved them from their mean position; 0 for an array at rest. sides: the parts
    of the instrument with a gain each (transmitters and receivers of an array, or the pairs of one
    that is moved); a channel's gain is the product of its parts' gains."""

    tx_m: np.ndarray
    rx_m: np.ndarray
    moves_m: np.ndarray
    sides: tuple[GainSide, ...]

    @classmethod
    def of(cls, aperture: Aperture) -> CaptureChannels:
        """Return an aperture's channels. The pairs of a moved array are recognised by the vector
        from transmitter to receiver, which stays the same when they move."""
        tx_m, rx_m = channel_ends(aperture)
        if isinstance(aperture, AntennaArray):
            t, r = (index.ravel() for index in np.indices(aperture.channels))
            sides = GainSide(t, aperture.tx_m), GainSide(r, aperture.rx_m)
            return cls(tx_m, rx_m, np.zeros_like(tx_m), sides)
        middle_m = (tx_m + rx_m) / 2
        _, element = np.unique(np.rint((rx_m - tx_m) / SAME_M), axis=0, return_inverse=True)
        element = element.ravel()
        sums_m = np.zeros((element.max() + 1, 3))
        np.add.at(sums_m, element, middle_m)
        place_m = sums_m / np.bincount(element)[:, None]
        return cls(tx_m, rx_m, middle_m - place_m[element], (GainSide(element, place_m),))

    @property
    def middle_m(self) -> np.ndarray:
        """Middles [n, 3] between transmitter and receiver: an antenna there that sends and receives
        sees nearly the same path to a target far away."""
        return (self.tx_m + self.rx_m) / 2

    @property
    def width_m(self) -> float:
        """The larger extent of the middles along x or y."""
        return float(np.ptp(self.middle_m[:, :2], axis=0).max())

    def some(self, index: np.ndarray) -> CaptureChannels:
        """Return the channels with the given indices."""
        sides = tuple(GainSide(side.of[index], side.place_m) for side in self.sides)
        return CaptureChannels(self.tx_m[index], self.rx_m[index], self.moves_m[index], sides)

    def stretched(self, steps: np.ndarray) -> CaptureChannels:
        """Return the channels of a scan whose steps along x and y are larger by the shares
        steps [2]."""
        shift_m = self.moves_m * np.append(steps, 0.0)
        return CaptureChannels(self.tx_m + shift_m, self.rx_m + shift_m, self.moves_m, self.sides)

    def spread(self, gains: Sequence[np.ndarray]) -> np.ndarray:
        """Return the gain of each channel [n], the product of its parts' gains: one array [parts]
        for each side."""
        each = (gain[side.of] for side, gain in zip(self.sides, gains, strict=True))
        return reduce(np.multiply, each)
