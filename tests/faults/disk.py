"""Disks that are full: at any file or folder that is made, at any rename, and in the middle of any
file."""

from __future__ import annotations

import resource
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import count
from pathlib import Path

from tests.bench.run.faults import DISK
from tests.faults.commands import PRINTING, Command, Ended

SIZES = (0, 1, 100, 700, 3000, 10_000, 40_000, 200_000)  # bytes that fit into a file


@dataclass(frozen=True)
class Try:
    """One try of a kind of fault: of what, and what was lost."""

    kind: str
    what: str
    loss: str | None = None


def refused_writes(command: Command, rename: bool, first: int = 1, step: int = 1) -> Iterator[Try]:
    """Nothing can be made from the n-th file or folder on (or the n-th rename fails), for every
    step-th n from `first` until none is left to fail."""
    kind = "disk full at a rename" if rename else "disk full at a file"
    for at in count(first, step):
        felt, loss = command.tried(partial(DISK.full, command.out, at, rename))
        if not felt and DISK.count < at and loss is None:
            return
        yield Try(kind, f"{command.name}, write {at}", loss)


@contextmanager
def files_of_at_most(size: int) -> Iterator[None]:
    """In the block, no file grows beyond `size` bytes: libraries that write by themselves meet it
    too."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def short_files(command: Command, sizes: tuple[int, ...] = SIZES) -> Iterator[Try]:
    """No file takes more than so many bytes."""
    for size in sizes:
        yield Try("disk full within a file", f"{command.name}, {size} bytes",
                  command.tried(partial(files_of_at_most, size))[1])  # fmt: skip


def full_outputs(inputs: Path) -> Iterator[Try]:
    """The table or figures that a command prints go to a full disk."""
    for name, words in PRINTING.items():
        with open("/dev/full", "w") as full:
            command = [sys.executable, "-m", "handbench.cli.main", *words.format(i=inputs).split()]
            done = subprocess.run(
                command, stdout=full, stderr=subprocess.PIPE, text=True, timeout=300
            )
        loss = Ended(done.returncode, done.stderr).loss or (
            None if done.returncode else "nothing was said"
        )
        yield Try("disk full at the output", name, loss)
