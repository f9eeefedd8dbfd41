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
from contextlib import ExitStack, contextmanager
from pathlib import Path

from handbench.support.errors import HandbenchError
from handbench.support.files import writable

MARKER, WORK = ".handbench-run", "work"
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
    ordinary = stat.S_ISREG(found.st_mode) or stat.S_ISDIR(found.st_mode)
    if not ordinary or os.geteuid() not in (0, found.st_uid):
        raise HandbenchError(
            f"{path}: is a link or a device, or belongs to another user, so handbench did not "
            "write it and does not change it; remove it, or choose another folder for -o"
        )


def is_owned_folder(path: Path) -> bool:
    """Tell whether the path is a folder of this user; False for a file, or if nothing is there.
    Raises HandbenchError for a link, a device or a pipe, and for a file or folder of another
    user."""
    found = require_owned(path)
    return found is not None and stat.S_ISDIR(found.st_mode)


def _open_owned(path: str, flags: int) -> int:
    """Open a file of this user, without following a link or waiting for a pipe. An `opener` of
    `open`."""
    require_owned(Path(path))
    return os.open(path, flags | os.O_NOFOLLOW | os.O_NONBLOCK, 0o666)


def drop(folder: Path, names: Sequence[str]) -> None:
    """Delete files and folders in a folder before they are written again: those with the given
    names, in this order."""
    with writable(folder, ADVICE):
        for name in names:
            _remove(folder / name)


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
    there = sorted(folder.iterdir()) if folder.is_dir() else []
    if there and folder / MARKER not in there:
        raise HandbenchError(
            f"{folder}: has files that handbench did not write; choose an empty or new folder for "
            "-o"
        )
    work = folder / WORK
    with ExitStack() as ending:
        with writable(folder, ADVICE):
            folder.mkdir(exist_ok=True)
            _refuse_foreign(folder.stat(), folder)
            for path in there:
                require_owned(path)
            # first: it says whose a folder without work is
            marker = ending.enter_context(open(folder / MARKER, "ab", opener=_open_owned))
            work.mkdir(exist_ok=True)
        try:
            fcntl.flock(marker, fcntl.LOCK_EX | fcntl.LOCK_NB)
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
        try:
            yield work
        finally:
            for path in work.glob(".*-*"):  # of processes that were killed with the run
                shutil.rmtree(path, ignore_errors=True)
