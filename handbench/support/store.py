"""The store of finished stages on disk. Each is in a folder named by its key, the hash of
everything that its result depends on.

A stage is a function that fills a folder, declared by the decorator `stage` with the rooms whose
source it runs. Its key is made of its arguments, of the content of its inputs, of every file in
those rooms, and of the versions of the libraries. A changed input, option, source file or library
therefore never gives an outdated result.

A folder appears complete or not at all, so that an interrupted run resumes where it stopped. Its
stamp has the cost of making it, and a hash of its files, by which damage is found before they are
used.

The folder of a run, which has the store as its subfolder `work`, may come from somebody else, or be
in a folder that others share, and may have links in it. All files there are opened for writing,
listed and deleted through this module. No link inside the folder is followed; links, devices, pipes
and files of other users are refused and left unchanged. (The path of the folder itself is given by
the user, and may contain links.)
"""

import fcntl
import os
import shutil
import stat
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from dataclasses import asdict, dataclass, field
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any, NamedTuple

from handbench.support.cost import Cost, machine, measured
from handbench.support.errors import HandbenchError
from handbench.support.files import (
    TEMPORARY,
    atomic_folder,
    content_hash,
    read_json,
    writable,
    write_json,
)
from handbench.support.parallel import one_blas_thread
from handbench.support.progress import say

MARKER, WORK = ".handbench-run", "work"
STAMP = "stage.json"  # in each folder: what its files cost, and their hash
PACKAGE = Path(__file__).parents[1]
LIBRARIES = (
    "handbench",
    "numpy",
    "scipy",
    "numba",
    "open3d",
    "pycolmap",
    "opencv-contrib-python-headless",
    "h5py",
    "pillow",
    "pillow-heif",
    "rawpy",
)


class Input(NamedTuple):
    """An argument of a stage that its key knows by something else, such as a folder by the hash of
    its content.
    value: what the function receives; key: what identifies it, plain values or a hash."""

    value: Any
    key: Any


# the name of each stage, and the folders and files of handbench's source that it runs
DECLARED: dict[Callable[..., None], tuple[str, tuple[str, ...]]] = {}


def stage(name: str, *sources: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator that declares a function as a stage: it fills the folder that is its first
    argument.
    name: of the stage. sources: folders and files of handbench's source, such as "radar/data",
    whose change makes a finished stage outdated; `support` always counts."""

    def declare(function: Callable[..., None]) -> Callable[..., None]:
        DECLARED[function] = name, (*sources, "support")
        return function

    return declare


@cache
def code_key(function: Callable[..., None]) -> str:
    """Return the hash of all that a stage's function runs: the files of the sources that it
    declares, as this process first read them, and the versions of the libraries and of Python."""
    sources = {name: source_hash(name) for name in DECLARED[function][1]}
    return content_hash(sources, versions(), sys.version_info[:2])


def read_sources() -> None:
    """Hash the sources of all stages that have been declared, so that an edit during a run does not
    count as what the run's process has read."""
    for function in DECLARED:
        code_key(function)


@cache
def source_hash(name: str) -> str:
    """Return the hash of a folder or a file of handbench's source, such as "radar/data"."""
    # the rooms are in the package, or in a clone next to it
    places = (PACKAGE / name, PACKAGE.parent / name)
    return content_hash(next(place for place in places if place.exists()))


@dataclass(eq=False)
class Stage:
    """A call of a stage's function, whose result is stored on disk. Any machine that sees the files
    can carry it out.

    function: declared by `stage`; it is called with a folder to fill and `arguments`, plain values,
    of which an `Input` is known by its own key. capture, method: for which the stage works (may be
    empty). shares: it may run beside other stages, because its time is no result. code: hash of all
    code that runs. key: hash of everything on which the result depends.
    """

    function: Callable[..., None]
    arguments: dict[str, Any]
    capture: str = ""
    method: str = ""
    shares: bool = False
    code: str = field(init=False)
    key: str = field(init=False)

    def __post_init__(self) -> None:
        identity, values = _each(self.arguments, 1), _each(self.arguments, 0)
        self.code = code_key(self.function)
        self.key = content_hash(self.name, self.capture, self.method, identity, self.code)
        self.arguments = values

    @property
    def name(self) -> str:
        """The name of the stage, such as "reconstruct"."""
        return DECLARED[self.function][0]

    @property
    def label(self) -> str:
        """Name, capture and method, joined by "-". It is printed, and the name of the stage's
        folder begins with it."""
        return "-".join(part for part in (self.name, self.capture, self.method) if part)

    def folder(self, root: Path) -> Path:
        """Return the path of the folder with the result of this stage, in the store `root`."""
        return root / f"{self.label}-{self.key[:16]}"

    def output(self, root: Path, file: str = "") -> Input:
        """Return the folder of this stage, or a file in it, as the input of another stage."""
        return Input(str(self.folder(root) / file), [self.key, file])


def _each(arguments: Any, part: int) -> Any:
    """Return arguments with the value (part 0) or the key (part 1) of each `Input` in its place."""
    if isinstance(arguments, Input):
        return arguments[part]
    if isinstance(arguments, dict):
        return {name: _each(value, part) for name, value in arguments.items()}
    if isinstance(arguments, list | tuple):
        return [_each(value, part) for value in arguments]
    return arguments


def cached(root: Path, stage: Stage, facts: dict[str, Any] | None = None) -> tuple[Cost, bool]:
    """Carry out a stage, unless the store `root` has its complete result.
    facts: of this machine (None: they are measured). Returns the cost of making the result, and
    whether it was in the store already. A result whose files changed is reported and computed
    again."""
    require_owned(root)
    folder = stage.folder(root)
    if is_owned_folder(folder):
        with suppress(HandbenchError, AttributeError, TypeError):  # what is no stamp of ours
            stamp = read_json(folder / STAMP, "a stage's stamp")
            if stamp.pop("content", "") == _digest(folder, stamp):
                return Cost(**stamp), True
        say(f"{folder}: its files changed since they were written, so it is computed again")
    facts = facts or machine()  # once, before anything is timed
    with atomic_folder(folder) as temporary:
        # in a process of its own or not, sums of matrices are the same
        with measured() as cost, one_blas_thread() if stage.shares else nullcontext():
            stage.function(temporary, **stage.arguments)
        cost.machine = facts
        stamp = asdict(cost)
        write_json(temporary / STAMP, {**stamp, "content": _digest(temporary, stamp)})
    return cost, False


def _digest(folder: Path, stamp: dict[str, Any]) -> str:
    """Return the hash of a stage's result: its stamp, and the names and the content of
    its other files. Raises HandbenchError for a link or a pipe."""
    paths = [path for path in sorted(folder.rglob("*")) if require_owned(path)]
    files = [path for path in paths if path.is_file() and path.name != STAMP]
    return content_hash(
        stamp, [[path.relative_to(folder).as_posix(), content_hash(path)] for path in files]
    )


@cache
def versions() -> dict[str, str]:
    """Return the versions that every result records: library → version, for handbench and the
    libraries that it uses; without those that are not installed, which only a part of handbench
    needs."""
    installed = {}
    for name in LIBRARIES:
        with suppress(metadata.PackageNotFoundError):
            installed[name] = metadata.version(name)
    return installed


def require_owned(path: Path) -> os.stat_result | None:
    """Return the state of a file or folder (`os.lstat`); None if nothing is there.
    Raises HandbenchError for a link, a device or a pipe, and, unless this user is root, for a file
    or folder of another user."""
    try:
        found = os.lstat(path)
    except FileNotFoundError:
        return None
    ordinary = stat.S_ISREG(found.st_mode) or stat.S_ISDIR(found.st_mode)
    if not ordinary or os.geteuid() not in (0, found.st_uid):
        raise HandbenchError(
            f"{path}: is a link or a device, or belongs to another user, so handbench did not "
            "write it and does not change it; remove it, or choose another folder for -o"
        )
    return found


def is_owned_folder(path: Path) -> bool:
    """Tell whether the path is a folder of this user; False for a file, or if nothing is there.
    Raises HandbenchError for a link, a device or a pipe, and for a file or folder of another
    user."""
    found = require_owned(path)
    return found is not None and stat.S_ISDIR(found.st_mode)


def drop(folder: Path, names: Sequence[str]) -> None:
    """Delete files and folders in a folder before they are written again: those with the given
    names, in this order."""
    with writable(folder):
        for path in (folder / name for name in names):
            if is_owned_folder(path):
                shutil.rmtree(path)  # by handles: it follows no link below either
            elif require_owned(path):
                path.unlink()


@contextmanager
def locked(folder: Path) -> Iterator[Path]:
    """Context manager that keeps other runs out of a result folder. It yields the folder's
    subfolder `work`, from which temporary files of killed runs are removed. The lock ends with the
    block or the process.

    A marker file shows that a run made the folder. Raises HandbenchError if the folder has files
    but no marker, if another run is writing to it, or if something in it or in `work` is not a file
    or folder of this user.
    """
    there = [*folder.iterdir()] if folder.is_dir() else []
    if there and folder / MARKER not in there:
        raise HandbenchError(
            f"{folder}: has files that handbench did not write; choose an empty or new folder for "
            "-o"
        )
    work = folder / WORK
    with ExitStack() as ending:
        with writable(folder):
            folder.mkdir(exist_ok=True)
            for path in (folder.resolve(), *there):
                require_owned(path)
            # first: it says whose a folder without work is
            flags = os.O_WRONLY | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK
            marker = os.open(folder / MARKER, flags, 0o666)
            ending.callback(os.close, marker)
            work.mkdir(exist_ok=True)
        try:
            fcntl.flock(marker, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise HandbenchError(
                f"{folder}: another run is writing into this folder; wait until it ends, or "
                "choose another folder for -o"
            ) from None
        for path in work.iterdir():
            require_owned(path)
        _remove_temporary(work)
        ending.callback(_remove_temporary, work)
        yield work


def _remove_temporary(work: Path) -> None:
    """Remove the temporary folders of processes that were killed."""
    for path in work.glob(f".*{TEMPORARY}"):
        shutil.rmtree(path, ignore_errors=True)
