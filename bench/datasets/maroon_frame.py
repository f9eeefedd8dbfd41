"""One radar frame of MAROON: echoes of 96 × 96 antennas, of which the inner 94 × 94 are used.

What their public code says of `xr`: it is [receiver, transmitter, frequency]; rows and columns 1 to 94 are used, which
are `radar.data.arrays.qar50` in its order; their image is Σ xr·e^{+j2πfτ}, so that the echo is e^{−j2πfτ} as with us,
and nothing is conjugated. Pairs of antennas that the radar could not use may be zero; they stay so.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from handbench.bench.datasets.maroon_pickle import read_dictionary
from handbench.radar.data.capture import single
from handbench.support.errors import HandbenchError

ANTENNAS, USED = 96, slice(1, 95)
RADAR_HZ = (1e9, 1e12)  # what a list of frequencies in hertz lies between
MOST = 1_000_000  # frames that six digits number


@dataclass(frozen=True)
class Frame:
    """samples: complex64 [f, tx, rx] at frequencies_hz [f]; count: how many frames there are of the capture."""

    samples: np.ndarray
    frequencies_hz: np.ndarray
    count: int


def read_frame(file: Path) -> Frame:
    """Read `calibrated_data/NNNNNN.npy`, in our order of axes. Raises HandbenchError for anything else."""
    content = read_dictionary(file)
    frequencies_hz, xr = _frequencies_hz(file, content), _numbers(file, content, "xr")
    expected = ANTENNAS, ANTENNAS, len(frequencies_hz)
    if xr.dtype.kind != "c" or xr.shape != expected:
        raise HandbenchError(f"{file}: 'xr' is {xr.dtype} {xr.shape}; expected complex numbers {expected} [rx, tx, f]")
    count = _numbers(file, content, "number_of_measurements")
    if count.size != 1 or count.dtype.kind not in "fiu" or not 1 <= count.item() <= MOST:
        raise HandbenchError(f"{file}: 'number_of_measurements' is {count}; expected a number of frames, 1 to {MOST}")
    samples = single(xr[USED, USED].transpose(2, 1, 0))
    return Frame(samples, frequencies_hz, int(count.item()))


def _frequencies_hz(file: Path, content: dict[str, Any]) -> np.ndarray:
    fvec, (low_hz, high_hz) = _numbers(file, content, "fvec").reshape(-1), RADAR_HZ
    if fvec.dtype.kind not in "fiu" or not ((fvec > low_hz) & (fvec < high_hz)).all():
        raise HandbenchError(
            f"{file}: 'fvec' is {fvec.dtype} from {fvec.min():.4g} to {fvec.max():.4g}; expected hertz, {low_hz:g} to "
            f"{high_hz:g}"
        )
    return fvec.astype(np.float64)


def _numbers(file: Path, content: dict[str, Any], key: str) -> np.ndarray:
    """An entry of the dictionary as an array of numbers."""
    if key not in content:
        raise HandbenchError(f"{file}: has no '{key}'; expected fvec, xr and number_of_measurements")
    value = np.asarray(content[key])
    if value.dtype.kind not in "biufc" or value.size == 0:
        raise HandbenchError(f"{file}: '{key}' is {value.dtype} {value.shape}; expected numbers")
    return value
