"""Reader of one radar frame of MAROON: a numpy file with a pickled dictionary, read without running
any code in it.

The echoes `xr`, by MAROON's public code, are [receiver, transmitter, frequency] of 96 × 96
antennas. Antennas 1 to 94 of both are used; these are `radar.data.arrays.qar50` in its order.
MAROON images them by Σ xr·e^{+j2πfτ}, so an echo is e^{−j2πfτ}, as in handbench, and nothing is
conjugated. Pairs of antennas that the radar could not use may be zero, and stay zero.

A pickle is a program that may call any function that it can name. This reader allows it five names
and replaces each by a harmless class or function of this module, which checks the description of an
array and makes the array from its plain bytes. Python's own unpickler is used, because the one in C
reserves as much memory as a number in the file says. A few hundred bytes can describe a tuple of
2⁶⁰ elements, which hashing or printing would walk through. Therefore keys must be text, only the
opcodes that arrays and plain values need are accepted, and their number is limited.
"""

import math
import pickle
import pickletools
import re
from collections.abc import Callable
from dataclasses import dataclass
from io import BytesIO
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from handbench.radar.data.capture import as_complex64
from handbench.support.errors import HandbenchError
from handbench.support.files import read_bytes
from handbench.support.limits import MOST_STEPS, PICKLE_BYTES

ANTENNAS, USED = 96, slice(1, 95)
RADAR_HZ = (1e9, 1e12)  # range of a list of frequencies in hertz
MOST = 1_000_000  # frames that six digits number
NUMBERS = re.compile(r"b1|[iu][1248]|f[248]|c(8|16)")  # what an array may hold
PLAIN = (np.generic, bool, int, float, str, type(None))
WHAT = "a radar frame of MAROON (a pickled dictionary of arrays of numbers)"


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
    content = read_dictionary(file)
    frequencies_hz, xr = _frequencies_hz(file, content), _numbers(file, content, "xr")
    expected = ANTENNAS, ANTENNAS, len(frequencies_hz)
    if xr.dtype.kind != "c" or xr.shape != expected:
        raise HandbenchError(
            f"{file}: 'xr' is {xr.dtype} {xr.shape}; expected complex numbers {expected} [rx, "
            "tx, f]"
        )
    count = _numbers(file, content, "number_of_measurements")
    if count.size != 1 or count.dtype.kind not in "fiu" or not 1 <= count.item() <= MOST:
        raise HandbenchError(
            f"{file}: 'number_of_measurements' is {count}; expected a number of frames from 1 to "
            f"{MOST}"
        )
    samples = as_complex64(xr[USED, USED].transpose(2, 1, 0))
    return Frame(samples, frequencies_hz, int(count.item()))


def _frequencies_hz(file: Path, content: dict[str, Any]) -> np.ndarray:
    fvec, (low_hz, high_hz) = _numbers(file, content, "fvec").reshape(-1), RADAR_HZ
    if fvec.dtype.kind not in "fiu" or not ((fvec > low_hz) & (fvec < high_hz)).all():
        raise HandbenchError(
            f"{file}: 'fvec' is {fvec.dtype} from {fvec.min():.4g} to {fvec.max():.4g}; expected "
            f"frequencies from {low_hz:g} to {high_hz:g} Hz"
        )
    return fvec.astype(np.float64)


def _numbers(file: Path, content: dict[str, Any], key: str) -> np.ndarray:
    """Return the entry `key` of a frame's dictionary as an array of numbers. Raises HandbenchError
    if it is missing, empty or not numeric; file: named in the message."""
    if key not in content:
        raise HandbenchError(
            f"{file}: has no '{key}'; expected fvec, xr and number_of_measurements"
        )
    value = np.asarray(content[key])
    if value.dtype.kind not in "biufc" or value.size == 0:
        raise HandbenchError(f"{file}: '{key}' is {value.dtype} {value.shape}; expected numbers")
    return value


def read_dictionary(path: str | Path) -> dict[str, Any]:
    """Read the dictionary in a pickled .npy file, without calling any function that the file names.

    Values may be arrays of numbers, scalars, text and None. Raises HandbenchError for any other
    content.
    """
    content = read_bytes(path, WHAT, PICKLE_BYTES)
    try:
        return _unpickle(content)
    except Exception as error:  # broken pickles raise whatever the opcode at hand stumbles over
        reason = " ".join(str(error).split()) or type(error).__name__
        raise HandbenchError(
            f"{path}: was not read ({reason[:200]}); expected {WHAT}; download it again"
        ) from error


def _unpickle(content: bytes) -> dict[str, Any]:
    stream = BytesIO(content)
    version = np.lib.format.read_magic(stream)
    read_header = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }[version]
    shape, _, dtype = read_header(stream)
    if not dtype.hasobject or dtype.names or shape != ():
        raise ValueError(f"it is an array {dtype} {shape}, not a dictionary")
    start = stream.tell()
    if sum(1 for _ in islice(pickletools.genops(stream), MOST_STEPS + 1)) > MOST_STEPS:
        raise ValueError("its pickle has too many steps")
    stream.seek(start)
    outermost = _Unpickler(stream).load()
    held = outermost.objects[0] if isinstance(outermost, _Array) and outermost.objects else None
    if not isinstance(held, dict):
        raise ValueError("it is not a dictionary")
    return {key: _checked(key, value) for key, value in held.items()}


def _checked(key: Any, value: Any) -> Any:
    if not isinstance(key, str):
        raise ValueError(f"a key is of type {type(key).__name__}, not text")
    if isinstance(value, _Array) and value.numbers is not None:
        return value.numbers
    if isinstance(value, PLAIN):
        return value
    kinds = {_Array: "an array of objects", _Table: "dict"}
    kind = kinds.get(type(value), type(value).__name__)
    raise ValueError(f"'{key}' is {kind}")


class _Dtype:
    """Replacement for numpy.dtype while unpickling: a type of numbers with its byte order, or the
    type "object" of the outermost array."""

    def __init__(self, name: str, *_: bool) -> None:
        if name not in ("O", "O8") and not (isinstance(name, str) and NUMBERS.fullmatch(name)):
            raise ValueError(
                f"it has numbers of type {name[:40]!r}"
                if isinstance(name, str)
                else ("it has numbers of no type")
            )
        self.name, self.order = name, "="

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        if state[1] not in ("<", ">", "=", "|") or any(part is not None for part in state[2:5]):
            raise ValueError("it has structured numbers")
        self.order = state[1]

    def numbers(self, content: bytes, count: int) -> np.ndarray:
        """Convert bytes to an array of exactly `count` numbers of this type. Raises ValueError if
        the length does not match."""
        dtype = np.dtype(self.name).newbyteorder(self.order)
        if (
            dtype.hasobject
            or not isinstance(content, bytes)
            or len(content) != count * dtype.itemsize
        ):
            raise ValueError(f"an array has not the bytes of {count} numbers of type {self.name}")
        return np.frombuffer(content, dtype)


class _Array:
    """Replacement for numpy.ndarray while unpickling: an array of numbers (attribute `numbers`), or
    the outermost array, which has one object (attribute `objects`)."""

    def __init__(self, *_: Any) -> None:
        self.numbers: np.ndarray | None = None
        self.objects: list[Any] = []

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        _, shape, dtype, by_column, content = state
        if (
            len(shape) > 32
            or any(not isinstance(n, int) or n < 0 for n in shape)
            or not isinstance(dtype, _Dtype)
        ):
            raise ValueError("it has an array without shape or type")
        if dtype.name.startswith("O"):
            if shape != () or not isinstance(content, list) or len(content) != 1:
                raise ValueError("it has an array of objects")
            self.objects = content
        else:
            self.numbers = dtype.numbers(content, math.prod(shape)).reshape(
                shape, order="F" if by_column else "C"
            )


def _scalar(dtype: _Dtype, content: bytes) -> np.generic:
    """Replacement for numpy.core.multiarray.scalar while unpickling: make a number from its
    bytes."""
    return dtype.numbers(content, 1)[0]


@dataclass(frozen=True)
class _Name:
    """Replacement for a function or class that the pickle names. It can only be called, and then
    calls `make`; any attempt of the pickle to change it is refused."""

    make: Callable[..., Any]

    def __call__(self, *arguments: Any) -> Any:
        return self.make(*arguments)

    def __setstate__(self, state: Any) -> None:
        raise ValueError("it changes a function")


CORES = ("numpy.core.multiarray", "numpy._core.multiarray")  # before numpy 2, and since
NAMES = {("numpy", "dtype"): _Dtype, ("numpy", "ndarray"): _Array} | {
    (core, name): make
    for core in CORES
    for name, make in (("_reconstruct", _Array), ("scalar", _scalar))
}


KNOWN = (
    "PROTO FRAME STOP MARK GLOBAL STACK_GLOBAL REDUCE BUILD PUT GET BINPUT BINGET LONG_BINPUT "
    "LONG_BINGET MEMOIZE "
    "NONE NEWTRUE NEWFALSE INT BININT BININT1 BININT2 LONG1 BINFLOAT EMPTY_TUPLE TUPLE TUPLE1 "
    "TUPLE2 TUPLE3 "
    "EMPTY_LIST APPEND APPENDS EMPTY_DICT SETITEM SETITEMS BINUNICODE SHORT_BINUNICODE BINBYTES "
    "SHORT_BINBYTES"
)


class _Table(dict[str, Any]):
    """A dictionary that refuses keys other than text, so that the pickle cannot make anything else
    be hashed."""

    def __setitem__(self, key: Any, value: Any) -> None:
        if not isinstance(key, str):
            raise ValueError(f"a key is of type {type(key).__name__}, not text")
        super().__setitem__(key, value)


def _call(unpickler: Any) -> None:
    """Execute the opcode REDUCE, which calls a name with arguments from the unpickler's stack.

    Raises ValueError if the value is not an allowed name. The message does not contain the value,
    since printing it could take forever.
    """
    arguments, name = unpickler.stack.pop(), unpickler.stack[-1]
    if not isinstance(name, _Name) or not isinstance(arguments, tuple):
        raise ValueError("it calls something that is not a known function")
    unpickler.stack[-1] = name(*arguments)


CODES = [getattr(pickle, name)[0] for name in KNOWN.split()]
STEPS: dict[int, Callable[[Any], None]] = {code: pickle._Unpickler.dispatch[code] for code in CODES}
STEPS[pickle.REDUCE[0]] = _call
STEPS[pickle.EMPTY_DICT[0]] = lambda unpickler: unpickler.append(_Table())


class _Unpickler(pickle._Unpickler):
    """An unpickler that accepts only a fixed list of names and of opcodes."""

    dispatch = STEPS

    def find_class(self, module: str, name: str) -> _Name:
        if (module, name) not in NAMES:
            raise ValueError(f"it uses {module[:80]}.{name[:80]}, which is not allowed")
        return _Name(NAMES[module, name])
