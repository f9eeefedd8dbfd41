"""PLY files, read with numpy alone: what a header promises is compared with the file before anything is believed."""

from __future__ import annotations

import struct
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

MOST = 50_000_000  # vertices, and faces: ten times what the finest scans have, and a few GB of memory
MOST_CORNERS = 1000  # of a polygon
LONGEST_HEADER = 65_536  # bytes
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
TYPES = {
    "char": "i1",
    "int8": "i1",
    "uchar": "u1",
    "uint8": "u1",
    "short": "i2",
    "int16": "i2",
    "ushort": "u2",
    "uint16": "u2",
    "int": "i4",
    "int32": "i4",
    "uint": "u4",
    "uint32": "u4",
    "float": "f4",
    "float32": "f4",
    "double": "f8",
    "float64": "f8",
}
CORNERS = ("vertex_indices", "vertex_index")


@dataclass(frozen=True)
class Property:
    """A column: numpy's types of its values and, if each row has a list of them, of the list's length."""

    name: str
    type: str
    length: str | None = None


@dataclass
class Element:
    """A table: its name, its number of rows, its columns."""

    name: str
    count: int
    properties: list[Property]

    def dtype(self, lengths: dict[str, int]) -> np.dtype:
        """One row, its lists as long as `lengths` says."""
        fields: list[tuple] = []
        for p in self.properties:
            shape = () if p.length is None else (lengths[p.name],)
            fields += [] if p.length is None else [(f"length of {p.name}", p.length)]
            fields.append((p.name, p.type, shape))
        return np.dtype(fields)

    def lists(self) -> list[str]:
        """The names of the columns of lists."""
        return [p.name for p in self.properties if p.length is not None]


def read_ply(path: Path) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """The numbers [n] that each vertex of a PLY file carries, by name (x, y, z among them), and its faces' vertices
    [m, 3], polygons cut into fans; ASCII or binary. Raises ValueError unless the file holds exactly what its header
    promises. What the numbers are is the caller's to check."""
    content = path.read_bytes()
    order, elements, start = _header(content)
    body = content[start:] if order else _numbers(content[start:]).tobytes()
    vertices, faces, offset = {}, np.zeros((0, 3), np.int64), 0
    for element in elements:
        rows, offset = _rows(element, body, offset)
        if element.name == "vertex":
            vertices = {p.name: rows[p.name] for p in element.properties if p.length is None}
        if element.name == "face":
            faces = _fans(next((rows[name] for name in CORNERS if name in element.lists()), []))
    if body[offset:].strip():
        raise ValueError(f"{len(body) - offset} bytes follow what its header promises")
    if not {"x", "y", "z"} <= vertices.keys():
        raise ValueError("its vertices lack x, y or z")
    return vertices, faces


def _header(content: bytes) -> tuple[str, list[Element], int]:
    """The byte order ("" for ASCII), the elements, and where their rows begin."""
    head, found, _ = content[:LONGEST_HEADER].partition(b"\nend_header")
    start = content.find(b"\n", len(head) + 1) + 1
    lines = head.decode("latin-1").split("\n")
    if not found or content[len(head) + 1 : start].strip() != b"end_header" or lines[0].strip() != "ply":
        raise ValueError(f"no header from 'ply' to 'end_header' in its first {LONGEST_HEADER} bytes")
    order, elements = None, []
    for number, line in enumerate(lines[1:], 2):
        match line.split():
            case [] | ["comment" | "obj_info", *_]:
                pass
            case ["format", name, "1.0"] if name in ORDERS and order is None:
                order = ORDERS[name]
            case ["element", name, count] if count.isascii() and count.isdigit() and len(count) < 10:
                elements.append(Element(name, int(count), []))
            case ["property", "list", length, kind, name] if elements and {length, kind} <= TYPES.keys():
                elements[-1].properties.append(Property(name, TYPES[kind], TYPES[length]))
            case ["property", kind, name] if elements and kind in TYPES:
                elements[-1].properties.append(Property(name, TYPES[kind]))
            case _:
                raise ValueError(f"line {number} of its header is '{line.strip()[:60]}', which is no PLY")
    if order is None:
        raise ValueError(f"its header names no format; expected one of {', '.join(ORDERS)}")
    _check(elements)
    types = {"type": "f8", "length": "f8"} if order == "" else {}  # of ASCII all numbers are read alike
    for element in elements:
        element.properties = [
            Property(p.name, types.get("type", order + p.type), p.length and types.get("length", order + p.length))
            for p in element.properties
        ]
    return order, elements, start


def _check(elements: list[Element]) -> None:
    for element in elements:
        names = [p.name for p in element.properties]
        if len(set(names)) < len(names):
            raise ValueError(f"a property of element '{element.name}' is declared twice")
        if element.count > MOST:
            raise ValueError(f"its header promises {element.count} of '{element.name}'; at most {MOST} are read")
        if any(p.length is not None and "f" in p.length for p in element.properties):
            raise ValueError(f"a list of element '{element.name}' has a length that is no whole number")
    names = [element.name for element in elements]
    if len(set(names)) < len(names):
        raise ValueError("an element is declared twice")


def _numbers(text: bytes) -> np.ndarray:
    """All numbers of a text, float64."""
    with warnings.catch_warnings(action="error", category=DeprecationWarning):  # older numpy only warns of words
        try:
            return np.fromstring(text, sep=" ") if text.strip() else np.zeros(0)
        except (DeprecationWarning, ValueError):
            raise ValueError("what follows its header is not numbers alone") from None


def _rows(element: Element, body: bytes, offset: int) -> tuple[dict, int]:
    """The columns of an element whose rows begin at `offset`, and where they end. Lists of one length are an array
    [rows, length], others a list of tuples."""
    least = element.dtype(dict.fromkeys(element.lists(), 0)).itemsize
    room = len(body) - offset
    if element.count * least > room:
        raise ValueError(
            f"its header promises {element.count} of '{element.name}', at least {element.count * least} bytes, "
            f"but {room} follow"
        )
    if element.count == 0 or least == 0:
        return {p.name: np.zeros(0) for p in element.properties}, offset
    [(first, _)] = _walk(element, body, offset, 1)
    lengths = {name: len(first[name]) for name in element.lists()}
    dtype = element.dtype(lengths)
    if element.count * dtype.itemsize <= room:
        rows = np.frombuffer(body, dtype, element.count, offset)
        if all((rows[f"length of {name}"] == length).all() for name, length in lengths.items()):
            return {p.name: rows[p.name] for p in element.properties}, offset + rows.nbytes
    columns: dict[str, list] = {p.name: [] for p in element.properties}
    for row, end in _walk(element, body, offset, element.count):
        offset = end
        for name, value in row.items():
            columns[name].append(value)
    return {p.name: columns[p.name] if p.length else np.array(columns[p.name]) for p in element.properties}, offset


def _walk(element: Element, body: bytes, offset: int, count: int) -> Iterator[tuple[dict, int]]:
    """Row for row, each with where it ends."""
    codes = {"i1": "b", "u1": "B", "i2": "h", "u2": "H", "i4": "i", "u4": "I", "f4": "f", "f8": "d"}
    shape = [
        (p.name, "=" if len(p.type) == 2 else p.type[0], codes[p.type[-2:]], p.length and codes[p.length[-2:]])
        for p in element.properties
    ]
    for _ in range(count):
        row = {}
        try:
            for name, order, code, length in shape:
                if length is None:
                    (row[name],) = struct.unpack_from(order + code, body, offset)
                    offset += struct.calcsize(order + code)
                    continue
                (size,) = struct.unpack_from(order + length, body, offset)
                if not 0 <= size <= len(body) or size != int(size):
                    raise ValueError(f"a list of '{element.name}' has {size:g} entries")
                offset += struct.calcsize(order + length)
                row[name] = struct.unpack_from(f"{order}{int(size)}{code}", body, offset)
                offset += struct.calcsize(f"{order}{int(size)}{code}")
        except struct.error:
            raise ValueError(f"it ends amid the {element.count} of '{element.name}' that its header promises") from None
        yield row, offset


def _fans(polygons: np.ndarray | list) -> np.ndarray:
    """Polygons' corners as triangles [m, 3], each polygon a fan about its first corner."""
    groups = [polygons] if isinstance(polygons, np.ndarray) else _by_length(polygons)
    parts = [np.zeros((0, 3), np.int64)]
    for corners in groups:
        if len(corners) == 0:
            continue
        if not 3 <= corners.shape[1] <= MOST_CORNERS:
            raise ValueError(f"a face has {corners.shape[1]} corners; expected 3 to {MOST_CORNERS}")
        if corners.dtype.kind == "f" and not ((np.abs(corners) < 2**53) & (corners == np.floor(corners))).all():
            raise ValueError("a face names a vertex by what is no whole number")
        corners = corners.astype(np.int64)
        ends = [corners[:, (0, k, k + 1)] for k in range(1, corners.shape[1] - 1)]
        parts.append(np.stack(ends, axis=1).reshape(-1, 3))
    return np.concatenate(parts)


def _by_length(polygons: list) -> list[np.ndarray]:
    lengths = {len(corners) for corners in polygons}
    return [np.array([corners for corners in polygons if len(corners) == length]) for length in sorted(lengths)]
