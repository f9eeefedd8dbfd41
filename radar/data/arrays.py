"""Antenna arrays and scans, with their positions in the radar frame: origin at the aperture's
centre, z away from the array, y up, x = y × z."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from handbench.support.errors import HandbenchError
from handbench.support.files import CSV_BYTES, read_parsed

MOST_ANTENNAS = 2000  # of one file; 2000 × 2000 channels take 32 MB a tone
SPEED_OF_LIGHT_M_S = 299_792_458.0
HIGHEST_HZ = 1e13
# float64 resolves a path to 4e-9 m there, and a phase at 80 GHz to 1e-5 rad
FARTHEST_M = 1e7
EVEN = 1e-3  # difference of the distances of tones that are evenly spaced
# parts of the smallest distance of tones that are tried as the one of which all are multiples
DIVISORS = 100
MULTIPLE = 0.05  # how far from a multiple


@dataclass(frozen=True)
class Leg:
    """One leg of every path: from all transmitters to the target, or from the target to all
    receivers.

    position_m [n, 3]: these transmitters or receivers; passes: how often a path goes between target
    and antenna (2 for a planar scan, there and back); channels [n]: number of channels (measured
    pairs) of each antenna, up to a common factor.
    """

    position_m: np.ndarray
    passes: int
    channels: np.ndarray

    def only(self, index: np.ndarray) -> "Leg":
        """Return the leg with only the antennas at these indices [k]."""
        return Leg(self.position_m[index], self.passes, self.channels[index])

    def lengths_m(self, point_m: np.ndarray) -> np.ndarray:
        """Compute the length of this leg of the path via a point [3], metres, for each antenna:
        [n]."""
        return self.passes * np.linalg.norm(point_m - self.position_m, axis=1)

    def directions(self, point_m: np.ndarray) -> np.ndarray:
        """Return unit vectors [n, 3] from the antennas to a point [3]."""
        towards = point_m - self.position_m
        return towards / np.linalg.norm(towards, axis=1, keepdims=True)


@dataclass(frozen=True)
class AntennaArray:
    """A MIMO array: every receiver receives from every transmitter.

    tx_m [t, 3], rx_m [r, 3]: transmitters and receivers, metres. measured, bool [t, r]: the pairs
    that were measured (None: all); samples of the other pairs are 0 and add nothing to an image.
    Raises HandbenchError for invalid positions, and for a mask `measured` of another shape or
    without any pair.
    """

    tx_m: np.ndarray
    rx_m: np.ndarray
    measured: np.ndarray | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "tx_m", positions("tx_m", self.tx_m))
        object.__setattr__(self, "rx_m", positions("rx_m", self.rx_m))
        measured = self.measured
        if measured is not None and (measured.shape != self.channels or not measured.any()):
            found = f"{np.count_nonzero(measured)} pairs of {measured.shape}"
            raise HandbenchError(
                f"measured: has {found}; expected at least one measured pair in an array of shape "
                f"{self.channels} (transmitters, receivers)"
            )
        if measured is not None and measured.all():
            object.__setattr__(self, "measured", None)

    @property
    def channels(self) -> tuple[int, ...]:
        """Shape of one tone's samples: (t, r)."""
        return len(self.tx_m), len(self.rx_m)

    @property
    def legs(self) -> tuple[Leg, Leg]:
        """The two legs of the paths: transmitters to target, and target to receivers."""
        every = [np.ones(n) for n in self.channels]
        to, back = (
            every
            if self.measured is None
            else (self.measured.mean(axis=1), self.measured.mean(axis=0))
        )
        return Leg(self.tx_m, 1, to), Leg(self.rx_m, 1, back)


@dataclass(frozen=True)
class AntennaPairs:
    """A list of antenna pairs, as of a scan: rx_m[i] receives only what tx_m[i] sends ([n, 3] each,
    metres). Those of one transceiver that is moved are equal. Raises HandbenchError for lists of
    different lengths and for invalid positions."""

    tx_m: np.ndarray
    rx_m: np.ndarray

    def __post_init__(self) -> None:
        object.__setattr__(self, "tx_m", positions("tx_m", self.tx_m))
        object.__setattr__(self, "rx_m", positions("rx_m", self.rx_m))
        if len(self.tx_m) != len(self.rx_m):
            raise HandbenchError(
                f"rx_m: has {len(self.rx_m)} positions, but tx_m has {len(self.tx_m)}; give one "
                "receiver position for each transmitter position"
            )

    @property
    def channels(self) -> tuple[int, ...]:
        """Shape of one tone's samples: (n,)."""
        return (len(self.tx_m),)

    @property
    def monostatic(self) -> bool:
        """Whether every pair is one transceiver, whose paths are those of an array with a single
        receiver at distance 0."""
        return np.array_equal(self.tx_m, self.rx_m)

    @property
    def legs(self) -> tuple[Leg, Leg]:
        """The two legs of the paths: transmitters to target, and target to receivers. Path i goes
        from transmitter i to receiver i; of a transceiver, the first leg goes there and back, and
        the second has length 0."""
        every = np.ones(len(self.tx_m))
        if self.monostatic:
            return Leg(self.tx_m, 2, every), Leg(self.tx_m[:1], 0, every[:1])
        return Leg(self.tx_m, 1, every), Leg(self.rx_m, 1, every)


Aperture = AntennaArray | AntennaPairs


def channel_ends(aperture: Aperture) -> tuple[np.ndarray, np.ndarray]:
    """Return the positions of each channel's transmitter and receiver, [n, 3] each, metres, in the
    order of one tone's flattened samples."""
    if isinstance(aperture, AntennaPairs):
        return aperture.tx_m, aperture.rx_m
    t, r = (index.ravel() for index in np.indices(aperture.channels))
    return aperture.tx_m[t], aperture.rx_m[r]


def range_cell_m(frequencies_hz: np.ndarray) -> float:
    """Compute the range resolution c/2B of tones [f], metres, from their bandwidth B."""
    return SPEED_OF_LIGHT_M_S / 2 / float(np.ptp(frequencies_hz))


def lateral_cell_m(
    wavelength_m: float, extent_m: np.ndarray | float, z_m: float
) -> np.ndarray | float:
    """Compute the resolution λz/2D across the view, metres, at depth z of antennas that extend over
    D = extent_m (0: infinite)."""
    with np.errstate(divide="ignore"):
        return np.divide(wavelength_m * z_m / 2, extent_m)


def range_period_m(frequencies_hz: np.ndarray) -> float:
    """Compute the range c/2Δf, metres, after which echoes at tones [f] repeat.

    Δf is the usual distance of neighbours, since a few tones beside an even sweep tell little; if
    none is usual, it is the largest of which all are multiples.
    """
    gaps_hz = np.diff(np.unique(frequencies_hz))
    step_hz = np.median(gaps_hz)
    if np.isclose(gaps_hz, step_hz, rtol=EVEN).mean() < 0.5:
        steps_hz = gaps_hz.min() / np.arange(1, DIVISORS)
        turns = gaps_hz / steps_hz[:, None]
        fits = np.abs(turns - np.rint(turns)).max(axis=1) < MULTIPLE
        step_hz = steps_hz[fits.argmax() if fits.any() else -1]
    return float(SPEED_OF_LIGHT_M_S / 2 / step_hz)


def reach_hz(tones_hz: Sequence[float] | np.ndarray) -> float:
    """Return the larger of the distances Δf, hertz, between the last tone and the first two. The
    depth step of FSK's last tone is unambiguous within ±c/4Δf."""
    return max(abs(tones_hz[-1] - hz) for hz in tones_hz[:-1][:2])


def array_legs(aperture: Aperture, lengths: Any) -> Any:
    """Split every path into a transmitter's and a receiver's part, as in an array: lengths [t, …]
    and [r, …], of which each sum is a path.

    lengths: those of the aperture's two legs. For a list of antenna pairs, the first part becomes
    the whole path, and the second a single receiver at distance 0.
    """
    to, back = lengths
    return (to + back, 0 * back[:1]) if isinstance(aperture, AntennaPairs) else (to, back)


def qar50() -> AntennaArray:
    """Return the antenna array of the paper's radar, with the 94 transmitters and 94 receivers that
    the paper uses: a square frame with sides of 14 cm and a pitch of 3 mm.

    The transmitters are on the two vertical sides (the outermost ones 1.5 mm further out), the
    receivers on the two horizontal sides.
    """
    along = np.linspace(-0.069, 0.069, 47)
    side = 0.0705
    outward = np.where(np.abs(along) > 0.068, side + 0.0015, side)
    zero = np.zeros_like(along)
    tx = [np.stack([sign * outward, along, zero], axis=1) for sign in (-1, 1)]
    rx = [np.stack([along, sign * side + zero, zero], axis=1) for sign in (-1, 1)]
    return AntennaArray(np.concatenate(tx), np.concatenate(rx))


def load_positions(path: str | Path) -> np.ndarray:
    """Read antenna positions [n, 3] in metres from a CSV file with the header x_m,y_m,z_m. Raises
    HandbenchError for any other content."""
    what = "the line x_m,y_m,z_m and lines of three numbers separated by commas"
    table = read_parsed(path, what, "CSV", _table, CSV_BYTES)
    if len(table) > MOST_ANTENNAS:
        raise HandbenchError(
            f"{path}: has {len(table)} antennas, more than the limit of {MOST_ANTENNAS}; remove "
            "some"
        )
    return positions(str(path), table)


def _table(text: str) -> np.ndarray:
    header, *lines = text.strip().split("\n")
    if re.sub(r'[\s"]', "", header) != "x_m,y_m,z_m":
        raise ValueError(f"the first line is {header[:80]!r}")
    return np.array([_row(*line) for line in enumerate(lines, 2) if line[1].strip()])


def _row(number: int, line: str) -> list[float]:
    try:
        x, y, z = (float(cell.strip(' "')) for cell in line.split(","))
    except ValueError:
        raise ValueError(f"line {number} is not three numbers") from None
    return [x, y, z]


def numbers(name: str, values: Any) -> np.ndarray:
    """Return an array of numbers; those that are masked, which were not measured, become NaN.
    Raises HandbenchError for other values. name: name of the argument."""
    found = np.asanyarray(values)
    if found.dtype.kind not in "biufc":
        raise HandbenchError(f"{name}: are of type {found.dtype}; expected an array of numbers")
    return np.ma.filled(found * 1.0, np.nan) if np.ma.isMaskedArray(found) else found


def tones(name: str, values: ArrayLike) -> np.ndarray:
    """Return frequencies [f], in hertz and in any order, as float64. Raises HandbenchError unless
    all are positive numbers up to HIGHEST_HZ. name: name of the argument, with which the message
    begins."""
    found = numbers(name, values)
    if found.ndim != 1 or found.dtype.kind not in "iuf" or len(found) == 0:
        raise HandbenchError(
            f"{name}: is {found.dtype} of shape {found.shape}; expected a list of real numbers, "
            "the frequencies in hertz"
        )
    if len(wrong := found[~((found > 0) & (found <= HIGHEST_HZ))]):
        expected = (
            f"expected frequencies above 0 and at most {HIGHEST_HZ:g} Hz; if the unit is not "
            "hertz, convert the numbers"
        )
        raise HandbenchError(f"{name}: has the value {wrong[0]}; {expected}")
    return found.astype(np.float64)


def times(name: str, values: ArrayLike, count: int) -> np.ndarray:
    """Return times [count], in seconds and in any order, as float64. Raises HandbenchError for
    another number of them and for values that are not finite. name: name of the argument, with
    which the message begins."""
    found = numbers(name, values)
    if found.shape != (count,) or found.dtype.kind not in "iuf" or not np.isfinite(found).all():
        raise HandbenchError(
            f"{name}: is {found.dtype} of shape {found.shape}; expected {count} finite numbers, "
            f"the times in seconds of the {count} {'frames' if 'frame' in name else 'tones'}"
        )
    return found.astype(np.float64)


def positions(name: str, values: ArrayLike) -> np.ndarray:
    """Return positions [n, 3], in metres, as float64. Raises HandbenchError for other shapes, NaN,
    and coordinates beyond FARTHEST_M. name: name of the argument, with which the message begins."""
    given = numbers(name, values)
    if given.ndim != 2 or given.shape[1] != 3 or len(given) == 0 or given.dtype.kind not in "biuf":
        raise HandbenchError(
            f"{name}: has shape {given.shape} of type {given.dtype}; expected numbers of shape "
            "[n, 3], the positions in metres"
        )
    values = np.ascontiguousarray(given, np.float64)
    if not np.isfinite(values).all():
        raise HandbenchError(
            f"{name}: has NaN or infinite values; give each antenna and point a position in metres"
        )
    if np.abs(values).max() > FARTHEST_M:
        raise HandbenchError(
            f"{name}: has a coordinate of {np.abs(values).max():.3g} m, but float64 resolves the "
            f"phase of a wave only up to {FARTHEST_M:g} m; check that the unit is metres"
        )
    return values
