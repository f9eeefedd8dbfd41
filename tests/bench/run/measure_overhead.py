"""The runner's own cost: many tasks that do nothing, through the real plan, executor and cache.

Capture folders that hold next to nothing, four methods for each, and every job carried out by a
maker that leaves the small files of a stage: a first run, and a second one, whose tasks are all
cached. Then the table of as many captures, each with maps of a hand's size. The time of this
machine: run it where nothing else works.

python -m tests.bench.run.measure_overhead [--captures 1000] [--scheduler tcp://HOST:PORT]
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import Executor, Future
from contextlib import redirect_stderr
from dataclasses import replace
from os import devnull
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import psutil

from handbench.bench.datasets.native import ECHOES, TRUTH, CaptureFile, save_capture_file
from handbench.bench.evaluation.depth_errors import error_map
from handbench.bench.evaluation.metrics import pool
from handbench.bench.evaluation.tables import SCORES, Column, frame, write
from handbench.bench.results import errors_path, write_errors
from handbench.bench.run import reconstruct_stage, runner
from handbench.bench.run.benchmark_file import BenchFile
from handbench.bench.run.executors import executor
from handbench.bench.run.outcome import Capture, Outcome, basis
from handbench.bench.run.runner import Run
from handbench.bench.run.scoring import REFERENCES, SCORED, grid_name, write_reference
from handbench.bench.run.write_result import scores, tabulate
from handbench.calibration.transforms import identity
from handbench.groundtruth.mesh.depth import Reference
from handbench.radar.data.arrays import AntennaArray
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.echoes_file import save_capture
from handbench.support.files import write_json
from handbench.support.store import Stage, Stamp, cached
from handbench.bench.studies.study import Record, Table

METHODS = ("2fsk", "3fsk", "narrowband", "broadband")
BAR_MS = 5.0
COLUMNS = (
    Column("what", str, "two runs of the same tasks, and the table", heading="what"),
    Column(
        "each_ms",
        float,
        "a task, planning included; of the table a capture",
        heading="ms each",
        form="{:.2f}",
    ),
    Column(
        "cpu_ms", float, "of the client's CPU, a task", heading="client's CPU, ms", form="{:.2f}"
    ),
    Column(
        "memory_mb",
        list,
        "at each tenth of the tasks",
        heading="client's memory, MB",
        form="rounded list",
    ),
)


def nothing(folder: Path, **arguments: Any) -> None:
    """A stage's files without its work."""
    (folder / reconstruct_stage.DEPTH).touch()
    write_json(folder / reconstruct_stage.TIMING, {"seconds": [0.0]})


def idle(root: Path, stage: Stage) -> tuple[Stamp, bool]:
    """As `cached`, of a stage that does nothing."""
    object.__setattr__(stage, "function", nothing)
    return cached(root, stage)


class Watched(Executor):
    """An executor; memory_mb: the client's resident memory at each tenth of so many jobs."""

    def __init__(self, executor: Executor, jobs: int) -> None:
        self.executor, self.tenth, self.count = executor, max(jobs // 10, 1), 0
        self.memory_mb: list[float] = []

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Have the function called by the executor."""
        if self.count % self.tenth == 0:
            self.memory_mb.append(psutil.Process().memory_info().rss / 1e6)
        self.count += 1
        return self.executor.submit(function, *args, **kwargs)


def write_captures(base: Path, count: int) -> BenchFile:
    """Capture folders with one tone of one antenna pair, and the benchmark of all of them."""
    one, source = np.zeros((1, 3)), []
    for k in range(count):
        folder = base / f"capture{k:05d}"
        folder.mkdir()
        samples = np.full((1, 1, 1, 1), k + 1, np.complex64)
        save_capture(
            folder / ECHOES, RadarCapture(samples, np.array([82e9]), AntennaArray(one, one))
        )
        (folder / TRUTH).touch()
        save_capture_file(folder, CaptureFile(name=folder.name, contains=(ECHOES, TRUTH)))
        source.append({"path": folder.name})
    return BenchFile(
        version=1, name="overhead", capture=source, method=[{"id": id} for id in METHODS]
    )


def run_record(name: str, bench: BenchFile, base: Path, work: Path, workers: Executor) -> Record:
    """One run of all tasks, opening and planning included."""
    watched = Watched(workers, len(bench.capture) * (len(METHODS) + 2))
    run, start, cpu_start = (
        Run(bench, base, work, watched),
        time.perf_counter(),
        time.process_time(),
    )
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
    seconds, cpu_seconds, count = (
        time.perf_counter() - start,
        time.process_time() - cpu_start,
        len(run.found.tasks),
    )
    assert (
        count == len(bench.capture) * (len(METHODS) + 1) and not run.found.failures
    )  # the last is the score's
    each_ms, cpu_ms = 1e3 * seconds / count, 1e3 * cpu_seconds / count
    return {
        "what": name,
        "each_ms": each_ms,
        "cpu_ms": cpu_ms,
        "memory_mb": watched.memory_mb[-10:],
    }


def scored_captures(bench: BenchFile, base: Path, scores: Path) -> Outcome:
    """The outcome of a run whose captures are all one disc of 100 mm, seen with errors of 1 mm."""
    axis_m, rng = np.linspace(-0.15, 0.15, 301), np.random.default_rng(0)
    disc = np.hypot(*np.meshgrid(axis_m, axis_m)) < 0.05
    z_m, transform = (
        np.where(disc, 0.3, np.nan),
        replace(identity("radar"), covariance=np.zeros((6, 6))),
    )
    known = Reference(z_m, np.zeros_like(z_m), np.zeros((*z_m.shape, 6)), transform, disc)
    one, found = scores / "one", Outcome(bench, [], [])
    write_reference(one, "truth", grid_name(axis_m, axis_m), known)
    lines = []
    for id in METHODS:
        seen = error_map(
            axis_m, axis_m, z_m + rng.normal(0, 1e-3, z_m.shape), z_m, known.sigma_m, disc
        )
        write_errors(one, "one", id, "truth", seen)
        figures = pool([seen]) | {"floor_mm": 0.0}
        lines += [("one", id, "truth", "", 0, *figure) for figure in figures.items()]
    table = frame(SCORES, lines)
    for source in bench.capture:
        name = str(source.path)
        found.captures.append(Capture(base / name, name, CaptureFile(name=name)))
        found.references[name] = {"truth": (base / name / TRUTH, transform)}
        found.scores[name] = scores / name
        (found.scores[name] / "errors").mkdir(parents=True)
        (found.scores[name] / REFERENCES).symlink_to(one / REFERENCES)
        write(found.scores[name] / SCORED, table.assign(capture=name), SCORES)
        for id in METHODS:
            found.seconds[name, id] = [0.1]
            errors_path(found.scores[name], name, id, "truth").symlink_to(
                errors_path(one, "one", id, "truth")
            )
    return found


def table_record(found: Outcome) -> Record:
    """The table and its comparisons; memory: before and after."""
    process, start = psutil.Process(), time.perf_counter()
    memory_mb, on = [process.memory_info().rss / 1e6], basis(found)
    tabulate(found, on, scores(found, on))
    memory_mb.append(process.memory_info().rss / 1e6)
    each_ms = 1e3 * (time.perf_counter() - start) / len(found.captures)
    return {"what": "table", "each_ms": each_ms, "memory_mb": memory_mb}


def measure(captures: int, scheduler: str | None) -> list[Record]:
    """Both runs and the table."""
    with tempfile.TemporaryDirectory() as folder, executor(scheduler) as found:
        base, work = Path(folder).resolve() / "captures", Path(folder).resolve() / "work"
        base.mkdir()
        work.mkdir()
        bench = write_captures(base, captures)
        runs = [run_record(name, bench, base, work, found) for name in ("first run", "all cached")]
        return [
            *runs,
            table_record(scored_captures(bench, base, Path(folder).resolve() / "scores")),
        ]


def main() -> None:
    """Print the table; a task that costs more than BAR_MS ends with exit code 1."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--captures", type=int, default=1000, help="default 1000")
    parser.add_argument(
        "--scheduler", metavar="tcp://HOST:PORT", help="a Dask scheduler in place of this process"
    )
    records = measure(**vars(parser.parse_args()))
    print(Table("rows", COLUMNS, records).markdown())
    worst_ms = max(record["each_ms"] for record in records[:2])
    if worst_ms > BAR_MS:
        sys.exit(
            f"a task costs {worst_ms:.2f} ms; expected at most {BAR_MS:g} ms on a quiet machine"
        )


if __name__ == "__main__":
    main()
