"""Checksums of a set of captures: SET/captures/NAME/FILE → a line of SET/checksums.txt, as
`sha256sum -c` reads it."""

import hashlib
import re
from pathlib import Path

from handbench.support.errors import HandbenchError
from handbench.support.files import read_text, write_text
from handbench.support.limits import CSV_BYTES

CAPTURES, CHECKSUMS = "captures", "checksums.txt"
LINE = re.compile(r"([0-9a-f]{64})  (.+)")


def write_checksums(folder: Path) -> None:
    """Write checksums.txt into a set's folder: the checksums of the files of all its captures."""
    sums = _sums(folder, folder / CAPTURES)
    write_text(folder / CHECKSUMS, "".join(f"{digest}  {name}\n" for name, digest in sums.items()))


def require_unchanged(capture: Path) -> None:
    """Raise a HandbenchError if files of a capture differ from the checksums of the set that it
    lies in. Does nothing if there are none."""
    folder = capture.parent.parent
    file = folder / CHECKSUMS
    if capture.parent.name != CAPTURES or not file.is_file():
        return
    listed = {
        name: digest
        for name, digest in _read(file).items()
        if name.startswith(f"{CAPTURES}/{capture.name}/")
    }
    found = _sums(folder, capture) if listed else {}
    for name in sorted(listed | found):
        if listed.get(name) != found.get(name):
            what = (
                "is missing"
                if name not in found
                else "has other content"
                if name in listed
                else "is not in it"
            )
            raise HandbenchError(
                f"{capture}: differs from {file}: {name} {what}; copy the capture again"
            )


def _sums(folder: Path, below: Path) -> dict[str, str]:
    """SHA-256 of every file below a folder, by the file's path in it."""
    sums = {}
    for path in sorted(path for path in below.rglob("*") if path.is_file()):
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
            f"{file}: is not readable ({error}); expected lines of sha256sum"
        ) from None
    found = {}
    for number, line in enumerate(lines, 1):
        if (match := LINE.fullmatch(line)) is None:
            raise HandbenchError(
                f"{file}: line {number} is no SHA-256 with a file's name; copy the file again"
            )
        found[match[2]] = match[1]
    return found
