"""Names that become parts of file names."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator


def checked_name(name: str) -> str:
    """`name` if it can be part of a file name: it neither leaves its folder, nor hides, nor holds our '__'."""
    unfit = not name.isprintable() or name.startswith(".") or any(part in name for part in ("/", "\\", "__"))
    if unfit or not 1 <= len(name) <= 80:
        raise ValueError(f"{name[:80]!r} cannot name a file; use 1 to 80 letters, digits, '-' and single '_'")
    return name


Name = Annotated[str, AfterValidator(checked_name)]  # of a capture, a benchmark, …
