"""Faults around a program, made to happen: a disk that is full from the n-th file on, files that
must not be written, a run whose stages take no time."""

import ctypes
import errno
import os
import re
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial, wraps
from pathlib import Path
from pkgutil import resolve_name

import pytest

from handbench.bench.results import Result
from handbench.bench.run.benchmark_file import load_benchmark
from handbench.bench.run.runner import run
from handbench.support.store import MANIFEST, STAMP

WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT
TIMES = {  # what differs from run to run, by the file's name
    "table.csv": rb"(?m)^seconds,.*$",
    "scores.csv": rb"(?m)^.*,seconds,.*$",
    "result.json": rb'"(gemm_gflops|seconds)":.*',
    "tasks.csv": rb"(?m)(,[^,\n]*){9}$",
    "capture.toml": rb"(?m)^seconds = .*$",
    STAMP: rb"(?s).*",
    MANIFEST: rb"(?s).*",
    "timing.json": rb"(?s).*",
}


class Disk:
    """Counts the files that Python code opens to write, and the folders and names that it makes,
    below a folder; and refuses them from the n-th on (`full`) or the n-th rename alone."""

    def __init__(self) -> None:
        self.below, self.count, self.at, self.rename = None, 0, 0, False
        sys.addaudithook(self._event)

    def _event(self, event: str, arguments: tuple) -> None:
        if self.below is None or event not in (
            ("os.rename",) if self.rename else ("open", "os.mkdir")
        ):
            return
        if not isinstance(arguments[0], str | Path) or (
            event == "open" and not arguments[2] & WRITES
        ):
            return
        if str(arguments[0]).startswith(f"{self.below}"):
            self.count += 1
            if self.count == self.at or (self.count > self.at and not self.rename):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(arguments[0]))

    @contextmanager
    def full(self, below: Path, at: int, rename: bool = False) -> Iterator[None]:
        """In the block, nothing is written from the at-th file on, counted from 1; or the at-th
        rename fails."""
        self.below, self.count, self.at, self.rename = str(below), 0, at, rename
        try:
            yield
        finally:
            self.below = None


DISK = Disk()


def instant(clean: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Have every stage but the last, which is fast, write again at once what it has left in
    `clean`."""

    def make(temporary: Path, **_: object) -> None:
        made = clean / "work" / temporary.name[1:].rpartition("-")[0]
        for file in sorted(
            path
            for path in made.rglob("*")
            if path.is_file() and path.name not in (STAMP, MANIFEST)
        ):
            target = temporary / file.relative_to(made)
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, target)

    for stage in (
        "run.simulate_stage.simulate",
        "validation.capture_warnings.make",
        "run.reconstruct_stage.reconstruct",
        "run.repeat_stage.repeat",
    ):
        replaced = resolve_name(f"handbench.bench.{stage}")  # whose code is the stage's
        monkeypatch.setattr(f"handbench.bench.{stage}", wraps(replaced)(partial(make)))


def execute(bench_file: Path, folder: Path, **options: bool) -> Result:
    """The result of a benchmark file."""
    bench, base = load_benchmark(str(bench_file))
    return run(bench, base, folder, **options)


def figures(folder: Path) -> list[str]:
    """The lines of a result's table without its times."""
    lines = (folder / "table.csv").read_text().splitlines()
    return [line for line in lines if not line.startswith("seconds")]


def content(folder: Path) -> dict[str, bytes]:
    """Every file of a result, those of its stages too, without times."""
    files = (path for path in folder.rglob("*") if path.is_file())
    return {
        str(path.relative_to(folder)): re.sub(
            TIMES.get(path.name, rb"(?!)"), b"", path.read_bytes()
        )
        for path in files
    }


CAP_DAC_OVERRIDE, CAPABILITIES_3 = 1, 0x20080522


@contextmanager
def nobody_s_rights() -> Iterator[None]:
    """In the block, this thread may write only what permissions allow, even where it is root's."""
    libc = ctypes.CDLL(None, use_errno=True)
    header, held = (ctypes.c_uint32 * 2)(CAPABILITIES_3, 0), (ctypes.c_uint32 * 6)()
    assert libc.capget(header, held) == 0
    less = (ctypes.c_uint32 * 6)(*held)
    less[0] &= ~(1 << CAP_DAC_OVERRIDE)
    assert libc.capset(header, less) == 0
    try:
        yield
    finally:
        assert libc.capset(header, held) == 0
