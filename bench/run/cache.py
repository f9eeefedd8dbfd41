"""The folder that a run fills: held for it alone, cleared of what killed runs left."""

from __future__ import annotations

import fcntl
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

from radar.support.errors import HandbenchError

MARKER = ".handbench-run"


def drop(folder: Path, names: Sequence[str]) -> None:
    """Remove what is about to be written anew under these names, in their order, and what a killed run left of it
    half-written."""
    half_written = [p for p in folder.iterdir() if any(p.name.startswith(f".{Path(name).stem}-") for name in names)]
    try:
        for path in [folder / name for name in names] + half_written:
            if path.is_dir():
                shutil.rmtree(path)
            else:
                path.unlink(missing_ok=True)
    except OSError as error:
        raise HandbenchError(f"{folder}: cannot be written ({error.strerror or error}); choose another -o") from error


@contextmanager
def claimed(folder: Path) -> Iterator[Path]:
    """Hold a result folder for this run alone and yield its `work` folder, cleared of what killed runs left.

    A marker says that a run made the folder: one without it that holds anything is a stranger's and is left alone.
    The lock falls with the process, however it ends.
    """
    if folder.exists() and not folder.is_dir():
        raise HandbenchError(f"{folder}: is a file; expected a folder for the results: choose another -o")
    if folder.is_dir() and not (folder / MARKER).exists() and any(folder.iterdir()):
        raise HandbenchError(f"{folder}: holds files that no run wrote; choose an empty or new folder for -o")
    work = folder / "work"
    with _marked(folder, work) as stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise HandbenchError(f"{folder}: another run is writing here; wait for it or choose another -o") from None
        for leftover in work.glob(".*-*"):
            shutil.rmtree(leftover) if leftover.is_dir() else leftover.unlink()
        yield work


def _marked(folder: Path, work: Path) -> TextIO:
    """The folder's marker, open to be locked; the folders are made where they are missing."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        stream = (folder / MARKER).open("w")  # first, so that a folder without work is still known as a run's
    except OSError as error:
        raise _unwritable(folder, error) from error
    try:
        work.mkdir(exist_ok=True)
    except OSError as error:
        stream.close()
        raise _unwritable(folder, error) from error
    return stream


def _unwritable(folder: Path, error: OSError) -> HandbenchError:
    reason = error.strerror or error
    return HandbenchError(f"{folder}: cannot be written ({reason}); free the space or choose another -o")
