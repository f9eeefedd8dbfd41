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
from io import BytesIO
from itertools import islice
from operator import index
from pathlib import Path
from typing import Any

import numpy as np

from handbench.radar.data.capture import as_complex64
from handbench.support.errors import HandbenchError
from handbench.support.files import MOST_STEPS, PICKLE_BYTES, read_bytes

ANTENNAS, USED = 96, slice(1, 95)
KEYS = ("fvec", "xr")
WHAT = f"a radar frame of MAROON (a pickled dictionary with numbers {' and '.join(KEYS)})"
CORES = ("numpy.core.multiarray", "numpy._core.multiarray")  # before numpy 2, and since
NAMES = {
    *(("numpy", "dtype"), ("numpy", "ndarray")),
    *((core, name) for core in CORES for name in ("_reconstruct", "scalar")),
}


def read_frame(file: Path) -> tuple[np.ndarray, np.ndarray]:
    """Read a radar frame of MAROON from its file `calibrated_data/NNNNNN.npy`, and bring its axes
    into handbench's order: samples [f, tx, rx], complex64, and their frequencies [f], Hz. Raises
    HandbenchError for any other file."""
    fvec, xr = read_numbers(file)
    expected = ANTENNAS, ANTENNAS, fvec.size
    if xr.shape != expected:
        raise HandbenchError(f"{file}: 'xr' is {xr.shape}; expected {expected} [rx, tx, f]")
    return as_complex64(xr[USED, USED].transpose(2, 1, 0)), fvec.ravel()


def read_numbers(path: Path) -> list[np.ndarray]:
    """Read the numbers under KEYS in the dictionary of a pickled .npy file, without calling any
    function that the file names. Raises HandbenchError for a file without them."""
    content = read_bytes(path, WHAT, PICKLE_BYTES)
    try:
        stream = BytesIO(content)
        np.lib.format.read_magic(stream)
        np.lib.format.read_array_header_1_0(stream)
        start = stream.tell()
        if any(islice(pickletools.genops(stream), MOST_STEPS, None)):
            raise ValueError("its pickle has too many steps")
        stream.seek(start)
        [held] = _Unpickler(stream).load().state[-1]
        return [_array(held[key]) for key in KEYS]
    except Exception as error:  # broken pickles raise whatever the opcode at hand stumbles over
        reason = str(error)[:200] if isinstance(error, ValueError) else "its pickle is damaged"
        raise HandbenchError(
            f"{path}: was not read ({reason}); expected {WHAT}; download it again"
        ) from error


class _Described:
    """One of numpy's objects as a pickle describes it: the arguments of the function that makes it,
    and its state."""

    def __init__(self, *arguments: Any) -> None:
        self.arguments, self.state = arguments, ()

    def __setstate__(self, state: Any) -> None:
        self.state = state


class _Unpickler(pickle._Unpickler):
    """An unpickler that knows numpy's arrays, types and scalars only."""

    def find_class(self, module: str, name: str) -> type[_Described]:
        if (module, name) not in NAMES:
            raise ValueError(f"it uses {module}.{name}, which is not allowed")
        return _Described

    def load_reduce(self: Any) -> None:
        """Describe the object that the topmost two of the stack, a function and its arguments,
        make. Python's error for others would print them, which a few bytes can make endless."""
        arguments, function = self.stack.pop(), self.stack.pop()
        if function is not _Described or not isinstance(arguments, tuple):
            raise ValueError("it calls something else than numpy's functions")
        self.stack.append(_Described(*arguments))

    dispatch = pickle._Unpickler.dispatch | {pickle.REDUCE[0]: load_reduce}


def _array(value: Any) -> np.ndarray:
    """Make the array that a pickle describes. Raises an error if it is not one of numbers, or if
    its bytes do not have its shape."""
    _, shape, dtype, by_column, content = value.state
    number = np.dtype("".join((dtype.state[1], dtype.arguments[0])))  # such as "<" and "c8"
    if number.kind not in "iufc":
        raise ValueError("it has an array of other objects than numbers")
    numbers = np.frombuffer(content, number)
    return numbers.reshape(tuple(map(index, shape)), order="F" if by_column else "C")
