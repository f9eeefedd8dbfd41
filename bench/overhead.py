"""What the runner itself costs: many tasks that do nothing, through the real plan, executor and cache.

`python -m bench.overhead [--captures 1000] [--scheduler tcp://host:port]` writes capture folders that hold next to
nothing, plans four methods for each, and has every job carried out by a maker that leaves the small files of a stage.
It prints milliseconds per task and by how much the client's resident memory grew, for a first run and for a second one,
whose tasks are all cached.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import redirect_stderr
from os import devnull
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from bench import stages, tasks
from bench.datasets.native import ECHOES, TRUTH, CaptureFile, save_capture_file
from bench.protocol import BenchFile
from bench.runner import Run
from bench.schedule import Cluster, Executor, InPlace, executor
from bench.tasks import Done, Job
from radar.arrays import AntennaArray
from radar.capture import RadarCapture, save_capture
from radar.files import write_json

METHODS = ("2fsk", "3fsk", "narrowband", "broadband")
BAR_MS = 5.0


def nothing(folder: Path, **arguments: Any) -> None:
    """A stage's files without its work."""
    (folder / stages.DEPTH).touch()
    write_json(folder / stages.TIMING, {"seconds": [0.0]})


def perform(root: Path, job: Job) -> Done:
    """As `bench.tasks.perform`, in a process whose maker does nothing."""
    tasks.MAKERS["reconstruct"] = nothing
    return tasks.perform(root, job)


class Watched:
    """An executor; memory_mb: the client's resident memory at each tenth of the tasks that it yields."""

    def __init__(self, executor: Executor) -> None:
        self.executor, self.memory_mb = executor, []

    def run(self, root: Path, jobs: list[Job]) -> Iterator[tuple[int, Done]]:
        """See `Executor`."""
        process, tenth = psutil.Process(), max(len(jobs) // 10, 1)
        for count, ended in enumerate(self.executor.run(root, jobs)):
            if count % tenth == 0:
                self.memory_mb.append(process.memory_info().rss / 1e6)
            yield ended


def write_captures(base: Path, count: int) -> BenchFile:
    """Capture folders with one tone of one antenna pair, and the benchmark of all of them."""
    one, source = np.zeros((1, 3)), []
    for k in range(count):
        folder = base / f"capture{k:05d}"
        folder.mkdir()
        samples = np.full((1, 1, 1, 1), k + 1, np.complex64)
        save_capture(folder / ECHOES, RadarCapture(samples, np.array([82e9]), AntennaArray(one, one)))
        (folder / TRUTH).touch()
        save_capture_file(folder, CaptureFile(name=folder.name, contains=(ECHOES, TRUTH)))
        source.append({"path": folder.name})
    return BenchFile(version=1, name="overhead", capture=source, method=[{"id": id} for id in METHODS])


def measure(bench: BenchFile, base: Path, work: Path, workers: Executor) -> tuple[float, float, list[float]]:
    """Milliseconds per task of one run, opening and planning included, by the clock and of this process's CPU; and its
    memory while it went."""
    watched = Watched(workers)
    run, start, cpu_start = Run(bench, base, work, watched), time.perf_counter(), time.process_time()
    with Path(devnull).open("w") as nowhere, redirect_stderr(nowhere):
        run.execute()
    seconds, count = (time.perf_counter() - start, time.process_time() - cpu_start), len(bench.capture) * len(METHODS)
    assert len(run.tasks) == count and not run.failures
    return 1e3 * seconds[0] / count, 1e3 * seconds[1] / count, watched.memory_mb[-10:]


def main() -> int:
    """Print the figures; exit code 1 where a task costs more than BAR_MS."""
    parser = argparse.ArgumentParser(prog="python -m bench.overhead", description=__doc__)
    parser.add_argument("--captures", type=int, default=1000)
    parser.add_argument("--scheduler", metavar="tcp://HOST:PORT")
    options = parser.parse_args()
    worst_ms = 0.0
    with tempfile.TemporaryDirectory() as folder, executor(options.scheduler) as found:
        base, work = Path(folder).resolve() / "captures", Path(folder).resolve() / "work"
        base.mkdir()
        work.mkdir()
        bench = write_captures(base, options.captures)
        workers = Cluster(found.client, perform) if isinstance(found, Cluster) else InPlace(perform)
        for name in ("first run", "all cached"):
            task_ms, cpu_ms, memory_mb = measure(bench, base, work, workers)
            worst_ms = max(worst_ms, task_ms)
            told = ", ".join(f"{value:.0f}" for value in memory_mb)
            print(f"{name}: {task_ms:.2f} ms a task, {cpu_ms:.2f} ms of the client's CPU; its memory: {told} MB")
    return int(worst_ms > BAR_MS)


if __name__ == "__main__":
    sys.exit(main())
