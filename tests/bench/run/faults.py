"""What tests of faults around a run share: a full disk, a run whose stages take no time, and what a
result holds apart from its times."""

import re
import resource
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from pkgutil import resolve_name

import pytest

from handbench.bench.benchmarks.benchmark_file import load_benchmark
from handbench.bench.results.result_folder import Result
from handbench.bench.run.runner import run
from handbench.support.store import DECLARED, STAMP

TIMES = {  # what differs from run to run, by the file's name
    "table.csv": rb"(?m)^seconds,.*$",
    "scores.csv": rb"(?m)^.*,seconds,.*$",
    "result.json": rb'"(gemm_gflops|seconds)":.*',
    "tasks.csv": rb"(?m)(,[^,\n]*){9}$",
    "capture.toml": rb"(?m)^seconds = .*$",
    STAMP: rb"(?s).*",
    "timing.json": rb"(?s).*",
}


@contextmanager
def files_of_at_most(size: int) -> Iterator[None]:
    """In the block, no file grows beyond `size` bytes, as on a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def stand_in(monkeypatch: pytest.MonkeyPatch, place: str, function: Callable[..., None]) -> None:
    """Have a function stand for a stage, of which handbench knows the name in `place`."""
    name = f"handbench.{place}"
    monkeypatch.setitem(DECLARED, function, DECLARED[resolve_name(name)])
    monkeypatch.setattr(name, function)


def instant(clean: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Have every stage but the last, which is fast, write again at once what it has left in
    `clean`."""

    def make(temporary: Path, **_: object) -> None:
        made = clean / "work" / temporary.name
        left_out = shutil.ignore_patterns(STAMP)
        shutil.copytree(made, temporary, ignore=left_out, dirs_exist_ok=True)

    for name in (
        "captures.simulate",
        "runner.inspect_capture",
        "runner.reconstruct",
        "runner.repeat",
    ):
        stand_in(monkeypatch, f"bench.run.{name}", partial(make))


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
