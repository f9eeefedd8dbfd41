"""Jobs that stand for the real ones, and what a run makes of them. Processes import this file: it
imports little."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable
from concurrent.futures import Executor
from pathlib import Path
from typing import TYPE_CHECKING, Any
from unittest.mock import patch

from handbench.support.files import write_json
from handbench.support.parallel import workers
from handbench.support.store import Stage, Stamp

if TYPE_CHECKING:
    from handbench.bench.run.runner import StageOutcome

SPAN_S = 0.2


def nothing(folder: Path) -> None:
    """A stage's function."""


def stage_of(name: str, capture: str, method: str = "") -> Stage:
    """A stage with a key of its own."""
    return Stage(name, nothing, {}, [], capture, method)


def performed(
    executor: Executor, job: Callable[[Path, Stage], Any], root: Path, stages: list[Stage]
) -> list[StageOutcome]:
    """The outcomes of stages that a run has an executor carry out, by a job that stands for the
    real ones."""
    from handbench.bench.benchmarks.benchmark_file import load_benchmark
    from handbench.bench.run import jobs, runner

    for stage in (stage for stage in stages if stage.method):
        write_json(stage.folder(root) / runner.TIMING, {})
    with patch.object(runner, "cached", job), patch.object(jobs, "content_key", job):
        bench, base = load_benchmark("hands")
        return runner.Run(bench, base, root, executor).perform(stages)


def spans(root: Path, job: Stage) -> tuple[Stamp, bool]:
    """Writes when it began and ended, and in which process with how many threads."""
    if job.capture == "bug":
        raise ZeroDivisionError("a bug")
    if job.capture == "deadly":
        os.kill(os.getpid(), signal.SIGKILL)
    began_s = time.monotonic()
    time.sleep(SPAN_S)
    (root / job.label).write_text(f"{began_s} {time.monotonic()} {os.getpid()} {workers()}")
    return Stamp(), False


def deadly(root: Path, job: Stage) -> str:
    """Ends its process where the capture is named so."""
    if job.capture == "deadly":
        os.kill(os.getpid(), signal.SIGKILL)
    return job.capture


class LockedError(Exception):
    """One that holds what does not go from one process into another."""

    def __init__(self, what: str, lock: Any) -> None:
        super().__init__(what)
        self.lock = lock


def stuck(root: Path, job: Stage) -> tuple[Stamp, bool]:
    """Ends with an exception that cannot be sent."""
    if job.capture == "bug":
        raise LockedError("held", threading.Lock())
    return Stamp(), False


def slow(root: Path, job: Stage) -> tuple[Stamp, bool]:
    """Says in which process it is, and does not end."""
    (root / job.label).write_text(str(os.getpid()))
    time.sleep(1000)
    return Stamp(), False
