"""Reader of MATLAB files before version 7.3 (`save -v6`, `-v7`), for arrays of numbers only, after
MathWorks' "MAT-File Format". Files of version 7.3 are HDF5. (SciPy's reader, which is compiled,
crashes on some broken files.)"""

import struct
import zlib
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np

from handbench.support.files import read_bytes
from handbench.support.limits import ARRAY_BYTES, MOST_MEMBERS

ORDERS = {b"\x00\x01IM": "<", b"\x01\x00MI": ">"}  # how the header ends: version and order of bytes
# bytes, bytes, kinds of element, flag of an array
HEADER, TAG, MATRIX, COMPRESSED, COMPLEX = (128, 8, 14, 15, 0x800)
NUMBERS = range(6, 16)  # classes of arrays
KINDS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}


def read_matlab(path: Path) -> dict[str, np.ndarray]:
    """Return the numeric arrays of a MATLAB file: name → array, with the order of axes reversed, as
    in a MATLAB file stored as HDF5.
    Raises ValueError for a broken file, and for arrays that unpack to more than 256 MB
    (ARRAY_BYTES)."""
    content = memoryview(read_bytes(path, "a MATLAB file", ARRAY_BYTES))
    if (order := ORDERS.get(bytes(content[HEADER - 4 : HEADER]))) is None:
        raise ValueError("it begins like neither HDF5 (-v7.3) nor MATLAB's formats -v6 and -v7")
    found, left = dict[str, np.ndarray](), ARRAY_BYTES
    try:
        for number, (kind, element) in enumerate(_elements(content[HEADER:], order)):
            if kind == COMPRESSED:
                unpacked = memoryview(zlib.decompressobj().decompress(element, left + 1))
                left -= len(unpacked)
                kind, element = next(_elements(unpacked, order))
            if left < 0 or number > MOST_MEMBERS:
                raise ValueError(
                    f"it has more than {ARRAY_BYTES} bytes of values or {MOST_MEMBERS} variables; "
                    "save it with -v7.3"
                )
            if kind == MATRIX:
                found |= _array(element, order)
    except (
        ValueError,
        TypeError,
        KeyError,
        IndexError,
        StopIteration,
        struct.error,
        zlib.error,
    ) as error:
        raise ValueError(f"a variable in it is damaged: {error}") from None
    return found


def _elements(content: memoryview, order: str) -> Iterator[tuple[int, memoryview]]:
    """Yield the data elements that follow one another in `content`, each as its type (a number of
    the MAT-file format) and its bytes.
    order: byte order, "<" or ">"."""
    at = 0
    while at + TAG <= len(content):
        kind, size = struct.unpack_from(f"{order}II", content, at)
        if kind >> 16:
            yield kind & 0xFFFF, content[at + 4 : at + 4 + min(kind >> 16, 4)]
        else:
            yield kind, content[at + TAG : at + TAG + size]
            at += size if kind == COMPRESSED else -(-size // 8) * 8
        at += TAG


def _array(matrix: memoryview, order: str) -> dict[str, np.ndarray]:
    """Decode a MATLAB variable: {name: array}, empty for text, structures and other classes without
    numbers.
    matrix: bytes of the variable's element in the file; order: byte order, "<" or ">"."""
    (_, flags), (_, shape), (_, name), *parts = islice(_elements(matrix, order), 5)
    [kind] = np.frombuffer(flags[:4], f"{order}u4")
    if kind & 0xFF not in NUMBERS:
        return {}
    dimensions = np.frombuffer(shape, f"{order}i4")[::-1]
    arrays = [np.frombuffer(data, order + KINDS[type]).reshape(dimensions) for type, data in parts]
    # what is infinite is refused with the capture
    with np.errstate(invalid="ignore", over="ignore"):
        values = arrays[0] + 1j * arrays[1] if kind & COMPLEX else arrays[0]
    return {bytes(name).decode("ascii"): values}
