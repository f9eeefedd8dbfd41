"""What changes around a command while it works, or between two runs: folders that vanish, clocks
that jump, inputs that are edited without a trace in their size and time."""

from __future__ import annotations

import os
import random
import shutil
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from itertools import count
from pathlib import Path
from unittest.mock import patch

from tests.bench.run.faults import content
from tests.faults.commands import Command, once
from tests.faults.disk import Try


class Watch:
    """Takes a folder away when Python code opens, or makes, the n-th thing below it."""

    def __init__(self) -> None:
        self.folder: Path | None = None
        self.count = self.at = 0
        sys.addaudithook(self._event)

    def _event(self, event: str, arguments: tuple) -> None:
        if (
            self.folder is None
            or event not in ("open", "os.mkdir")
            or not str(arguments[0]).startswith(f"{self.folder}/")
        ):
            return
        self.count += 1
        if self.count == self.at:
            os.rename(self.folder, self.folder.with_name(f"{self.folder.name}-gone"))

    @contextmanager
    def gone(self, folder: Path, at: int, back: bool) -> Iterator[None]:
        """In the block the folder vanishes at the n-th opening, from 1; it comes back after the
        block, or not."""
        away = folder.with_name(f"{folder.name}-gone")
        self.folder, self.count, self.at = folder, 0, at
        try:
            yield
        finally:
            self.folder = None
            if away.exists() and back:
                away.rename(folder)
            shutil.rmtree(away, ignore_errors=True)


WATCH = Watch()


def vanishing(command: Command, of_inputs: bool, first: int = 1, step: int = 1) -> Iterator[Try]:
    """The folder of the outputs, or that of the inputs, vanishes at the n-th opening of something
    in it."""
    folder, kind = (
        (command.inputs, "inputs vanish") if of_inputs else (command.out, "outputs vanish")
    )
    for at in count(first, step):
        loss = command.tried(partial(WATCH.gone, folder, at, of_inputs))[1]
        if WATCH.count < at and loss is None:
            return
        if loss and not of_inputs and loss.startswith("handbench: ") and "no run wrote" in loss:
            # the folder came back without its mark while the run wrote on: a resumed run refuses it
            # in words
            loss = None
        yield Try(kind, f"{command.name}, opening {at}", loss)


@contextmanager
def jumping(seed: int) -> Iterator[None]:
    """In the block, the wall clock jumps by up to ten years at every look at it."""
    generator, now, now_ns = random.Random(seed), time.time, time.time_ns
    with (
        patch("time.time", lambda: max(now() + generator.uniform(-3e8, 3e8), 0.0)),
        patch("time.time_ns", lambda: now_ns() + generator.randrange(-(10**17), 10**17)),
    ):
        yield


def clocks(command: Command, tries: int) -> Iterator[Try]:
    """The same command under clocks that jump."""
    for seed in range(tries):
        yield Try(
            "clock jumps", f"{command.name}, {seed}", command.tried(partial(jumping, seed))[1]
        )


EDITS = {  # file of the inputs: what is replaced in it by something as long
    "ball.toml": (b"seed = 3", b"seed = 4"),
    "small.toml": (b"phase_noise_rad = 0.03", b"phase_noise_rad = 0.05"),
    "ball.ply": (b"", b""),
}


def edited(path: Path, old: bytes, new: bytes) -> None:
    """Change a file's content, not its size nor its times; of a mesh (old is empty) one bit of a
    coordinate."""
    state, data = path.stat(), bytearray(path.read_bytes())
    if old:
        assert old in data and len(old) == len(new)
        data = data.replace(old, new)
    else:
        data[data.index(b"end_header\n") + 11 + 8 * 3 * 40 + 5] ^= 1 << 3
    path.write_bytes(data)
    os.utime(path, ns=(state.st_atime_ns, state.st_mtime_ns))
    assert path.stat().st_mtime_ns == state.st_mtime_ns and path.stat().st_size == state.st_size


def silent_edits(command: Command) -> Iterator[Try]:
    """An input is edited between two runs into one folder: the second run is as a first one with
    the edited input."""
    for name, (old, new) in EDITS.items():
        path, words = command.inputs / name, command.words
        whole = path.read_bytes()
        command.empty()
        before = once(words)
        try:
            edited(path, old, new)
            again = once(words)
            if again.code == 2 and "--overwrite" in again.said:
                again = once(f"{words} --overwrite")
            found = content(command.out)
            command.empty()
            fresh = once(words)
            expected = content(command.out)
        finally:
            path.write_bytes(whole)
        wrong = [k for k in expected if found.get(k) != expected[k] and command.expected.get(k)]
        loss = f"{wrong[0]} is stale" if wrong else None
        if ended := [e for e in (before, again, fresh) if e.code != 0]:
            loss = ended[0].said
        yield Try("same size and time", f"{command.name}, {name}", loss)
