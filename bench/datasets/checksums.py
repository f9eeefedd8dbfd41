"""Checksums of a set of captures: SET/captures/NAME/FILE → a line of SET/checksums.txt, as
`sha256sum -c` reads it."""

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
    """Write checksums.txt into a set's folder: the checksums of the files of all its captures."""
    sums = _sums(folder, folder / CAPTURES)
    write_text(folder / CHECKSUMS, "".join(f"{digest}  {name}\n" for name, digest in sums.items()))


def require_unchanged(path: Path) -> None:
    """Raise a HandbenchError if a capture's folder, or one of its files, differs from the checksums
    of the set that contains the capture. Does nothing if there are none."""
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
    """Return the names of the captures in a set's folder that its checksums list, without the
    captures that somebody added; all of them while there are no checksums yet. Raises a
    HandbenchError if a listed capture has a file that is not listed."""
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
    """SHA-256 of a file in a folder, or of every file below one, by the file's path in `folder`."""
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
