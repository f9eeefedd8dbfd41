"""Limits of input files, by which an untrusted file is refused before it costs seconds or
gigabytes. Each limit is far above the needs of handbench's own files and of those of other
supported programs (docs/files.md)."""

import re
from typing import Any

MB = 2**20
TOML_BYTES = MB // 4
JSON_BYTES = XML_BYTES = CSV_BYTES = 4 * MB
TABLE_BYTES = 64 * MB  # of measured samples as text
TOUCHSTONE_BYTES = 8 * MB  # 50,000 tones of two ports
# of a benchmark's table or record: a thousand captures, nine methods, three references
RESULT_BYTES = 256 * MB
RAW_JSON_BYTES = 64 * MB  # of MAROON's, which hold more than is read
# a frame of MAROON has 19, of 96 × 96 × 128 numbers; each file of COLMAP's
PICKLE_BYTES = MODEL_BYTES = 256 * MB
ARRAY_BYTES = 256 * MB  # unpacked, of what is read from one archive
KEPT_BYTES = 4096 * MB  # of one that a run keeps for itself
MESH_BYTES = PICTURE_BYTES = 1024 * MB
DEEPEST = 32  # lists and tables within each other
MOST_VALUES = 200_000  # of a JSON file: checking them against a configuration takes a kB each
RESULT_VALUES = 800_000  # of a benchmark's record
RAW_VALUES = 2_000_000  # of a JSON file that is checked against nothing
MOST_TABLES = 1000  # captures, and methods, that a benchmark names: each is opened
# what the name of no file and no path has: too many bytes, or a zero
UNFIT = re.compile(rb"[^/]{256}|.{1001}|\0", re.DOTALL)
NAME_BYTES = 100  # of a capture's or a method's: names of files have both
MOST_CELLS = 16_000_000  # of a CSV file
MOST_STEPS = 10_000  # of a pickle's program: a frame of MAROON takes about a hundred
MOST_MEMBERS = 1000  # of an archive
# tomllib is quadratic
LONG_KEY = re.compile(r"""(?<![\w-])(?:(?:[\w-]+|"[^"\n]*"|'[^'\n]*')[ \t]*\.[ \t]*){32}""")


def require_shallow(values: Any, levels: int = DEEPEST) -> Any:
    """Return `values` (plain values in lists and mappings) unchanged. Raises ValueError if they are
    nested deeper than so many levels."""
    if levels < 0:
        raise ValueError(f"its values are nested deeper than {DEEPEST} levels")
    parts = values.values() if isinstance(values, dict) else values
    for part in parts if isinstance(values, dict | list) else ():
        require_shallow(part, levels - 1)
    return values
