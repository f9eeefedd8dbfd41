"""The engine of a run: it carries out stages, and records what they cost and which failed."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from handbench.bench.results.about import Failure
from handbench.bench.run.executors import WorkersLostError, alone, started
from handbench.bench.stages.reconstruct import read_times
from handbench.support.cost import Cost
from handbench.support.errors import HandbenchError
from handbench.support.progress import Work, say
from handbench.support.store import Stage

Done = tuple[Cost, bool]  # what a stage cost, and whether an earlier run had finished it


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

    def perform(
        self, stages: Sequence[Stage], essential: Sequence[Stage] = ()
    ) -> dict[Stage, Path]:
        """Carry out a round of stages that do not depend on each other. Returns the folders of
        those that are finished, in the order of `stages`.
        One that fails for a reason that the user can mend is recorded; if it is `essential`,
        HandbenchError is raised. Any other error ends the run."""
        self.rounds += 1
        done: dict[Stage, Done | Failure] = {}
        running = started(self.executor, self.work, stages)
        for stage in running.values():
            self.progress.begin(stage.label)
        for future in as_completed(running):
            if not isinstance(future.exception(), WorkersLostError):
                done[running[future]] = self._ended(running[future], future.result)
        for stage in stages:
            if stage not in done:  # or lost, then whichever ended the workers does so again
                if stage not in running.values():
                    self.progress.begin(stage.label)
                done[stage] = self._ended(stage, partial(alone, self.executor, self.work, stage))
        self.progress.reach(sum(self.plan[: self.rounds]))
        folders = {}
        for stage in stages:
            outcome = done[stage]
            if not isinstance(outcome, Failure):
                folders[stage] = self._record(stage, *outcome)
            elif stage in essential:
                raise HandbenchError(f"{stage.label}: {outcome.message}")
            else:
                self.failures.append(outcome)
        return folders

    def _ended(self, stage: Stage, result: Callable[[], Done]) -> Done | Failure:
        """Return the result of a stage or its failure, and print at once how it ended."""
        try:
            cost, finished = result()
        except HandbenchError as error:
            return failure_of(error, stage.capture, stage.name, stage.method)
        finally:
            self.progress.end(stage.label)
        say(f"{stage.label}: " + ("cached" if finished else f"{cost.seconds:.1f} s"))
        return cost, finished

    def _record(self, stage: Stage, cost: Cost, finished: bool) -> Path:
        """Record what a stage cost, and return its folder."""
        folder, host = stage.folder(self.work), cost.machine.get("host", "")
        times = read_times(folder)
        self.machines.setdefault(host, cost.machine)
        self.tasks.append(
            {
                "task": stage.label,
                "capture": stage.capture,
                "method": stage.method,
                "stage": stage.name,
                "seconds": cost.seconds,
                "cpu_seconds": cost.cpu_seconds,
                "peak_memory_mb": cost.peak_memory_mb,
                "cached": finished,
                "plan_seconds": times.get("plan_seconds"),
                "host": host,
                "gemm_gflops": cost.machine.get("gemm_gflops"),
                "others_cores": cost.others_cores,
            }
        )
        return folder

    @contextmanager
    def attempt(self, capture: str, stage: str, method: str = "") -> Iterator[None]:
        """Context manager that records a HandbenchError of its block as a failure, so that the run
        goes on."""
        try:
            yield
        except HandbenchError as error:
            self.failures.append(failure_of(error, capture, stage, method))


def failure_of(error: HandbenchError, capture: str, stage: str, method: str = "") -> Failure:
    """Print and return a failure; method is "" if the capture fails for all methods."""
    failure = Failure(capture=capture, method=method, stage=stage, message=str(error))
    say(failure.line)
    return failure
