"""Reading of untrusted HDF5 files: sizes that a file declares are compared with its actual size
before the HDF5 library uses them."""

import math
import zlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from handbench.support.cost import require_memory

if TYPE_CHECKING:
    import h5py

PACKED = 1100  # deflate makes nothing smaller by more
# that a data set or a piece of it may have without being looked at so closely
UNPACKED_BYTES = 2**24
DEFLATE = 1
CHECKSUM = 3
FILTERS = {DEFLATE, 2, CHECKSUM, 32000}  # HDF5's numbers of gzip, shuffle, fletcher32, lzf
CHUNKS = 2**17  # of one data set


def attribute(file: "h5py.File", name: str) -> Any:
    """Return an attribute of a file as text or a number.
    The value may be stored in an array of one element, as the C library and netCDF do. Returns None
    if there is no such attribute, or if it is of another type. Types are checked first, because the
    HDF5 library crashes on lists of a type that it does not know."""
    from h5py import h5t

    found = file.attrs.get_id(name) if name in file.attrs else None
    if found is None or found.shape is None or math.prod(found.shape) != 1:
        return None
    if found.get_type().get_class() not in (h5t.STRING, h5t.INTEGER, h5t.FLOAT):
        return None
    value = np.asarray(file.attrs[name]).item()  # as h5py, MATLAB, … write it
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

    found = local_item(file, name)
    if not isinstance(found, h5py.Dataset) or found.external or found.is_virtual:
        raise ValueError(f"'{name[:200]}' is missing or is not a data set stored in this file")
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
    require_memory(
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
    declared = math.prod(found.chunks) * found.dtype.itemsize
    packing = found.id.get_create_plist()
    packed = [packing.get_filter(k)[0] for k in range(packing.get_nfilters())]
    if not set(packed) <= FILTERS or len(set(packed)) < len(packed):
        raise ValueError(
            f"'{name}' is compressed by a filter that is not allowed; use gzip, shuffle, "
            "fletcher32 and lzf, each once"
        )
    if found.size * found.dtype.itemsize > CHUNKS * declared:
        raise ValueError(f"'{name}' has more than {CHUNKS} chunks; use larger chunks")
    pieces: list[Any] = []
    found.id.chunk_iter(pieces.append)
    # zeros: others' recordings may have ended early, a lost one of ours is damage
    if CHECKSUM in packed and len(pieces) * math.prod(found.chunks) < found.size:
        raise ValueError(f"'{name}' lacks some of its chunks")
    for piece in pieces:
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
