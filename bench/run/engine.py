"""The engine of a run: it carries out stages, and records what they cost and which failed."""

from collections import deque
from collections.abc import Container, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from handbench.bench.results.about import Failure
from handbench.bench.run.executors import WorkersLostError, started
from handbench.bench.stages.reconstruct import read_times
from handbench.support.cost import Cost
from handbench.support.errors import HandbenchError
from handbench.support.progress import Work, say
from handbench.support.store import Stage

Done = tuple[Cost, bool]  # what a stage cost, and whether an earlier run had finished it
# stages of which each needs the one before: one is asked for when the one before is finished
Chain = Iterator[Stage]


@dataclass
class Engine:
    """Carries out the stages of a run.
    work: folder of all stages. executor: carries out stages elsewhere (None: all in this process).
    failures: the stages that failed. tasks: lines of the table of stages, in the order in which
    they ended. machines: facts of the machines that did the work, by host name."""

    work: Path
    progress: Work
    executor: Executor | None = None
    failures: list[Failure] = field(default_factory=list)
    tasks: list[dict[str, Any]] = field(default_factory=list)
    machines: dict[str, dict[str, Any]] = field(default_factory=dict)

    def perform(self, stages: Sequence[Stage]) -> dict[Stage, Path]:
        """Carry out stages that do not depend on each other. Returns the folders of those that are
        finished, in the order of `stages`."""
        finished = self.follow(iter([stage]) for stage in stages)
        return {stage: stage.folder(self.work) for stage in stages if stage in finished}

    def follow(self, chains: Iterable[Chain], essential: Container[Chain] = ()) -> list[Stage]:
        """Carry out chains of stages beside each other. Returns the stages that are finished.
        A stage that fails for a reason that the user can mend ends its chain and is recorded; of an
        `essential` chain, HandbenchError is raised. Any other error ends the run."""
        ready, finished = deque(chains), list[Stage]()
        running: dict[Future[Done], tuple[Chain, Stage]] = {}
        suspects: list[tuple[Chain, Stage]] = []  # whose workers ended; one of them has ended them

        def end(future: Future[Done], chain: Chain, stage: Stage) -> None:
            if self._finished(stage, future, chain in essential):
                finished.append(stage)
                ready.append(chain)

        while ready or running or suspects:
            if ready and (stage := next(chain := ready.popleft(), None)):
                self.progress.begin(stage.label)
                running[started(self.executor, self.work, stage)] = chain, stage
            for future in wait(running, 0 if ready else None, FIRST_COMPLETED).done:
                chain, stage = running.pop(future)
                if isinstance(future.exception(), WorkersLostError):
                    suspects.append((chain, stage))
                else:
                    end(future, chain, stage)
            if suspects and not ready and not running:
                chain, stage = suspects.pop(0)
                end(started(self.executor, self.work, stage), chain, stage)  # alone
        return finished

    def _finished(self, stage: Stage, future: Future[Done], essential: bool) -> bool:
        """Wait for the end of a stage, record and print it; tell whether the stage is finished."""
        try:
            cost, cached = future.result()
        except HandbenchError as error:
            if essential:
                raise HandbenchError(f"{stage.label}: {error}") from error
            self.failures.append(failure_of(error, stage.capture, stage.name, stage.method))
            return False
        finally:
            self.progress.end(stage.label)
        say(f"{stage.label}: " + ("cached" if cached else f"{cost.seconds:.1f} s"))
        self._record(stage, cost, cached)
        return True

    def _record(self, stage: Stage, cost: Cost, cached: bool) -> None:
        """Record what a stage cost."""
        host, times = cost.machine.get("host", ""), read_times(stage.folder(self.work))
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
                "cached": cached,
                "plan_seconds": times.get("plan_seconds"),
                "host": host,
                "gemm_gflops": cost.machine.get("gemm_gflops"),
                "others_cores": cost.others_cores,
            }
        )

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
