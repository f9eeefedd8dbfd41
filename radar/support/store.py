"""Work that is kept: folders named by the hash of everything that they depend on.

A folder appears complete or not at all, so that work that was killed goes on where it stopped, and a changed input,
option, source file or library never meets a stale result. Each holds the checksums of its files, so that a flipped bit
is found before it is taken for a result.
"""

from __future__ import annotations

import json
import os
import zlib
from collections.abc import Callable
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

from radar.support.files import atomic_folder, content_hash, write_json
from radar.support.progress import say

MANIFEST = "manifest.json"  # in each folder: size and checksum of its files
PART_BYTES = 2**22
PACKAGES = Path(__file__).parents[2]
LIBRARIES = ("handbench", "numpy", "scipy", "numba", "open3d", "pycolmap", "opencv-contrib-python-headless", "h5py")


def versions() -> dict[str, str]:
    """Versions of the libraries that a result depends on."""
    return {name: metadata.version(name) for name in LIBRARIES}


@cache  # of the code as it was when the run began, which is the code that runs
def source_hash(sources: tuple[str, ...]) -> str:
    """Hash of the Python files of packages and modules, given as paths under the installation: radar, bench/x.py."""
    files = []
    for source in sources:
        path = PACKAGES / source
        files += [path] if path.is_file() else sorted(path.rglob("*.py"))
    return content_hash(*(part for file in files for part in (str(file.relative_to(PACKAGES)), file)))


def key_of(sources: tuple[str, ...], *depends_on: Any) -> str:
    """The hash that names a folder: of what its content depends on, of the code that makes it (`sources` as for
    `source_hash`) and of the libraries' versions."""
    return content_hash(*depends_on, source_hash(sources), versions())


def keep(folder: Path, make: Callable[[Path], None]) -> bool:
    """Have make(temporary) fill a folder unless it is there already, whole; returns whether it was. What was changed
    since it was made (a disk's error, a hand's) is said, dropped and made again."""
    if folder.is_dir():
        wrong = changed(folder)
        if wrong is None:
            return True
        say(f"{folder}: {wrong}; it is made again")
    with atomic_folder(folder) as temporary:
        make(temporary)
        write_json(temporary / MANIFEST, _checksums(temporary))
    return False


def changed(folder: Path) -> str | None:
    """Which of a kept folder's files are no longer as they were made, or None."""
    try:
        expected = {name: tuple(facts) for name, facts in json.loads((folder / MANIFEST).read_bytes()).items()}
    except (OSError, ValueError, TypeError, AttributeError, RecursionError):
        return f"its {MANIFEST} is missing or broken"
    found = _checksums(folder)
    wrong = sorted(name for name in expected if expected[name] != found.get(name))
    if not wrong:
        return None
    return f"{wrong[0]}{f' and {len(wrong) - 1} more' if len(wrong) > 1 else ''} differs from what was made (checksum)"


def _checksums(folder: Path) -> dict[str, tuple[int, int]]:
    """Size and CRC-32 of every file but the manifest's own: it finds what happens by chance, and takes 0.4 s/GB."""
    files = sorted(f"{at}/{name}" for at, _, names in os.walk(folder) for name in names)
    return {os.path.relpath(file, folder): _checksum(file) for file in files if file != f"{folder}/{MANIFEST}"}


def _checksum(file: str) -> tuple[int, int]:
    size, crc = 0, 0
    with open(file, "rb", buffering=0) as stream:
        while part := stream.read(PART_BYTES):
            size, crc = size + len(part), zlib.crc32(part, crc)
    return size, crc
