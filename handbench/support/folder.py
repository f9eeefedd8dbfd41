"""The folders that a run fills: what it opens for writing, lists or deletes there goes through
here.

Whoever sends a result folder, or shares the folder above it, may have put links into it. Nothing
here follows one: a link, a device or a pipe, and what belongs to another user, is refused in words,
and stays as it is. (The folder's own path is what the user wrote, and may lead through links.)
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
ADVICE = "free the space or choose another -o"


def require_owned(path: Path) -> os.stat_result | None:
    """The state of a path, which is not followed: a file or a folder of this user (root: anyone's),
    or None. What else stands there is a HandbenchError."""
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
        what = f"another user's (number {found.st_uid})"
    else:
        return
    raise HandbenchError(
        f"{path}: is {what}, which no run wrote; it is left alone: remove it, or choose another -o"
    )


def is_owned_folder(path: Path) -> bool:
    """True where a folder of this user stands at a path, which is not followed; see `own`."""
    found = require_owned(path)
    return found is not None and stat.S_ISDIR(found.st_mode)


def read_owned(path: str | Path) -> Iterator[bytes]:
    """A file's content in parts of PART_BYTES; see `own`. FileNotFoundError where there is none."""
    handle = _open_owned(path, os.O_RDONLY)
    try:
        while part := os.read(handle, PART_BYTES):
            yield part
    finally:
        os.close(handle)


def _open_owned(path: str | Path, flags: int) -> int:
    """The handle of a file of this user, which is neither followed nor waited for; HandbenchError
    for anything else."""
    try:
        handle = os.open(path, flags | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC, 0o666)
    except OSError:
        require_owned(Path(path))  # says what stands there, where that is the reason
        raise
    try:
        _refuse_foreign(os.fstat(handle), Path(path))
    except HandbenchError:
        os.close(handle)
        raise
    return handle


def drop(folder: Path, names: Sequence[str]) -> None:
    """Remove what is about to be written anew under these names, in their order, and what a killed
    run left of it half-written."""
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
    """Hold a result folder for this run alone and yield its `work` folder, cleared of what killed
    runs left.

    A marker says that a run made the folder: one without it that holds anything is a stranger's and
    is left alone. Everything in it and in `work` has to be this user's own file or folder. The lock
    falls with the process, however it ends.
    """
    if folder.exists() and not folder.is_dir():
        raise HandbenchError(
            f"{folder}: is a file; expected a folder for the results: choose another -o"
        )
    there = sorted(folder.iterdir()) if folder.is_dir() else []
    if there and folder / MARKER not in there:
        raise HandbenchError(
            f"{folder}: holds files that no run wrote; choose an empty or new folder for -o"
        )
    work = folder / WORK
    with writable(folder, ADVICE):
        if folder.is_dir():
            _refuse_foreign(folder.stat(), folder)
        for path in there:
            require_owned(path)
        folder.mkdir(parents=True, exist_ok=True)
        handle = _open_owned(
            folder / MARKER, os.O_WRONLY | os.O_CREAT
        )  # first: it says whose a folder without work is
    try:
        with writable(folder, ADVICE):
            work.mkdir(exist_ok=True)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise HandbenchError(
                f"{folder}: another run is writing here; wait for it or choose another -o"
            ) from None
        for path in sorted(work.iterdir()):
            if path.name.startswith(".") and "-" in path.name:
                _remove(path)
            else:
                require_owned(path)
        yield work
    finally:
        os.close(handle)
