"""Limits of what is read: a file of a stranger is refused in words before it costs seconds or gigabytes. Each is far
above what handbench's own files and those of the known programs need (docs/files.md)."""

import re
from pathlib import Path
from typing import Any

from radar.support.errors import HandbenchError

MB = 2**20
TOML_BYTES = MB // 4
JSON_BYTES = 4 * MB
XML_BYTES = 4 * MB
CSV_BYTES = 4 * MB
PICKLE_BYTES = 256 * MB  # a frame of 96 × 96 × 128 numbers of complex128 takes 19 MB
MODEL_BYTES = 256 * MB  # each file of a COLMAP model
MESH_BYTES = 1024 * MB
ARRAY_BYTES = 256 * MB  # unpacked, of all arrays that are read from one .npz file
MEMBER_BYTES = 64 * MB  # unpacked, of one file in an archive

DEEPEST = 32  # lists and tables within each other
MOST_VALUES = 200_000  # of a TOML or JSON file: checking them against a configuration takes a kB each
RAW_BYTES, RAW_VALUES = 8 * MB, 500_000  # of a JSON file that is not: MAROON's holds more than is read
MOST_CELLS = 500_000  # of a CSV file
MOST_ELEMENTS = 400_000  # tags and attributes of an XML file
MOST_PROBLEMS = 1000  # that are told apart in one file
MOST_STEPS = 10_000  # of a pickle's program: a frame of MAROON takes about a hundred
MOST_MEMBERS = 1000  # of an archive

KEY = r"""(?:[\w-]+|"[^"\n]*"|'[^'\n]*')[ \t]*\.[ \t]*"""
LONG_KEY = re.compile(rf"(?<![\w-])(?:{KEY}){{{DEEPEST}}}")  # before tomllib, whose time is the square of its parts


def read_bytes(path: Path, what: str, most: int) -> bytes:
    """The content of a file of at most `most` bytes; else, and where it grows meanwhile, a HandbenchError."""
    try:
        with path.open("rb") as stream:
            require_size(path, what, most)
            size = path.stat().st_size
            content = stream.read(size + 1)
    except OSError as error:
        raise HandbenchError(f"{path}: cannot be read ({error.strerror or error}); expected {what}") from error
    if len(content) > size:
        raise HandbenchError(f"{path}: grows while it is read; expected {what}, whole: read a copy")
    return content


def read_text(path: Path, what: str, most: int) -> str:
    """The same as UTF-8 text, its line ends as \\n; ValueError for bytes that are none."""
    return read_bytes(path, what, most).decode("utf-8").replace("\r\n", "\n").replace("\r", "\n")


def require_size(path: Path, what: str, most: int) -> None:
    """Refuse a file of more bytes."""
    size = path.stat().st_size
    if size > most:
        raise HandbenchError(f"{path}: has {size} bytes; expected {what}, {most} at most: is it the right file?")


def require_plain(values: Any, most: int = MOST_VALUES) -> Any:
    """The tree of plain values; ValueError where it is deeper than DEEPEST or holds more than `most`."""
    level, count = [values], 0
    for _ in range(DEEPEST + 1):
        inner = [part.values() if isinstance(part, dict) else part for part in level if isinstance(part, dict | list)]
        level = [value for part in inner for value in part]
        count += len(level)
        if count > most:
            raise ValueError(f"it holds more than {most} values")
        if not level:
            return values
    raise ValueError(f"its values are nested deeper than {DEEPEST} levels")
