"""Arrays in other programs' files (HDF5, MATLAB, NumPy, tables of text), read by name."""

import re
import struct
import zlib
from collections.abc import Collection, Iterable
from io import BytesIO
from pathlib import Path

import numpy as np

from handbench.radar.data.hdf5 import local_item, read
from handbench.support.errors import HandbenchError
from handbench.support.files import (
    ARRAY_BYTES,
    MOST_CELLS,
    TABLE_BYTES,
    inside,
    read_array,
    read_bytes,
    read_npz,
    read_text,
    require_file,
)

TABLES = (".csv", ".tsv", ".txt", ".dat")
WHAT = "the HDF5, MATLAB, NumPy or text file that mapping.toml names"
INDEX = re.compile(r"\[([\d:, -]+)\]$")
IMAGINARY = re.compile(r"(?<=[\d.])i\b")  # of a complex number as MATLAB writes it
NUMBER = re.compile(r"[-+.(\d]")  # how one begins
# how the header of a MATLAB file ends: version and order of bytes
MATLAB = {b"\x00\x01IM": "<", b"\x01\x00MI": ">"}
HEADER, TAG, MATRIX, COMPRESSED = 128, 8, 14, 15  # bytes, bytes, kinds of element
KINDS = (*range(1, 8), 9, 12, 13, MATRIX, 16, 17, 18)


def read_named(folder: Path, text: str, file: str | None, skip_lines: int) -> np.ndarray:
    """Read the array of a name: "NAME" in `file`, "FILE:NAME" or, of a file that is one array,
    "FILE", each perhaps followed by an index as Python writes it ("[:, 0]", "[::4]").

    skip_lines: lines at the beginning of a text file that are left out. Raises HandbenchError for a
    file outside the folder, for one that cannot be read, and for one without such an array.
    """
    index = INDEX.search(text)
    place, colon, name = (text[: index.start()] if index else text).partition(":")
    if not colon and Path(place).suffix.lower() not in (".npy", *TABLES):
        place, name = file or "", place
    if not place:
        raise HandbenchError(
            f'\'{text[:200]}\' names no file; expected "FILE:NAME", or file = "FILE" at the top'
        )
    path = require_file(inside(folder, place, "mapping.toml"), WHAT)
    try:
        values = _read(path, name, skip_lines)
        if index:
            values = values[tuple(_slice(word) for word in index[1].split(","))]
        if not values.dtype.hasobject:
            return values
        numbers = np.array([_number(cell) for cell in values.flat]).reshape(values.shape)
        return numbers if numbers.imag.any() else numbers.real
    except HandbenchError:
        raise
    except Exception as error:  # the errors of SciPy's and NumPy's parsers have no common base
        reason = " ".join(str(error).split())[:300]
        raise HandbenchError(
            f"{path}: '{text[:200]}' cannot be read ({reason}); correct mapping.toml, or save the "
            "file again"
        ) from error


def _number(cell: str) -> complex:
    """Parse a cell of a table of text. Raises ValueError for anything but a number."""
    try:
        return complex(cell)
    except ValueError:
        raise ValueError(
            f"its cell '{cell}' is no number; write numbers with a point, or leave lines out by "
            "skip_lines"
        ) from None


def _slice(word: str) -> int | slice:
    """Parse one axis of an index: a whole number, or start:stop:step."""
    numbers = [int(part) if part.strip() else None for part in word.split(":")]
    return slice(*numbers) if ":" in word else int(word)


def _read(path: Path, name: str, skip_lines: int) -> np.ndarray:
    """Read the array of a name from a file; the whole content of one that is a single array."""
    import h5py

    kind = path.suffix.lower()
    if kind in TABLES:
        return _read_table(path, name, skip_lines)
    if kind == ".npy":
        with path.open("rb") as stream:
            return read_array(stream, path.stat().st_size)
    if kind == ".npz":
        return read_npz(path, (name,))[name]
    if not h5py.is_hdf5(path):
        return _read_matlab(path, name)
    with h5py.File(path, "r") as file:
        if local_item(file, name) is None:
            raise _missing(path, name, file)
        return read(file, name, path)


def _missing(path: Path, name: str, names: Iterable[str]) -> HandbenchError:
    shown = ", ".join(sorted(names)[:12]) or "no data sets"
    return HandbenchError(f"{path}: has no '{name[:200]}'; the file has {shown[:600]}")


def _read_matlab(path: Path, name: str) -> np.ndarray:
    """Read a variable of a MATLAB file before version 7.3 (`save -v6`, `-v7`), with the order of
    axes reversed, as in a MATLAB file stored as HDF5. A field of a structure is
    "structure/field"."""
    from scipy.io import loadmat

    content = read_bytes(path, "a MATLAB file", ARRAY_BYTES)
    order = MATLAB.get(content[HEADER - 4 : HEADER])
    if order is None:
        raise ValueError(
            "it begins like neither HDF5 (-v7.3) nor MATLAB's formats -v6 and -v7; the name of a "
            f"text file ends in {', '.join(TABLES)}"
        )
    _require_harmless(content[HEADER:], order, (MATRIX, COMPRESSED))
    variable, *fields = name.split("/")
    variables = loadmat(BytesIO(content))
    if variable not in variables:
        raise _missing(path, name, [key for key in variables if not key.startswith("__")])
    values = variables[variable]
    for field in fields:
        values = values[field].item()
    return values.T


def _require_harmless(content: bytes, order: str, kinds: Collection[int]) -> None:
    """Raise ValueError for elements of a MATLAB file that unpack to more than ARRAY_BYTES, since
    SciPy unpacks any number of bytes, and for one of an unknown kind, on which SciPy crashes.

    order: of bytes, "<" or ">". kinds: those that are allowed outside of arrays.
    """
    at, left = 0, ARRAY_BYTES
    while at + TAG <= len(content):
        kind, size = struct.unpack_from(f"{order}II", content, at)
        if kind >> 16:  # a short element, within its tag
            kind, size = kind & 0xFFFF, 0
        if kind not in kinds:
            raise ValueError(f"it has an element of the unknown kind {kind}")
        at += TAG
        element = content[at : at + size]
        at += size if kind == COMPRESSED else -(-size // TAG) * TAG
        if kind == COMPRESSED:
            element = zlib.decompressobj().decompress(element, left + 1)
            left -= len(element)
            if left < 0:
                raise ValueError(f"it unpacks to more than {ARRAY_BYTES} bytes; save it with -v7.3")
        if kind in (COMPRESSED, MATRIX):
            _require_harmless(element, order, KINDS)


def _read_table(path: Path, title: str, skip_lines: int) -> np.ndarray:
    """Read the cells of a text file [line, column], or, if a title is given, of one column [line],
    as text. Columns are divided by commas, semicolons, tabs or blanks; a first line without numbers
    has their titles."""
    text = read_text(path, "a table of numbers", TABLE_BYTES)
    if sum(map(text.count, ",;\n")) > MOST_CELLS:
        raise ValueError(f"it has more than {MOST_CELLS} cells")
    text = IMAGINARY.sub("j", text)
    lines = [line.strip("#%! ") for line in text.split("\n")[skip_lines:] if line.strip()]
    mark = next((mark for mark in ",;\t" if mark in lines[-1]), None)
    rows = [[cell.strip(' "') for cell in line.split(mark)] for line in lines]
    titles = [] if any(map(NUMBER.match, rows[0])) else rows.pop(0)
    cells = np.array(rows, dtype=object)
    if cells.ndim != 2:
        raise ValueError("its lines have different numbers of columns; skip_lines leaves out some")
    if title and title not in titles:
        raise _missing(path, title, titles or ["text without titles; choose columns by [:, 0]"])
    return cells[:, titles.index(title)] if title else cells
