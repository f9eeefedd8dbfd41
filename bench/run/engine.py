"""The engine of a run: it carries out stages, in this process, in several processes of this machine
or on the workers of a Dask cluster, and records what they cost and which failed."""

from __future__ import annotations

import asyncio
import logging
import os
import threading
from collections import deque
from collections.abc import Callable, Container, Iterable, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    wait,
)
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from multiprocessing import active_children, current_process, get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

import psutil

from handbench.support.cost import Cost, machine
from handbench.support.errors import HandbenchError
from handbench.support.parallel import begin_process, script_left_out, workers
from handbench.support.progress import Work, say
from handbench.support.store import Stage, cached, code_key

if TYPE_CHECKING:  # an extra, and what takes a second to import, which other processes do without
    from distributed import Client

    from handbench.bench.results.about import Failure

MOST = 4  # processes: a table has about as many long chains
STAGE_BYTES = 3.3e9  # of a stage with eight photographs of 4 megapixels at its peak, measured
CONNECT_S = 10.0  # longest wait for a scheduler, and for a worker
LOOK_S = 5.0  # from one look for workers to the next
# print tracebacks of lost connections
LOGS = ("distributed", "distributed.client", "tornado.application", "asyncio")
# a cost is measured of the whole process, which therefore carries out one stage at a time
_ALONE = threading.Lock()


class ProcessExecutor(ProcessPoolExecutor):
    """Executor that carries out stages in several processes of this machine, each with its own
    share of the cores. The processes start with the first stage. count: number of processes;
    scratch: folder of their temporary files."""

    def __init__(self, count: int, scratch: str) -> None:
        context, cores = get_context("spawn"), sorted(os.sched_getaffinity(0))[: workers()]
        shares = [cores[n::count] for n in range(count)]
        begin = (shares, context.Value("i", 0), os.getpid(), scratch)
        super().__init__(count, context, begin_process, begin)

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Queue a call of the function in the next idle process, and return its future."""
        with script_left_out():
            return super().submit(function, *args, **kwargs)


class WorkersLostError(HandbenchError):
    """The workers ended that a stage was given to; perhaps another stage of theirs ended them."""


class DaskExecutor(Executor):
    """Executor that carries out stages on the workers of a Dask scheduler.
    If a worker is lost, the scheduler gives its stages to another worker. This is safe because the
    folder of a stage appears complete or not at all."""

    def __init__(self, client: Client) -> None:
        # its futures fail when the scheduler has gone; those of get_executor() then never end
        self._client = client

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Send a call of the function to one of the cluster's workers, and return its future."""
        future: Future[Any] = Future()
        sent: Any = self._client.submit(function, *args, pure=False, **kwargs)
        sent.add_done_callback(partial(_pass_on, future))
        return future

    def require_workers(self) -> None:
        """Raise a HandbenchError if the cluster has no workers and gets none within 10 s."""
        try:
            self._client.wait_for_workers(1, CONNECT_S)
        except TimeoutError:
            raise HandbenchError(
                "--scheduler: the scheduler has no workers; start some (dask worker ADDRESS), then "
                "run the same command, which resumes the run"
            ) from None


def _pass_on(future: Future[Any], ended: Future[Any]) -> None:
    """Copy the result or the error of a Dask future, `ended`, to an ordinary future."""
    from distributed import KilledWorker

    try:
        future.set_result(ended.result())
    except KilledWorker:
        message = "its workers ended while computing it; give the workers more memory"
        future.set_exception(WorkersLostError(message))
    except BaseException as error:
        future.set_exception(error)


def elsewhere(root: Path, stage: Stage, facts: dict[str, Any] | None = None) -> tuple[Cost, bool]:
    """Carry out a stage in a worker process, as `cached` does.
    root: folder of all stages. facts: of this machine (None: they are measured here). Raises
    HandbenchError if the worker does not see this folder, or has other versions of handbench or of
    its libraries."""
    if not root.is_dir():
        raise HandbenchError(
            f"{root}: this machine does not have the result folder; put it on a disk that all "
            "workers share"
        )
    if code_key(stage.function) != stage.code:
        raise HandbenchError(
            f"{stage.label}: this worker has another version of handbench or of a library than "
            "the client; install the same versions on both"
        )
    with _ALONE:
        return cached(root, stage, facts)


def started(executor: Executor | None, root: Path, stage: Stage) -> Future[tuple[Cost, bool]]:
    """Start a stage; return the future of what `cached` returns. A cluster gets every stage.
    Processes of this machine get those that share it and are not in the store `root`; all others
    are carried out in this process before this function returns, because the time of imaging is a
    result. executor: None for this process alone."""
    beside = stage.shares and not stage.folder(root).exists()
    if isinstance(executor, DaskExecutor):
        return executor.submit(elsewhere, root, stage)
    facts = machine()  # measured with the first stage, before others run
    if executor is not None and beside:
        return executor.submit(elsewhere, root, stage, facts)
    future: Future[tuple[Cost, bool]] = Future()
    try:
        future.set_result(cached(root, stage))
    except HandbenchError as error:
        future.set_exception(error)
    return future


def process_count(chains: int) -> int:
    """Return the number of processes for which a run has work, that is long chains of stages, and
    this machine has cores and free memory; 0 if there are not two, or this process may not start
    others."""
    if current_process().daemon:
        return 0
    cores = min(workers(), len(os.sched_getaffinity(0)))
    fitting = int(psutil.virtual_memory().available / STAGE_BYTES)
    count = min(cores, chains, MOST, fitting)
    return count if count > 1 else 0


@contextmanager
def executor(count: int, scheduler: str | None = None) -> Iterator[Executor | None]:
    """Provide the executor of a run as a context manager; None for this process alone.
    count: number of processes beside this one. scheduler: address of a Dask scheduler,
    tcp://host:port, whose workers are used instead. Raises HandbenchError if the system ends a
    process, if no scheduler answers, or if it stops answering during the run."""
    if scheduler is not None:
        with _cluster(scheduler) as cluster:
            yield cluster
        return
    if not count:
        yield None
        return
    with TemporaryDirectory(prefix="handbench-", ignore_cleanup_errors=True) as scratch:
        processes, others = ProcessExecutor(count, scratch), set(active_children())
        try:
            yield processes
        except BrokenProcessPool:
            raise HandbenchError(
                "the operating system ended a process of this run, probably for lack of memory; "
                "free memory or set HANDBENCH_WORKERS=1, then run the same command, which resumes "
                "the run"
            ) from None
        finally:  # no stage writes files after this
            for process in set(active_children()) - others:
                process.kill()
            processes.shutdown(cancel_futures=True)


def _require_scheduler(scheduler: str) -> None:
    """Raise a HandbenchError if no Dask scheduler answers at an address."""
    from distributed.core import rpc
    from distributed.security import Security

    async def identity() -> dict[str, Any]:
        security = Security().get_connection_args("client")  # certificates that Dask is set to use
        async with rpc(scheduler, connection_args=security) as remote:
            return await remote.identity()

    try:
        if not urlsplit(scheduler).port:
            raise ValueError("it has no port")
        # a client would wait for ever at other servers' ports; a notebook has a loop of its own
        with ThreadPoolExecutor(1) as thread:
            answer = thread.submit(asyncio.run, asyncio.wait_for(identity(), CONNECT_S)).result()
        dict(answer["workers"])
    except Exception as error:  # whatever another server answers
        raise HandbenchError(
            f"--scheduler: no Dask scheduler answers at '{scheduler}' "
            f"({str(error) or 'it is silent'}); give tcp://host:port of a running `dask "
            "scheduler`: its own port, not the dashboard's"
        ) from error


@contextmanager
def _cluster(scheduler: str) -> Iterator[DaskExecutor]:
    """Provide the executor of a Dask cluster as a context manager. scheduler: its address."""
    try:
        from distributed import Client
    except ImportError as error:
        raise HandbenchError(
            f"--scheduler: needs Dask, which cannot be imported ({error}); run pip install "
            "'handbench[cluster]', or leave --scheduler out"
        ) from error
    for name in LOGS:  # an error of the cluster is reported once, in a sentence
        logging.getLogger(name).setLevel(logging.CRITICAL)
    _require_scheduler(scheduler)
    try:
        with Client(scheduler, set_as_default=False) as client:
            cluster = DaskExecutor(client)
            cluster.require_workers()
            yield cluster
    except (CancelledError, OSError) as error:
        # a file's; those of connections have none
        if isinstance(error, OSError) and error.errno is not None:
            raise
        raise HandbenchError(
            "--scheduler: the connection to the scheduler is lost; start the scheduler again, "
            "then run the same command, which resumes the run"
        ) from error


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
            if isinstance(self.executor, DaskExecutor):
                self.executor.require_workers()
            for future in wait(running, 0 if ready else LOOK_S, FIRST_COMPLETED).done:
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
        from handbench.bench.stages.reconstruct import read_times

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
    from handbench.bench.results.about import Failure

    failure = Failure(capture=capture, method=method, stage=stage, message=str(error))
    say(failure.line)
    return failure
