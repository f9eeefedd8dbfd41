"""The process that reads broken inputs, under a limit of memory, watched for what it opens to
write."""

from __future__ import annotations

import os
import resource
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path

from handbench.support.errors import HandbenchError
from tests.fuzz.hostile import clear, put
from tests.fuzz.readers import READERS, Reader

LARGEST_BYTES = 2**30  # that an input may take, beyond what the process has
LONGEST_S = 60.0  # of the processor, on any machine
BY_NAME = {reader.name: reader for reader in READERS}
WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
CHANGES = {
    f"os.{call}"
    for call in (
        "remove",
        "rename",
        "mkdir",
        "rmdir",
        "symlink",
        "link",
        "chmod",
        "chown",
        "truncate",
    )
}
NEVER = {
    "os.system",
    "os.exec",
    "os.posix_spawn",
    "os.fork",
    "subprocess.Popen",
    "socket.connect",
    "pickle.find_class",
}


@dataclass(frozen=True)
class Input:
    """A broken input: the reader, which of its files, and what that holds, or what stands in its
    place (link). number: what its random choices started from, beside the seed."""

    reader: str
    file: str
    content: bytes
    number: int = 0
    link: str = ""


@dataclass(frozen=True)
class Seen:
    """Outcome of reading an input. verdict: accepted, refused, exception, slow, memory, wrote;
    detail: what came."""

    verdict: str
    detail: str = ""
    peak_mb: float = 0.0


class Watch:
    """Notes every file that Python code opens to write, or changes, outside of one folder, and
    every process."""

    def __init__(self) -> None:
        self.folder: str | None = None
        self.seen: list[str] = []
        sys.addaudithook(self._event)

    def _event(self, event: str, arguments: tuple) -> None:
        if self.folder is None:
            return
        if event in NEVER:
            self.seen.append(f"{event} {arguments!r:.100}")
        elif (event == "open" and arguments[2] & WRITES) or event in CHANGES:
            named = arguments[:1] if event == "open" else arguments
            within = (
                arguments[-1] if event != "open" and arguments[-1] != -1 else None
            )  # a folder that is open
            at = os.getcwd() if within is None else os.readlink(f"/proc/self/fd/{within}")
            paths = (
                os.path.join(at, os.fsdecode(a))
                for a in named
                if isinstance(a, str | bytes | os.PathLike)
            )
            outside = (
                path
                for path in paths
                if not f"{os.path.abspath(path)}/".startswith(f"{self.folder}/")
            )
            self.seen += [f"{event} {path}" for path in outside]

    @contextmanager
    def over(self, folder: Path) -> Iterator[list[str]]:
        """Whatever is written in the block, but not in `folder`."""
        self.folder, self.seen = os.path.abspath(folder), []
        try:
            yield self.seen
        finally:
            self.folder = None


class Desk:
    """Folders with the valid inputs, below `root`; one of their files is broken at a time."""

    def __init__(self, root: Path) -> None:
        self.root, self.watch = root, Watch()

    def folder(self, reader: Reader) -> Path:
        """The reader's valid input, checked once to be accepted."""
        folder = self.root / "inputs" / reader.name
        if not folder.exists():
            folder.mkdir(parents=True)
            reader.write(folder)
            reader.read(folder)
        return folder

    def read(self, given: Input) -> Seen:
        """Have an input read."""
        reader = BY_NAME[given.reader]
        folder = self.folder(reader)
        before = self._files(folder)
        kept = (folder / given.file).read_bytes()
        if given.link:
            put(folder / given.file, given.link)
        else:
            (folder / given.file).write_bytes(given.content)
        _reset_peak()
        _limit()
        start_mb, start_s = _peak_mb(), time.process_time()
        try:
            with self.watch.over(folder) as written:
                verdict, detail = _outcome(reader, folder)
        finally:
            taken_s = time.process_time() - start_s
            if given.link:
                clear(folder / given.file)
            (folder / given.file).write_bytes(kept)
        peak_mb = _peak_mb() - start_mb
        strangers = self._files(folder) - before
        if written or strangers:
            return Seen("wrote", f"{written or sorted(strangers)}"[:300], peak_mb)
        if taken_s > LONGEST_S:
            return Seen("slow", f"{taken_s:.1f} s; {verdict} {detail}", peak_mb)
        return Seen("memory" if 2**20 * peak_mb > LARGEST_BYTES else verdict, detail, peak_mb)

    def _files(self, folder: Path) -> set[str]:
        """Every file in a reader's folder, and what lies at the root, which is the current folder
        and that of temporary files."""
        return {f"{at}/{name}" for at, _, names in os.walk(folder) for name in names} | set(
            os.listdir(self.root)
        )


def _outcome(reader: Reader, folder: Path) -> tuple[str, str]:
    try:
        reader.read(folder)
        return "accepted", ""
    except HandbenchError as error:
        if _of_memory(error):
            return "memory", f"memory ran out before it was refused: {error}"
        return "refused", str(error)
    except BaseException as error:
        last = _last_line(error)
        return "memory" if _of_memory(
            error
        ) else "exception", f"{type(error).__name__}: {error!s:.150} at {last}"


def _of_memory(error: BaseException | None) -> bool:
    while error is not None:
        if isinstance(error, MemoryError):
            return True
        error = error.__cause__ or error.__context__
    return False


def _last_line(error: BaseException) -> str:
    """The place in our own code that the exception came out of."""
    trace, found = error.__traceback__, "?"
    while trace is not None:
        path = Path(trace.tb_frame.f_code.co_filename)
        if "site-packages" not in path.parts and "lib" not in path.parts:
            found = f"{path.parent.name}/{path.name}:{trace.tb_lineno}"
        trace = trace.tb_next
    return found


def _peak_mb() -> float:
    with open("/proc/self/status", "rb") as stream:
        status = stream.read()
    return int(status[status.index(b"VmHWM:") + 6 :].split(None, 1)[0]) / 1024


def _reset_peak() -> None:
    with open("/proc/self/clear_refs", "w") as stream:
        stream.write("5")


def _limit() -> None:
    """Address space: what the process has now, and LARGEST_BYTES more."""
    with open("/proc/self/statm", "rb") as stream:
        pages = int(stream.read().split()[0])
    resource.setrlimit(
        resource.RLIMIT_AS, (pages * resource.getpagesize() + LARGEST_BYTES, resource.RLIM_INFINITY)
    )


def work(link: Connection, root: str) -> None:
    """Read the inputs that come through `link` until None comes; each answer is a Seen."""
    import cv2
    import PIL.Image

    os.chdir(root)
    tempfile.tempdir = root
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # what readers say, and the libraries below them
    cv2.setNumThreads(1)
    PIL.Image.preinit(), PIL.Image.init()
    desk = Desk(Path(root))
    for reader in READERS:
        desk.folder(reader)  # whatever is imported late is imported now
    warnings.simplefilter("error")
    link.send(Seen("ready"))
    while (given := link.recv()) is not None:
        link.send(desk.read(given))
