"""Reading of untrusted HDF5 files: sizes that a file declares are compared with its actual size
before the HDF5 library uses them."""

import mmap
import os
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from handbench.support.cost import require_free

if TYPE_CHECKING:
    import h5py

PACKED = 1100  # deflate makes nothing smaller by more
# that a data set or a piece of it may have without being looked at so closely
UNPACKED_BYTES = 2**24
DEFLATE = 1
FILTERS = {DEFLATE: "gzip", 2: "shuffle", 3: "fletcher32", 32000: "lzf"}  # HDF5's numbers
HEAP = b"GCOL\x01\0\0\0"  # begins a collection of texts and other things without a fixed length
CHUNKS = 2**17  # of one data set


@contextmanager
def open_hdf5(path: Path) -> "Iterator[h5py.File]":
    """Context manager that yields an HDF5 file, open for reading. Raises ValueError for a file on
    which the HDF5 library would loop forever."""
    import h5py

    with path.open("rb") as stream:
        if os.fstat(stream.fileno()).st_size:
            with mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as content:
                _check_heaps(content)
    with h5py.File(path, "r") as file:
        yield file


def _check_heaps(content: mmap.mmap) -> None:
    """Raise a ValueError if a heap (HDF5's collection of texts) has an object of size 0, because
    the HDF5 library (2.0) loops forever on it.
    content: the bytes of the file."""
    at = content.find(HEAP)
    while at >= 0:
        end = min(at + int.from_bytes(content[at + 8 : at + 16], "little"), len(content))
        place = at + 16
        while place + 16 <= end:
            number, _, _, size = struct.unpack("<HHIQ", content[place : place + 16])
            place += size if number == 0 else 16 + (size + 7) // 8 * 8
            if number == 0 and size == 0:
                raise ValueError("its storage of texts (an HDF5 heap) is damaged")
        at = content.find(HEAP, at + 8)


def attribute(file: "h5py.File", name: str) -> Any:
    """Return an attribute of a file as text or a number.
    The value may be stored in an array of one element, as the C library and netCDF do. Returns None
    if there is no such attribute, or if it is of another type. Types are checked first, because the
    HDF5 library crashes on lists of a type that it does not know."""
    from h5py import h5t

    if name not in file.attrs:
        return None
    found = file.attrs.get_id(name)
    if found.shape is None or any(length != 1 for length in found.shape):
        return None
    if found.get_type().get_class() not in (h5t.STRING, h5t.INTEGER, h5t.FLOAT):
        return None
    value = file.attrs[name]  # as h5py, MATLAB, … write it
    if isinstance(value, np.ndarray | np.generic):
        value = value.item()
    return value.decode("utf-8") if isinstance(value, bytes) else value


def local_item(file: "h5py.File", name: str) -> Any:
    """Return the group or data set with a name such as "a/b", if it is stored in this file. Returns
    None if there is none, or if a soft or external link leads to it."""
    import h5py

    found: Any = file
    for part in filter(None, name.split("/")):
        if not isinstance(found, h5py.Group) or not isinstance(
            found.get(part, getlink=True), h5py.HardLink
        ):
            return None
        found = found[part]
    return found


def read(file: "h5py.File", name: str, path: Path) -> np.ndarray:
    """Return a whole data set of numbers as an array.
    path: of the file, for its size and for messages. Raises ValueError for anything but numbers
    stored in this file, and for a data set that claims more bytes than the file can contain. Raises
    HandbenchError for a data set that does not fit into memory."""
    import h5py

    if (found := local_item(file, name)) is None:
        raise ValueError(f"'{name[:200]}' is missing (links to other files are not followed)")
    if not isinstance(found, h5py.Dataset) or found.external or found.is_virtual:
        raise ValueError(f"'{name[:200]}' is not a data set stored in this file")
    if found.dtype.hasobject or found.shape is None:
        raise ValueError(f"'{name}' has values of type {str(found.dtype)[:80]}; expected numbers")
    size = found.size * found.dtype.itemsize
    stored = min(found.id.get_storage_size(), path.stat().st_size)
    if size > (stored if found.chunks is None else max(UNPACKED_BYTES, PACKED * stored)):
        raise ValueError(
            f"'{name}' has shape {found.shape} and {size} bytes by its header, but the file has "
            f"only {stored} bytes for it"
        )
    if found.chunks is not None:
        _check_pieces(found, name)
    require_free(
        2 * size,
        f"{path}: '{name}' {found.shape}",
        "end other programs, or cut the file into parts",
    )
    return found[()]


def _check_pieces(found: "h5py.Dataset", name: str) -> None:
    """Check the compressed chunks of a data set, in which HDF5 stores it.
    name: of the data set, for messages. Raises ValueError for a chunk that unpacks to more bytes
    than declared, for which the HDF5 library would take all memory; for too many chunks; and for an
    unknown compression."""
    if -(-found.size // max(int(np.prod(found.chunks)), 1)) > CHUNKS:
        raise ValueError(
            f"'{name}' has shape {found.shape} in chunks of {found.chunks}, which are too many; "
            "use larger chunks"
        )
    packing = found.id.get_create_plist()
    packed = [packing.get_filter(k)[0] for k in range(packing.get_nfilters())]
    if not set(packed) <= FILTERS.keys() or len(set(packed)) < len(packed):
        raise ValueError(
            f"'{name}' is compressed by a filter that is not allowed; use "
            f"{', '.join(FILTERS.values())}, each once"
        )
    declared = int(np.prod(found.chunks)) * found.dtype.itemsize
    pieces: list[Any] = []
    found.id.chunk_iter(pieces.append)
    for piece in pieces:
        if piece.size > 2 * declared + 1024:
            raise ValueError(
                f"a chunk of '{name}' takes {piece.size} bytes, too many for {declared} bytes of "
                "values"
            )
        # the mask's are left out
        deflated = DEFLATE in packed and not piece.filter_mask >> packed.index(DEFLATE) & 1
        if deflated and piece.size * PACKED > UNPACKED_BYTES:
            _, content = found.id.read_direct_chunk(piece.chunk_offset)
            try:
                unpacked = len(zlib.decompressobj().decompress(content, declared + 5))
            except zlib.error as error:
                raise ValueError(f"a chunk of '{name}' cannot be decompressed ({error})") from None
            if unpacked > declared + 4:  # and a checksum
                raise ValueError(
                    f"a chunk of '{name}' decompresses to more than its {declared} bytes"
                )
