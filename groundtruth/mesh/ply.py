"""Reader and writer of PLY files that use numpy only. Before memory is taken for the content of a
file, its header is compared with its size."""

import codecs
import re
import struct
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

# vertices, and faces: ten times what the finest scans have, and a few GB of memory
MOST = 50_000_000
LONGEST_HEADER = 65_536  # bytes
ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
LETTERS = "bBhHiIfd"  # of struct and numpy, for:
TYPES = dict(
    zip(
        ["char", "uchar", "short", "ushort", "int", "uint", "float", "double"], LETTERS, strict=True
    )
)
TYPES |= dict(
    zip(
        ["int8", "uint8", "int16", "uint16", "int32", "uint32", "float32", "float64"],
        LETTERS,
        strict=True,
    )
)
CORNERS = ("vertex_indices", "vertex_index")


class PlyProperty(NamedTuple):
    """One property of an element in a PLY file, such as the x of its vertices.

    type: of the values. length: type of the number of values, if each row has a list of them, else
    None. Both types are a byte order and a letter that `struct` and numpy understand, such as "<f".
    """

    name: str
    type: str
    length: str | None


@dataclass(frozen=True)
class PlyElement:
    """One element of a PLY file, which is a table such as that of its vertices: the name, the
    number of rows, and the properties (columns)."""

    name: str
    count: int
    properties: list[PlyProperty]

    def dtype(self, lengths: dict[str, int]) -> np.dtype:
        """Return numpy's type of one row. lengths: number of values in each property that is a
        list, by the property's name."""
        fields: list[tuple[str, str] | tuple[str, str, tuple[int, ...]]] = []
        for p in self.properties:
            fields += [] if p.length is None else [(f"length of {p.name}", p.length)]
            fields.append((p.name, p.type, () if p.length is None else (lengths[p.name],)))
        return np.dtype(fields)

    def lists(self) -> list[str]:
        """Return the names of the properties that have a list of values in each row."""
        return [p.name for p in self.properties if p.length is not None]


def read_ply(path: Path) -> tuple[dict[str, np.ndarray], list[np.ndarray]]:
    """Read an ASCII or binary PLY file.

    Returns the vertices' properties, arrays [n] by name (with x, y and z among them), and the
    faces, one array [count, corners] of vertex indices for each number of corners. Raises
    ValueError unless the file has exactly the content that its header declares. Whether coordinates
    and indices make sense is not checked.
    """
    content = path.read_bytes().removeprefix(codecs.BOM_UTF8)
    if content.startswith(b"ply\r") and content[4:5] != b"\n":  # lines end as on the first Macs
        head, end, body = content.partition(b"\rend_header\r")
        content = (head + end).replace(b"\r", b"\n") + body
    order, elements, start = _header(content)
    body = _numbers(content[start:]).tobytes() if order == ORDERS["ascii"] else content[start:]
    vertices, faces, offset = {}, list[np.ndarray](), 0
    for element in elements:
        rows, offset = _rows(element, body, offset)
        if element.name == "vertex":
            vertices = {p.name: rows[p.name] for p in element.properties if p.length is None}
        if element.name == "tristrips" and element.count:
            raise ValueError("its faces are triangle strips, which are not read; export triangles")
        if element.name == "face":
            faces = _groups(next((rows[name] for name in CORNERS if name in element.lists()), []))
    if body[offset:].strip():
        raise ValueError(
            f"{len(body) - offset} bytes follow after the data that its header declares"
        )
    if not {"x", "y", "z"} <= vertices.keys():
        raise ValueError("its vertices have no x, y or z")
    return vertices, faces


def write_ply(path: Path, columns: dict[str, np.ndarray], faces: np.ndarray) -> None:
    """Write a binary PLY file. columns: the vertices' properties [n] by name, float32 or float64;
    faces [m, 3]: triangles of vertex indices."""
    kinds = {"f": "float", "d": "double"}
    layout = np.dtype([(name, column.dtype) for name, column in columns.items()])
    vertices = np.empty(len(next(iter(columns.values()))), layout)
    for name, column in columns.items():
        vertices[name] = column
    triangles = np.empty(len(faces), [("count", "u1"), ("corners", "<i4", 3)])
    triangles["count"], triangles["corners"] = 3, faces
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {len(vertices)}",
        *(f"property {kinds[column.dtype.char]} {name}" for name, column in columns.items()),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "end_header\n",
    ]
    path.write_bytes("\n".join(header).encode() + vertices.tobytes() + triangles.tobytes())


def _header(content: bytes) -> tuple[str, list[PlyElement], int]:
    """Parse the header of a PLY file.

    Returns the byte order, the declared elements (tables), and the offset in bytes at which their
    rows begin. Numbers of an ASCII file are later converted to doubles, so its properties get that
    type. Raises ValueError for a header that is not PLY.
    """
    head, found, _ = content[:LONGEST_HEADER].partition(b"\nend_header")
    start = content.find(b"\n", len(head) + 1) + 1
    lines = head.decode("latin-1").split("\n")
    if (
        not found
        or content[len(head) + 1 : start].strip() != b"end_header"
        or lines[0].strip() != "ply"
    ):
        raise ValueError(
            f"it has no header from 'ply' to 'end_header' in its first {LONGEST_HEADER} bytes"
        )
    order, known = "", TYPES
    elements: list[PlyElement] = []
    for number, line in enumerate(lines[1:], 2):
        match line.split():
            case [] | ["comment" | "obj_info", *_]:
                pass
            case ["format", name, "1.0"] if name in ORDERS and not order and not elements:
                order, known = ORDERS[name], dict.fromkeys(TYPES, "d") if name == "ascii" else TYPES
            case ["element", name, count] if (
                count.isascii() and count.isdigit() and len(count) < 10
            ):
                elements.append(PlyElement(name, int(count), []))
            case ["property", "list", length, kind, name] if (
                elements and {length, kind} <= TYPES.keys()
            ):
                if TYPES[length] in "fd":
                    raise ValueError(
                        f"the length of a list of element '{elements[-1].name}' is not declared "
                        "as a whole number"
                    )
                elements[-1].properties.append(
                    PlyProperty(name, order + known[kind], order + known[length])
                )
            case ["property", kind, name] if elements and kind in TYPES:
                elements[-1].properties.append(PlyProperty(name, order + known[kind], None))
            case _:
                raise ValueError(f"line {number} of its header, '{line.strip()[:60]}', is not PLY")
    if not order:
        raise ValueError(f"its header has no format; expected one of {', '.join(ORDERS)}")
    for element in elements:
        if len({p.name for p in element.properties}) < len(element.properties):
            raise ValueError(f"a property of element '{element.name}' is declared twice")
        if element.count > MOST:
            raise ValueError(
                f"its header declares {element.count} of '{element.name}', more than {MOST}"
            )
    if len({element.name for element in elements}) < len(elements):
        raise ValueError("an element is declared twice")
    return order, elements, start


def _numbers(text: bytes) -> np.ndarray:
    """Parse a text of numbers that are separated by blanks or line ends, to float64 [n]. Raises
    ValueError if the text contains anything else."""
    # older numpy only warns of words
    with warnings.catch_warnings(action="error", category=DeprecationWarning):
        try:
            return np.fromstring(text, sep=" ") if text.strip() else np.zeros(0)
        except (DeprecationWarning, ValueError):
            commas = " (it has decimal commas)" if re.search(rb"\d,\d", text) else ""
            raise ValueError(f"a value after its header is not a number{commas}") from None


def _rows(element: PlyElement, body: bytes, offset: int) -> tuple[dict[str, Any], int]:
    """Read the rows of one element (table), which begin at the byte `offset` of `body`.

    Returns the columns by name, and the offset at which the rows end. A property that is a list
    becomes an array [rows, length] if all lists have the same length, else a list of tuples. Raises
    ValueError if the file is too short.
    """
    least = element.dtype(dict.fromkeys(element.lists(), 0)).itemsize
    room = len(body) - offset
    if element.count * least > room:
        raise ValueError(
            f"its header declares {element.count} of '{element.name}', which need at least "
            f"{element.count * least} bytes, but only {room} follow"
        )
    if element.count == 0 or least == 0:
        return {p.name: [] if p.length else np.zeros(0) for p in element.properties}, offset
    [(first, _)] = _walk(element, body, offset, 1)
    lengths = {name: len(first[name]) for name in element.lists()}
    dtype = element.dtype(lengths)
    if element.count * dtype.itemsize <= room:
        rows = np.frombuffer(body, dtype, element.count, offset)
        if all((rows[f"length of {name}"] == length).all() for name, length in lengths.items()):
            return {p.name: rows[p.name] for p in element.properties}, offset + rows.nbytes
    if element.count > 500_000:  # each is read by itself
        raise ValueError(
            f"its {element.count} of '{element.name}' have lists of different lengths; "
            "triangulate the mesh"
        )
    walked, ends = zip(*_walk(element, body, offset, element.count), strict=True)
    columns = {p.name: [row[p.name] for row in walked] for p in element.properties}
    return {
        p.name: columns[p.name] if p.length else np.array(columns[p.name])
        for p in element.properties
    }, ends[-1]


def _walk(
    element: PlyElement, body: bytes, offset: int, count: int
) -> Iterator[tuple[dict[str, Any], int]]:
    """Read the first `count` rows of an element (table) one by one, from the byte `offset` of
    `body`.

    Yields for each row its values by property name, and the offset at which the row ends. Raises
    ValueError if the file is too short.
    """
    for _ in range(count):
        row = {}
        try:
            for name, kind, length in element.properties:
                size = 1
                if length is not None:
                    (size,) = struct.unpack_from(length, body, offset)
                    if not 0 <= size <= len(body) or size != int(size):
                        raise ValueError(f"a list of '{element.name}' has the length {size:g}")
                    offset += struct.calcsize(length)
                form = f"{kind[0]}{int(size)}{kind[1]}"
                values = struct.unpack_from(form, body, offset)
                row[name] = values[0] if length is None else values
                offset += struct.calcsize(form)
        except struct.error:
            raise ValueError(
                f"it ends before all {element.count} of '{element.name}' that its header declares"
            ) from None
        yield row, offset


def _groups(polygons: np.ndarray | list[tuple[float, ...]]) -> list[np.ndarray]:
    """Group polygons by their number of corners. Returns arrays [count, corners] of vertex indices,
    those with the fewest corners first. Raises ValueError for an index that is not a whole
    number."""
    if isinstance(polygons, np.ndarray) and polygons.ndim == 2:
        groups = [polygons]
    else:
        lengths = sorted({len(corners) for corners in polygons})
        groups = [np.array([p for p in polygons if len(p) == length]) for length in lengths]
    for corners in groups:
        if (
            corners.dtype.kind == "f"
            and not ((np.abs(corners) < 2**53) & (corners == np.floor(corners))).all()
        ):
            raise ValueError("a face has a vertex number that is not a whole number")
    return [corners.astype(np.int64) for corners in groups]
