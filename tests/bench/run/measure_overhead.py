"""The runner's own cost: many tasks that do nothing, through the real plan, executor and cache.

Capture folders that hold next to nothing, four methods for each, and every job carried out by a
maker that leaves the small files of a stage: a first run, and a second one, whose tasks are all
cached. The time of this machine: run it where nothing else works.

python -m tests.bench.run.measure_overhead [--captures 1000] [--scheduler tcp://HOST:PORT]
"""

from __future__ import annotations

import argparse
import tempfile
import time
from contextlib import redirect_stderr
from os import devnull
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import psutil

from handbench.bench.datasets.native import ECHOES, TRUTH, CaptureFile, save_capture_file
from handbench.bench.run import reconstruct_stage, runner
from handbench.bench.run.benchmark_file import BenchFile
from handbench.bench.run.executors import executor
from handbench.radar.data.arrays import AntennaArray
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.echoes_file import save_capture
from handbench.support.files import write_json
from handbench.support.store import Stage, Stamp, cached

METHODS = ("2fsk", "3fsk", "narrowband", "broadband")


def nothing(folder: Path, **arguments: Any) -> None:
    """A stage's files without its work."""
    (folder / reconstruct_stage.DEPTH).touch()
    write_json(folder / reconstruct_stage.TIMING, {"seconds": [0.0]})


def idle(root: Path, stage: Stage) -> tuple[Stamp, bool]:
    """As `cached`, of a stage that does nothing."""
    object.__setattr__(stage, "function", nothing)
    return cached(root, stage)


def write_captures(base: Path, count: int) -> BenchFile:
    """Capture folders with one tone of one antenna pair, and the benchmark of all of them."""
    one, source = np.zeros((1, 3)), []
    for k in range(count):
        folder = base / f"capture{k:05d}"
        folder.mkdir()
        samples = np.full((1, 1, 1, 1), k + 1, np.complex64)
        echoes = RadarCapture(samples, np.array([82e9]), AntennaArray(one, one))
        save_capture(folder / ECHOES, echoes)
        (folder / TRUTH).touch()
        save_capture_file(folder, CaptureFile(name=folder.name, contains=(ECHOES, TRUTH)))
        source.append({"path": folder.name})
    methods = [{"id": id} for id in METHODS]
    return BenchFile(version=1, name="overhead", capture=source, method=methods)


def all_tasks(run: runner.Run) -> int:
    """Opening and planning included; how many they are."""
    with (
        Path(devnull).open("w") as nowhere,
        redirect_stderr(nowhere),
        patch.object(runner, "cached", idle),
    ):
        run.open()
        stages = run.imaging()
        run.collect(stages, run.perform(stages))
        run.find_references()
        run.score()
    assert not run.found.failures
    return len(run.found.tasks)


def main() -> None:
    """Print what a task costs."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--captures", type=int, default=1000, help="default 1000")
    parser.add_argument("--scheduler", help="a Dask scheduler in place of this process")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch, executor(options.scheduler) as workers:
        base, work = (Path(scratch).resolve() / name for name in ("captures", "work"))
        base.mkdir()
        work.mkdir()
        bench = write_captures(base, options.captures)
        for name in ("first run", "all cached"):
            start_s, cpu_start_s = time.perf_counter(), time.process_time()
            count = all_tasks(runner.Run(bench, base, work, workers))
            each_ms = 1e3 * (time.perf_counter() - start_s) / count
            cpu_ms = 1e3 * (time.process_time() - cpu_start_s) / count
            memory_mb = psutil.Process().memory_info().rss / 1e6
            print(f"{name}: {each_ms:.2f} ms a task, {cpu_ms:.2f} ms of it the client's CPU time;")
            print(f"  the client then has {memory_mb:.0f} MB")


if __name__ == "__main__":
    main()
