"""Reader and writer of PLY files."""

import re
from pathlib import Path

import numpy as np

from handbench.support.files import atomic_path

NO_SCALE = "comment handbench, no scale"
HEADER = re.compile(rb"ply\r?\n(.*?\n)end_header\r?\n", re.DOTALL)
ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
WRITTEN_TYPES = {
    "i1": "char",
    "u1": "uchar",
    "i2": "short",
    "u2": "ushort",
    "i4": "int",
    "u4": "uint",
    "f4": "float",
    "f8": "double",
}
# the types are also called int8 to float64
TYPES = {
    name: kind for kind in WRITTEN_TYPES for name in (WRITTEN_TYPES[kind], np.dtype(kind).name)
}

Properties = dict[str, list[str]]  # numpy's type of each; of a list, the type of its length before


def by_axis(vectors: np.ndarray, prefix: str = "") -> dict[str, np.ndarray]:
    """Return the columns of vectors [n, 3] by the names x, y and z, each after `prefix`."""
    return {f"{prefix}{axis}": vectors[:, k] for k, axis in enumerate("xyz")}


def write_ply(
    path: str | Path, columns: dict[str, np.ndarray], faces: np.ndarray, scaled: bool = True
) -> None:
    """Write a binary PLY file atomically. columns: the vertices' properties [n] by name; faces [m,
    3]: triangles of vertex indices; scaled: False if the vertices are not in metres. Raises
    HandbenchError if the file cannot be written."""
    row = np.dtype([(name, column.dtype) for name, column in columns.items()])
    vertices = np.rec.fromarrays([*columns.values()], dtype=row)
    triangles = np.rec.fromarrays([np.full(len(faces), 3, "u1"), *faces.T.astype("i4")])
    header = [
        "ply",
        "format binary_little_endian 1.0",
        "comment handbench, metres" if scaled else NO_SCALE,
        f"element vertex {len(vertices)}",
        *(f"property {WRITTEN_TYPES[row[name].str[1:]]} {name}" for name in columns),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "end_header\n",
    ]
    with atomic_path(path) as temporary:
        temporary.write_bytes("\n".join(header).encode() + vertices.tobytes() + triangles.tobytes())


def read_ply(content: bytes) -> tuple[dict[str, np.ndarray], list[np.ndarray]]:
    """Parse a PLY file, text or binary.

    Returns the vertices' properties, arrays [n] by name, and the faces, one array [count, corners]
    of vertex indices. Raises ValueError, LookupError or OverflowError unless the file has exactly
    the rows that its header declares, and all its faces have the same number of corners.
    """
    header = HEADER.match(content)
    if header is None:
        raise ValueError("it has no header of a PLY file")
    order, elements = _elements(header[1].decode("latin-1"))
    body = content[header.end() :]
    if order == ORDERS["ascii"]:
        body = np.array(body.split(), np.float64).tobytes()
    tables = {}
    offset = 0
    for name, (count, properties) in elements.items():
        if count:
            tables[name] = _rows(properties, count, body, offset)
            offset += tables[name].nbytes
    if body[offset:].strip():
        raise ValueError(f"{len(body) - offset} bytes follow after its last row")
    faces = tables["face"]
    name = "vertex_index" if "vertex_index" in elements["face"][1] else "vertex_indices"
    return {key: tables["vertex"][key] for key in elements["vertex"][1]}, [faces[name]]


def _elements(header: str) -> tuple[str, dict[str, tuple[int, Properties]]]:
    """Parse a header. Returns numpy's sign of the byte order, and the number of rows and the
    properties of each element (table); those of a text are doubles, as it is parsed."""
    order, types = "", TYPES
    elements: dict[str, tuple[int, Properties]] = {}
    properties: Properties = {}
    for line in header.split("\n"):
        match line.split():
            case ["format", name, _]:
                order = ORDERS[name]
                if name == "ascii":
                    types = dict.fromkeys(TYPES, "f8")
            case ["element", name, count]:
                properties = {}
                elements[name] = int(count), properties
            case ["property", *words, name]:
                properties[name] = [order + types[word] for word in words if word != "list"]
    return order, elements


def _rows(properties: Properties, count: int, body: bytes, offset: int) -> np.ndarray:
    """Read `count` rows of a table, which begin at the byte `offset` of `body`, as a structured
    array. Raises ValueError if rows are missing or differ in the lengths of their lists."""
    row = _row_type(properties, body, offset)
    if offset + count * row.itemsize > len(body):
        raise ValueError("it ends before its last row")
    rows = np.frombuffer(body, row, count, offset)
    for name, types in properties.items():
        if len(types) == 2 and (rows[f"length of {name}"] != rows[name].shape[1]).any():
            raise ValueError(f"the lists '{name}' differ in length; export it with triangles only")
    return rows


def _row_type(properties: Properties, body: bytes, offset: int) -> np.dtype:
    """Return numpy's type of the row at the byte `offset` of `body`, in which the length of each
    list is a field before its values."""
    fields: list[tuple[str, str, tuple[int, ...]]] = []
    for name, (*lengths, kind) in properties.items():
        shape: tuple[int, ...] = ()
        for length in lengths:
            start = offset + np.dtype(fields).itemsize
            shape = (int(np.frombuffer(body, length, 1, start)[0]),)
            fields.append((f"length of {name}", length, ()))
        fields.append((name, kind, shape))
    return np.dtype(fields)
