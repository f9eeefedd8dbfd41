"""Checksums of a set of captures.

The set's folder has one folder for each capture, captures/NAME, and a file checksums.txt with a
SHA-256 checksum for every file of its captures, in the format of `sha256sum -c`.
"""

import hashlib
import os
import re
from pathlib import Path

from handbench.support.errors import HandbenchError
from handbench.support.files import read_text, write_text
from handbench.support.limits import CSV_BYTES

CAPTURES, CHECKSUMS = "captures", "checksums.txt"
LINE = re.compile(r"([0-9a-f]{64}) [ *](?:\./)?(.+)")


def write_checksums(folder: Path) -> None:
    """Write checksums.txt into a set's folder, with the SHA-256 checksums of all files of its
    captures."""
    sums = _sums(folder, folder / CAPTURES)
    write_text(folder / CHECKSUMS, "".join(f"{digest}  {name}\n" for name, digest in sums.items()))


def require_unchanged(path: Path) -> None:
    """Compare a capture's folder, or one file of a capture, with the checksums of the set that
    contains it. Raises HandbenchError if they differ; does nothing if the set has no checksums."""
    path = Path(os.path.abspath(path))
    sets = (above.parent for above in path.parents[:2] if above.name == CAPTURES)
    folder = next((each for each in sets if (each / CHECKSUMS).is_file()), None)
    if folder is None:
        return
    file, own = folder / CHECKSUMS, path.relative_to(folder).as_posix()
    listed = {
        name: digest
        for name, digest in _read(file).items()
        if name == own or name.startswith(f"{own}/")
    }
    found = _sums(folder, path) if listed else {}
    for name in sorted(listed | found):
        if listed.get(name) != found.get(name):
            what = (
                "is missing"
                if name not in found
                else "has changed"
                if name in listed
                else "is not listed there"
            )
            raise HandbenchError(
                f"{path}: does not match the checksums in {file}: {name} {what}; copy the capture "
                "again"
            )


def listed_captures(folder: Path) -> list[str]:
    """Return the names of the captures in a set's folder that its checksums.txt lists; if the set
    has no checksums yet, of all captures.

    Captures that somebody added later are left out. Raises HandbenchError if a listed capture has a
    file that is not listed.
    """
    there = sorted(path.name for path in (folder / CAPTURES).iterdir())
    if not (folder / CHECKSUMS).is_file():
        return there
    listed = _read(folder / CHECKSUMS)
    names = [n for n in there if any(line.startswith(f"{CAPTURES}/{n}/") for line in listed)]
    for path in (path for name in names for path in (folder / CAPTURES / name).rglob("*")):
        if path.is_file() and path.relative_to(folder).as_posix() not in listed:
            raise HandbenchError(
                f"{path}: is not listed in {folder / CHECKSUMS}, so it does not belong to the "
                "data set; move it out of the folder"
            )
    return names


def _sums(folder: Path, below: Path) -> dict[str, str]:
    """Compute the SHA-256 checksum of the file `below`, or of every file in that folder. Returns
    the checksums by the file's path relative to `folder`."""
    sums = {}
    for path in sorted(path for path in (below, *below.rglob("*")) if path.is_file()):
        with path.open("rb") as stream:
            sums[path.relative_to(folder).as_posix()] = hashlib.file_digest(
                stream, "sha256"
            ).hexdigest()
    return sums


def _read(file: Path) -> dict[str, str]:
    try:
        lines = read_text(file, "checksums", CSV_BYTES).splitlines()
    except ValueError as error:
        raise HandbenchError(
            f"{file}: is not readable ({error}); expected lines as sha256sum writes them"
        ) from None
    found = {}
    for number, line in enumerate(lines, 1):
        if (match := LINE.fullmatch(line)) is None:
            raise HandbenchError(
                f"{file}: line {number} is not a SHA-256 checksum with a file name; copy the file "
                "again"
            )
        found[match[2]] = match[1]
    return found
