"""The engine of a run: it carries out stages, and records what they cost and which failed."""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor, as_completed
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from handbench.bench.results.about import Failure
from handbench.bench.run.executors import started
from handbench.bench.stages.reconstruct import read_times
from handbench.support.errors import HandbenchError
from handbench.support.progress import Work, say
from handbench.support.store import Stage, Stamp, cached

Made = TypeVar("Made")
Done = tuple[Stamp, bool]  # what a stage cost, and whether an earlier run had finished it


@dataclass
class Engine:
    """Carries out the stages of a run.
    work: folder of all stages. executor: carries out stages elsewhere (None: all in this process).
    plan: how many stages each round has at most, for the progress. failures: the stages that
    failed. tasks: lines of the table of stages. machines: facts of the machines that did the work,
    by host name. rounds: how many have begun."""

    work: Path
    executor: Executor | None
    progress: Work
    plan: list[int]
    failures: list[Failure] = field(default_factory=list)
    tasks: list[dict[str, Any]] = field(default_factory=list)
    machines: dict[str, dict[str, Any]] = field(default_factory=dict)
    rounds: int = 0

    def perform(self, stages: Sequence[Stage]) -> list[Path | Failure]:
        """Carry out a round of stages that do not depend on each other. Returns their folders in
        the same order; a failure, which is recorded too, in place of one that failed for a reason
        that the user can mend. Any other error ends the run."""
        self.rounds += 1
        done: dict[Stage, Done | Failure] = {}
        running = started(self.executor, self.work, stages)
        for stage in running.values():
            self.progress.begin(stage.label)
        for future in as_completed(running):
            done[running[future]] = self._ended(running[future], future.result)
        for stage in stages:
            if stage not in done:
                self.progress.begin(stage.label)
                done[stage] = self._ended(stage, partial(cached, self.work, stage))
        self.progress.reach(sum(self.plan[: self.rounds]))
        return [self._record(stage, done[stage]) for stage in stages]

    def _ended(self, stage: Stage, result: Callable[[], Done]) -> Done | Failure:
        """Return the result of a stage or its failure, and print how it ended."""
        try:
            stamp, finished = result()
        except HandbenchError as error:
            failure = Failure(
                capture=stage.capture, method=stage.method, stage=stage.name, message=str(error)
            )
            say(failure.line)
            return failure
        finally:
            self.progress.end(stage.label)
        say(f"{stage.label}: " + ("cached" if finished else f"{stamp.seconds:.1f} s"))
        return stamp, finished

    def _record(self, stage: Stage, done: Done | Failure) -> Path | Failure:
        """Record the cost of a stage, or its failure; return its folder, or the failure."""
        if isinstance(done, Failure):
            self.failures.append(done)
            return done
        (stamp, finished), folder = done, stage.folder(self.work)
        times = read_times(folder)
        host = stamp.machine.get("host", "")
        self.machines.setdefault(host, stamp.machine)
        self.tasks.append(
            {
                "task": stage.label,
                "capture": stage.capture,
                "method": stage.method,
                "stage": stage.name,
                "seconds": stamp.seconds,
                "cpu_seconds": stamp.cpu_seconds,
                "peak_memory_mb": stamp.peak_memory_mb,
                "cached": finished,
                "plan_seconds": times.get("plan_seconds"),
                "host": host,
                "gemm_gflops": stamp.machine.get("gemm_gflops"),
                "others_cores": times.get("others_cores"),
                "image_error": times.get("image_error"),
            }
        )
        return folder

    def attempt(
        self, function: Callable[[], Made], capture: str, stage: str, method: str = ""
    ) -> Made | Failure:
        """Call a function of the run itself. Returns what it returns; if it raises a
        HandbenchError, the failure, which is printed and recorded.
        capture, stage, method: what is recorded with it; method is "" if the capture fails for all
        methods."""
        try:
            return function()
        except HandbenchError as error:
            failure = Failure(capture=capture, method=method, stage=stage, message=str(error))
            say(failure.line)
            self.failures.append(failure)
            return failure
