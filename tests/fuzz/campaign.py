"""Many inputs through one worker: what it says of each, and what it does not live to say."""

from __future__ import annotations

import base64
import json
import multiprocessing
import os
import random
import tempfile
import time
import zlib
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from tests.fuzz.hostile import LINKS
from tests.fuzz.mutate import mutated
from tests.fuzz.readers import READERS, Reader
from tests.fuzz.worker import Input, Seen, work

HANG_S = 300.0  # on the clock: other programs may take the processor
LINKED = 0.03  # of the inputs something else stands in the place of a file
START_S = 600.0  # for imports
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")
FINDINGS = ("exception", "slow", "hang", "memory", "crash", "wrote")


@dataclass
class Tally:
    """Counts of a reader's inputs by verdict, their time and memory."""

    verdicts: Counter[str] = field(default_factory=Counter)
    seconds: float = 0.0
    slowest_s: float = 0.0
    peak_mb: float = 0.0

    def add(self, seen: Seen, seconds: float) -> None:
        """Count one input."""
        self.verdicts[seen.verdict] += 1
        self.seconds += seconds
        self.slowest_s, self.peak_mb = max(self.slowest_s, seconds), max(self.peak_mb, seen.peak_mb)


class Worker:
    """A worker process, started anew when an input has killed or stopped it."""

    def __init__(self) -> None:
        self.process = None

    def __enter__(self) -> Worker:
        return self

    def __exit__(self, *_: object) -> None:
        self._end()

    def read(self, given: Input) -> tuple[Seen, float]:
        """Have an input read: what came of it, and its seconds."""
        if self.process is None:
            self._start()
        start = time.monotonic()
        try:
            self.link.send(given)
            if self.link.poll(HANG_S):
                return self.link.recv(), time.monotonic() - start
            seen = Seen("hang", f"no answer within {HANG_S:g} s")
        except (EOFError, ConnectionError):
            self.process.join()
            seen = Seen("crash", f"the process ended with {self.process.exitcode}")
        self._end()
        return seen, time.monotonic() - start

    def _start(self) -> None:
        self.scratch = tempfile.TemporaryDirectory(prefix="handbench-fuzz-")
        context = multiprocessing.get_context("spawn")
        self.link, other = context.Pipe()
        self.process = context.Process(target=work, args=(other, self.scratch.name), daemon=True)
        with _one_thread():
            self.process.start()
        other.close()
        if not self.link.poll(START_S) or self.link.recv().verdict != "ready":
            raise RuntimeError("the worker did not start")

    def _end(self) -> None:
        if self.process is None:
            return
        self.process.kill()
        self.process.join()
        self.link.close()
        self.scratch.cleanup()
        self.process = None


@contextmanager
def _one_thread() -> Iterator[None]:
    """Processes that start in the block compute in one thread, whose stack alone counts against
    their memory."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name)
            if value is not None:
                os.environ[name] = value


def planned(count: int, seed: int, only: Iterable[str] = ()) -> Iterator[Input]:
    """`count` inputs, shared out among the readers (or some of them) by their shares; mixed, so
    that any beginning of the list holds all of them."""
    chosen = [reader for reader in READERS if not only or reader.name in only]
    turns = [
        reader for k in range(max(r.share for r in chosen)) for reader in chosen if reader.share > k
    ]
    with tempfile.TemporaryDirectory(prefix="handbench-fuzz-") as scratch:
        whole = {reader.name: Path(scratch) / reader.name for reader in chosen}
        for reader in chosen:
            whole[reader.name].mkdir()
            reader.write(whole[reader.name])
        numbers: Counter[str] = Counter()
        for n in range(count):
            reader = turns[n % len(turns)]
            yield broken(reader, whole[reader.name], seed, numbers[reader.name])
            numbers[reader.name] += 1


def broken(reader: Reader, whole: Path, seed: int, number: int) -> Input:
    """The number-th broken version of a reader's valid input."""
    rng = random.Random(f"{seed} {reader.name} {number}")
    file = rng.choice(reader.files)
    if rng.random() < LINKED:
        return Input(reader.name, file, b"", number, rng.choice(LINKS))
    return Input(reader.name, file, mutated(file, (whole / file).read_bytes(), rng), number)


def fuzz(inputs: Iterable[Input]) -> Iterator[tuple[Input, Seen, float]]:
    """Have inputs read one after the other."""
    with Worker() as worker:
        for given in inputs:
            yield given, *worker.read(given)


def corpus(path: Path) -> list[Input]:
    """The inputs of a corpus: lines of JSON."""
    lines = map(json.loads, path.read_text(encoding="utf-8").splitlines())
    return [
        Input(
            c["reader"],
            c["file"],
            zlib.decompress(base64.b64decode(c["content"])),
            link=c.get("link", ""),
        )
        for c in lines
    ]


def line_of(given: Input, seen: Seen) -> str:
    """An input that found something, as a line of a corpus."""
    packed = base64.b64encode(zlib.compress(given.content, 9)).decode()
    found = f"{seen.verdict}: {seen.detail}"
    linked = {"link": given.link} if given.link else {}
    return json.dumps(
        {"reader": given.reader, "file": given.file, "found": found, "content": packed} | linked
    )
