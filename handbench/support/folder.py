"""Access to the result folder of a run: all files there are opened for writing, listed and deleted
through this module.

Somebody who sends a result folder, or who shares its parent folder, may have put links into it. No
link inside the folder is followed. Links, devices, pipes, and files of other users are refused and
left unchanged. (The path of the folder itself is given by the user, and may contain links.)
"""

import fcntl
import os
import shutil
import stat
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from handbench.support.errors import HandbenchError
from handbench.support.files import writable

MARKER, WORK = ".handbench-run", "work"
PART_BYTES = 2**22
ADVICE = "free space on the disk, or choose another folder for -o"


def require_owned(path: Path) -> os.stat_result | None:
    """Return the state of a file or folder (`os.lstat`); None if nothing is there.
    Raises HandbenchError for a link, a device or a pipe, and, unless this user is root, for a file
    or folder of another user."""
    try:
        found = os.lstat(path)
    except FileNotFoundError:
        return None
    _refuse_foreign(found, path)
    return found


def _refuse_foreign(found: os.stat_result, path: Path) -> None:
    if stat.S_ISLNK(found.st_mode):
        what = "a link"
    elif not stat.S_ISREG(found.st_mode) and not stat.S_ISDIR(found.st_mode):
        what = "neither a file nor a folder"
    elif os.geteuid() not in (0, found.st_uid):
        what = f"a file or folder of another user (user ID {found.st_uid})"
    else:
        return
    raise HandbenchError(
        f"{path}: is {what}, so handbench did not write it and does not change it; remove it, or "
        "choose another folder for -o"
    )


def is_owned_folder(path: Path) -> bool:
    """Tell whether the path is a folder of this user; False for a file, or if nothing is there.
    Raises HandbenchError for a link, a device or a pipe, and for a file or folder of another
    user."""
    found = require_owned(path)
    return found is not None and stat.S_ISDIR(found.st_mode)


def read_owned(path: str | Path) -> Iterator[bytes]:
    """Yield the content of a file in blocks of 4 MB (PART_BYTES).
    Raises FileNotFoundError if there is no file, and HandbenchError for a link, a device or a pipe,
    and for a file of another user."""
    handle = _open_owned(path, os.O_RDONLY)
    try:
        while part := os.read(handle, PART_BYTES):
            yield part
    finally:
        os.close(handle)


def _open_owned(path: str | Path, flags: int) -> int:
    """Open a file and return its descriptor, without following a link or waiting for a pipe.
    flags: those of `os.open`. Raises HandbenchError for anything but a file or folder of this
    user."""
    try:
        handle = os.open(path, flags | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC, 0o666)
    except OSError:
        require_owned(Path(path))  # explains what is there, if that is the reason
        raise
    try:
        _refuse_foreign(os.fstat(handle), Path(path))
    except HandbenchError:
        os.close(handle)
        raise
    return handle


def drop(folder: Path, names: Sequence[str]) -> None:
    """Delete files and folders in a folder before they are written again: those with the given
    names, in this order, and temporary files for these names that a killed run left."""
    half_written = [
        p
        for p in folder.iterdir()
        if any(p.name.startswith(f".{Path(name).stem}-") for name in names)
    ]
    with writable(folder, ADVICE):
        for path in [folder / name for name in names] + half_written:
            _remove(path)


def _remove(path: Path) -> None:
    if is_owned_folder(path):
        shutil.rmtree(path)  # by handles: it follows no link below either
    elif require_owned(path) is not None:
        path.unlink(missing_ok=True)


@contextmanager
def locked(folder: Path) -> Iterator[Path]:
    """Context manager that keeps other runs out of a result folder. It yields the folder's
    subfolder `work`, from which temporary files of killed runs are removed. The lock ends with the
    block or the process.

    A marker file shows that a run made the folder. Raises HandbenchError if the folder has files
    but no marker, if another run is writing to it, or if something in it or in `work` is not a file
    or folder of this user.
    """
    if folder.exists() and not folder.is_dir():
        raise HandbenchError(
            f"{folder}: is a file, but the results need a folder; choose another folder for -o"
        )
    there = sorted(folder.iterdir()) if folder.is_dir() else []
    if there and folder / MARKER not in there:
        raise HandbenchError(
            f"{folder}: has files that handbench did not write; choose an empty or new folder for "
            "-o"
        )
    work = folder / WORK
    with writable(folder, ADVICE):
        if folder.is_dir():
            _refuse_foreign(folder.stat(), folder)
        for path in there:
            require_owned(path)
        folder.mkdir(parents=True, exist_ok=True)
        # first: it says whose a folder without work is
        handle = _open_owned(folder / MARKER, os.O_WRONLY | os.O_CREAT)
    try:
        with writable(folder, ADVICE):
            work.mkdir(exist_ok=True)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise HandbenchError(
                f"{folder}: another run is writing into this folder; wait until it ends, or "
                "choose another folder for -o"
            ) from None
        for path in sorted(work.iterdir()):
            if path.name.startswith(".") and "-" in path.name:
                _remove(path)
            else:
                require_owned(path)
        yield work
    finally:
        os.close(handle)
