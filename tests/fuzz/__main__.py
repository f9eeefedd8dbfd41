"""`python -m tests.fuzz`: broken and hostile inputs of all readers, each read in a process under a
limit of memory and time, which is watched for what it opens to write."""

from __future__ import annotations

import argparse
import base64
import json
import multiprocessing
import os
import random
import resource
import sys
import tempfile
import time
import warnings
import zlib
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from unittest.mock import patch

import cv2

from handbench.support.errors import HandbenchError
from handbench.support.progress import say
from tests.fuzz.mutate import LINKS, clear, mutated, put
from tests.fuzz.readers import READERS, Reader

LARGEST_BYTES = 2**30  # that an input may take, beyond what the process has
LONGEST_S = 60.0  # of the processor, on any machine
HANG_S = 300.0  # on the clock: other programs may take the processor
LINKED = 0.03  # of the inputs something else stands in the place of a file
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")
FINE = ("accepted", "refused")
WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
CHANGES = {"os.remove", "os.rename", "os.mkdir", "os.rmdir", "os.symlink", "os.link", "os.truncate"}
NEVER = {
    "os.system",
    "os.exec",
    "os.fork",
    "subprocess.Popen",
    "socket.connect",
    "pickle.find_class",
}


@dataclass(frozen=True)
class Input:
    """A broken input: the reader, which of its files, and what that holds, or what stands in its
    place (link)."""

    reader: str
    file: str
    content: bytes
    link: str = ""


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
        opened = event == "open" and arguments[2] & WRITES
        if event in NEVER:
            self.seen.append(f"{event} {arguments!r:.100}")
        elif opened or event in CHANGES:
            # the last argument of a change may be an open folder, which paths are relative to
            opened_at = arguments[-1] if event != "open" and arguments[-1] != -1 else None
            at = os.getcwd() if opened_at is None else os.readlink(f"/proc/self/fd/{opened_at}")
            paths = arguments[: 1 if opened else None]
            if event == "os.symlink":  # whose first argument is what the link holds
                paths = arguments[1:]
            for name in paths:
                if isinstance(name, str | bytes | os.PathLike):
                    path = os.path.abspath(os.path.join(at, os.fsdecode(name)))
                    if not f"{path}/".startswith(f"{self.folder}/"):
                        self.seen.append(f"{event} {path}")


def status_bytes(name: str) -> int:
    """A figure of this process's memory."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if line.startswith(name))


def read(reader: Reader, folder: Path, given: Input, watch: Watch) -> tuple[str, str]:
    """Have an input read: the verdict (one of FINE, exception, slow, memory, wrote), and why."""
    path, names = folder / given.file, {str(p) for p in folder.rglob("*")}
    kept = path.read_bytes()
    if given.link:
        put(path, given.link)
    else:
        path.write_bytes(given.content)
    Path("/proc/self/clear_refs").write_text("5")  # the peak starts from here
    room = status_bytes("VmSize:") + LARGEST_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (room, resource.RLIM_INFINITY))
    start_bytes, start_s = status_bytes("VmHWM:"), time.process_time()
    watch.folder, watch.seen, error = os.path.abspath(folder), [], None
    try:
        reader.read(folder)
    except BaseException as raised:
        error = raised
    watch.folder, taken_s = None, time.process_time() - start_s
    verdict, why = ("refused" if error else "accepted"), f"{type(error).__name__}: {error!s:.150}"
    if error is not None and not isinstance(error, HandbenchError):
        verdict = "exception"
    while error is not None and not isinstance(error, MemoryError):
        error = error.__cause__ or error.__context__
    if given.link:
        clear(path)
    path.write_bytes(kept)
    strangers = watch.seen or sorted({str(p) for p in folder.rglob("*")} - names)
    if strangers:
        return "wrote", f"{strangers}"[:300]
    if taken_s > LONGEST_S:
        return "slow", f"{taken_s:.1f} s; {verdict} {why}"
    large = status_bytes("VmHWM:") - start_bytes > LARGEST_BYTES
    return "memory" if large or error is not None else verdict, why


def work(link: Connection, root: str, readers: tuple[Reader, ...] = READERS) -> None:
    """Read the inputs that come through `link`; each answer is a verdict and why."""
    os.chdir(root)
    tempfile.tempdir = root
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # what readers say, and the libraries below them
    cv2.setNumThreads(1)
    known, watch = {reader.name: reader for reader in readers}, Watch()
    for reader in readers:
        (Path(root) / reader.name).mkdir()
        reader.write(Path(root) / reader.name)
        reader.read(Path(root) / reader.name)  # whatever is imported late is imported now
    warnings.simplefilter("error")
    link.send("ready")
    while True:
        given = link.recv()
        link.send(read(known[given.reader], Path(root) / given.reader, given, watch))


def fuzz(inputs: Iterable[Input], target=work) -> Iterator[tuple[Input, str, str]]:
    """Have inputs read one after the other, by a process that is started anew when an input has
    killed or stopped it: each with its verdict (of `read`, or hang or crash), and why."""
    process = None
    for given in inputs:
        if process is None:
            scratch = tempfile.TemporaryDirectory(prefix="handbench-fuzz-")
            context = multiprocessing.get_context("spawn")
            link, other = context.Pipe()
            process = context.Process(target=target, args=(other, scratch.name), daemon=True)
            with patch.dict(os.environ, dict.fromkeys(THREADS, "1")):  # a stack counts as memory
                process.start()
            other.close()
            assert link.recv() == "ready"
        link.send(given)
        try:
            if link.poll(HANG_S):
                yield given, *link.recv()
                continue
            verdict, why = "hang", f"no answer within {HANG_S:g} s"
        except (EOFError, ConnectionError):
            process.join()
            verdict, why = "crash", f"the process ended with {process.exitcode}"
        process.kill()
        process = process.join()
        scratch.cleanup()
        yield given, verdict, why
    if process is not None:
        process.kill()
        process.join()
        scratch.cleanup()


def planned(count: int, seed: int) -> Iterator[Input]:
    """`count` inputs, shared out among the readers by their shares; mixed, so that any beginning of
    the list holds all of them."""
    most = max(reader.share for reader in READERS)
    turns = [reader for k in range(most) for reader in READERS if reader.share > k]
    with tempfile.TemporaryDirectory(prefix="handbench-fuzz-") as scratch:
        for reader in READERS:
            (Path(scratch) / reader.name).mkdir()
            reader.write(Path(scratch) / reader.name)
        for n in range(count):
            reader, rng = turns[n % len(turns)], random.Random(f"{seed} {n}")
            file = rng.choice(reader.files)
            if rng.random() < LINKED:
                yield Input(reader.name, file, b"", rng.choice(LINKS))
            else:
                whole = (Path(scratch) / reader.name / file).read_bytes()
                yield Input(reader.name, file, mutated(file, whole, rng))


def corpus(path: Path) -> Iterator[Input]:
    """The inputs of a corpus: lines of JSON."""
    for line in map(json.loads, path.read_text(encoding="utf-8").splitlines()):
        content = zlib.decompress(base64.b64decode(line["content"]))
        yield Input(line["reader"], line["file"], content, line.get("link", ""))


def line_of(given: Input, found: str) -> str:
    """An input that found something, as a line of a corpus."""
    packed = base64.b64encode(zlib.compress(given.content, 9)).decode()
    about = {"reader": given.reader, "file": given.file, "found": found, "content": packed}
    return json.dumps(about | ({"link": given.link} if given.link else {}))


def main() -> int:
    """Print the counts; exit code 1 where anything was found."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--inputs", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("-o", dest="folder", type=Path, required=True, help="for found.jsonl")
    options = parser.parse_args()
    counts, found = Counter(), []
    for given, verdict, why in fuzz(planned(options.inputs, options.seed)):
        counts[verdict] += 1
        if verdict not in FINE:
            say(f"{given.reader} {given.file}: {verdict}: {why}")
            found.append(line_of(given, f"{verdict}: {why}") + "\n")
    print(", ".join(f"{count} {verdict}" for verdict, count in counts.items()))
    options.folder.mkdir(parents=True, exist_ok=True)
    (options.folder / "found.jsonl").write_text("".join(found), encoding="utf-8")
    return int(bool(found))


if __name__ == "__main__":
    # by its name: "spawn" does not import a package's __main__, in which `work` would be missing
    from tests.fuzz import __main__ as fuzzing

    sys.exit(fuzzing.main())
