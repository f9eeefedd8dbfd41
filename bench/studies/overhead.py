"""What the runner itself costs: many tasks that do nothing, through the real plan, executor and cache.

`python -m bench.studies.overhead [--captures 1000] [--scheduler tcp://host:port]` writes capture folders that hold next
to nothing, plans four methods for each, and has every job carried out by a maker that leaves the small files of a
stage. It prints milliseconds per task and by how much the client's resident memory grew, for a first run and for a
second one, whose tasks are all cached; then the same for a table of as many captures, each with maps of a hand's size.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import redirect_stderr
from dataclasses import replace
from os import devnull
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from bench.datasets.native import ECHOES, TRUTH, CaptureFile, save_capture_file
from bench.evaluation.depth_errors import error_map
from bench.results import errors_path, write_errors
from bench.run import reconstruct_stage, scoring, tasks
from bench.run.benchmark_file import BenchFile
from bench.run.executors import Cluster, Executor, InPlace, executor
from bench.run.outcome import Capture, Outcome, basis, comparisons, tabulate
from bench.run.runner import Run
from bench.run.scoring import GRIDS, REFERENCES, write_reference
from bench.run.tasks import Done
from calibration.transforms import identity
from groundtruth.mesh.depth import Reference
from radar.data.arrays import AntennaArray
from radar.data.capture import RadarCapture, save_capture
from radar.support.files import write_json
from radar.support.store import Stage

METHODS = ("2fsk", "3fsk", "narrowband", "broadband")
BAR_MS = 5.0


def nothing(folder: Path, **arguments: Any) -> None:
    """A stage's files without its work."""
    (folder / reconstruct_stage.DEPTH).touch()
    write_json(folder / reconstruct_stage.TIMING, {"seconds": [0.0]})


def perform(root: Path, stage: Stage) -> Done:
    """As `bench.run.tasks.perform`, in a process whose makers do nothing."""
    reconstruct_stage.reconstruct = scoring.make = nothing
    return tasks.perform(root, stage)


class Watched:
    """An executor; memory_mb: the client's resident memory at each tenth of the tasks that it yields."""

    def __init__(self, executor: Executor) -> None:
        self.executor, self.memory_mb = executor, []

    def run(self, root: Path, jobs: list[Stage]) -> Iterator[tuple[int, Done]]:
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
    seconds, count = (time.perf_counter() - start, time.process_time() - cpu_start), len(run.tasks)
    assert count == len(bench.capture) * (len(METHODS) + 1) and not run.failures  # the last is the score's
    return 1e3 * seconds[0] / count, 1e3 * seconds[1] / count, watched.memory_mb[-10:]


def scored_captures(bench: BenchFile, base: Path, scores: Path) -> Outcome:
    """What a run would have found whose captures are all one disc of 100 mm, seen with errors of 1 mm."""
    axis_m, rng = np.linspace(-0.15, 0.15, 301), np.random.default_rng(0)
    disc = np.hypot(*np.meshgrid(axis_m, axis_m)) < 0.05
    z_m, transform = np.where(disc, 0.3, np.nan), replace(identity("radar"), covariance=np.zeros((6, 6)))
    known = Reference(z_m, np.zeros_like(z_m), np.zeros((*z_m.shape, 6)), transform, disc)
    one, found = scores / "one", Outcome(bench, [], [])
    write_reference(one, "truth", 0, known)
    write_json(one / GRIDS, dict.fromkeys(METHODS, 0))
    for id in METHODS:
        write_errors(
            one,
            "one",
            id,
            "truth",
            error_map(axis_m, axis_m, z_m + rng.normal(0, 1e-3, z_m.shape), z_m, known.sigma_m, disc),
        )
    for source in bench.capture:
        name = source.path
        found.captures.append(Capture(base / name, name, CaptureFile(name=name)))
        found.references[name] = {"truth": (base / name / TRUTH, transform)}
        found.scores[name] = scores / name
        (found.scores[name] / "errors").mkdir(parents=True)
        for folder in (REFERENCES, GRIDS):
            (found.scores[name] / folder).symlink_to(one / folder)
        for id in METHODS:
            found.seconds[name, id] = [0.1]
            errors_path(found.scores[name], name, id, "truth").symlink_to(errors_path(one, "one", id, "truth"))
    return found


def tabled(found: Outcome) -> tuple[float, list[float]]:
    """Seconds for the table and its comparisons, and the client's memory, MB: before, after the table, and after."""
    process, start = psutil.Process(), time.perf_counter()
    memory_mb, on = [process.memory_info().rss / 1e6], basis(found)
    for part in (tabulate, comparisons):
        part(found, on)
        memory_mb.append(process.memory_info().rss / 1e6)
    return time.perf_counter() - start, memory_mb


def main() -> int:
    """Print the figures; exit code 1 where a task costs more than BAR_MS."""
    parser = argparse.ArgumentParser(prog="python -m bench.studies.overhead", description=__doc__)
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
        seconds, memory_mb = tabled(scored_captures(bench, base, Path(folder).resolve() / "scores"))
        told = ", ".join(f"{value:.0f}" for value in memory_mb)
        each_ms = 1e3 * seconds / options.captures
        print(f"table of {options.captures} captures: {each_ms:.0f} ms each; the client's memory: {told} MB")
    return int(worst_ms > BAR_MS)


if __name__ == "__main__":
    sys.exit(main())
