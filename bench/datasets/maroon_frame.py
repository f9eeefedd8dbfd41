"""Reader of one radar frame of MAROON: a numpy file with a pickled dictionary, read without running
any code in it.

The echoes `xr`, by MAROON's public code, are [receiver, transmitter, frequency] of 96 × 96
antennas. Antennas 1 to 94 of both are used; these are `radar.data.arrays.qar50` in its order.
MAROON images them by Σ xr·e^{+j2πfτ}, so an echo is e^{−j2πfτ}, as in handbench, and nothing is
conjugated. Pairs of antennas that the radar could not use may be zero, and stay zero.

A pickle is a program that may call any function that it can name. Here it can name numpy's arrays,
types and scalars only, and gets a description in place of each; the numbers are then made from the
bytes in the descriptions, so that no array is larger than its file. Python's own unpickler is used,
because the one in C reserves as much memory as a number in the file says.
"""

import pickle
import pickletools
from collections.abc import Callable
from dataclasses import dataclass
from io import BytesIO
from itertools import islice
from operator import index
from pathlib import Path
from typing import Any

import numpy as np

from handbench.radar.data.capture import as_complex64
from handbench.support.errors import HandbenchError
from handbench.support.files import read_bytes
from handbench.support.limits import MOST_STEPS, PICKLE_BYTES

ANTENNAS, USED = 96, slice(1, 95)
RADAR_HZ = (1e9, 1e12)  # range of a list of frequencies in hertz
KEYS = ("fvec", "xr", "number_of_measurements")
WHAT = f"a radar frame of MAROON (a pickled dictionary with numbers {', '.join(KEYS)})"
CORES = ("numpy.core.multiarray", "numpy._core.multiarray")  # before numpy 2, and since
NAMES = {
    *(("numpy", "dtype"), ("numpy", "ndarray")),
    *((core, name) for core in CORES for name in ("_reconstruct", "scalar")),
}


@dataclass(frozen=True)
class Frame:
    """One radar frame of MAROON. samples [f, tx, rx]: complex64, at frequencies_hz [f]. count:
    number of frames in the capture, as the file states it."""

    samples: np.ndarray
    frequencies_hz: np.ndarray
    count: int


def read_frame(file: Path) -> Frame:
    """Read a radar frame of MAROON from its file `calibrated_data/NNNNNN.npy`, and bring its axes
    into handbench's order. Raises HandbenchError for any other file."""
    fvec, xr, count = read_numbers(file)
    fvec, (low_hz, high_hz) = fvec.ravel(), RADAR_HZ
    if fvec.dtype.kind not in "fiu" or not ((fvec > low_hz) & (fvec < high_hz)).all():
        raise HandbenchError(
            f"{file}: 'fvec' is {fvec.dtype} from {fvec.min():.4g} to {fvec.max():.4g}; expected "
            f"frequencies from {low_hz:g} to {high_hz:g} Hz"
        )
    expected = ANTENNAS, ANTENNAS, len(fvec)
    if xr.dtype.kind != "c" or xr.shape != expected:
        raise HandbenchError(
            f"{file}: 'xr' is {xr.dtype} {xr.shape}; expected complex numbers {expected} [rx, "
            "tx, f]"
        )
    if count.size != 1 or count.dtype.kind not in "fiu" or not 1 <= count.item() < np.inf:
        raise HandbenchError(
            f"{file}: 'number_of_measurements' is {count}; expected a number of frames, 1 or more"
        )
    samples = as_complex64(xr[USED, USED].transpose(2, 1, 0))
    return Frame(samples, fvec.astype(np.float64), int(count.item()))


def read_numbers(path: str | Path) -> list[np.ndarray]:
    """Read the numbers under KEYS in the dictionary of a pickled .npy file, without calling any
    function that the file names. Raises HandbenchError for a file without them."""
    content = read_bytes(path, WHAT, PICKLE_BYTES)
    try:
        stream = BytesIO(content)
        np.lib.format.read_magic(stream)
        np.lib.format.read_array_header_1_0(stream)
        start = stream.tell()
        if sum(1 for _ in islice(pickletools.genops(stream), MOST_STEPS + 1)) > MOST_STEPS:
            raise ValueError("its pickle has too many steps")
        stream.seek(start)
        [held] = _Unpickler(stream).load().state[-1]
        return [_array(held[key]) for key in KEYS]
    except Exception as error:  # broken pickles raise whatever the opcode at hand stumbles over
        reason = " ".join(str(error).split()) or type(error).__name__
        raise HandbenchError(
            f"{path}: was not read ({reason[:200]}); expected {WHAT}; download it again"
        ) from error


class _Described:
    """One of numpy's objects as a pickle describes it: the arguments of the function that makes it,
    and its state."""

    def __init__(self, *arguments: Any) -> None:
        self.arguments, self.state = arguments, ()

    def __setstate__(self, state: Any) -> None:
        self.state = state


def _describe(unpickler: Any) -> None:
    """Describe the object that the topmost two of the unpickler's stack, a function and its
    arguments, make. Python's error for others would print them, which a few bytes can make
    endless."""
    arguments, function = unpickler.stack.pop(), unpickler.stack.pop()
    if function is not _Described or not isinstance(arguments, tuple):
        raise ValueError("it calls something else than numpy's functions")
    unpickler.stack.append(_Described(*arguments))


STEPS: dict[int, Callable[[Any], None]] = {
    **pickle._Unpickler.dispatch,
    pickle.REDUCE[0]: _describe,
}


class _Unpickler(pickle._Unpickler):
    """An unpickler that knows numpy's arrays, types and scalars only."""

    dispatch = STEPS

    def find_class(self, module: str, name: str) -> type[_Described]:
        if (module, name) not in NAMES:
            raise ValueError(f"it uses {module}.{name}, which is not allowed")
        return _Described


def _array(value: Any) -> np.ndarray:
    """Make the array that a pickle describes, or one of a plain number. Raises an error if it is
    not one of numbers, or if its bytes do not have its shape."""
    if not isinstance(value, _Described):
        return np.array(float(value))
    if value.state:
        _, shape, dtype, by_column, content = value.state
    else:
        (dtype, content), shape, by_column = value.arguments, (), False  # a scalar
    number = np.dtype("".join((dtype.state[1], dtype.arguments[0])))  # such as "<" and "c8"
    if number.kind not in "iufc":
        raise ValueError("it has an array of other objects than numbers")
    numbers = np.frombuffer(content, number)
    return numbers.reshape(tuple(map(index, shape)), order="F" if by_column else "C")
