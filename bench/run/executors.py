"""Executors, which carry out the stages of a run: in this process, in several processes of this
machine, or on the workers of a Dask cluster.

A job is a function that is called with the folder of all stages and one stage. If it raises a
HandbenchError, which the user can mend, the job's future has this error and the run goes on. Any
other exception keeps its traceback and ends the run.
"""

from __future__ import annotations

import logging
import os
import pickle
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import (
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
)
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import partial
from multiprocessing import current_process, get_context
from pathlib import Path
from queue import SimpleQueue
from typing import TYPE_CHECKING, Any

import psutil

from handbench.radar.methods.registry import method_key
from handbench.support import cost
from handbench.support.errors import HandbenchError
from handbench.support.parallel import begin_process, script_left_out, workers
from handbench.support.store import Stage, stage_code_hash

if TYPE_CHECKING:  # an extra
    from distributed import Client

HASH = "hash"  # no stage that is kept: a capture's folder has to be read to know what it holds
# processor time of a run, several times what the processes take to import the libraries
WORTH_S = 60.0
MOST = 4  # processes: rounds have about as many long stages
STAGE_BYTES = 3.3e9  # of a stage with eight photographs of 4 megapixels at its peak, measured
# jobs that an executor has at once: enough for as many workers, and little of anyone's memory
IN_FLIGHT = 256
CONNECT_S = 20.0
# print tracebacks of lost connections
LOGS = ("distributed", "distributed.client", "tornado.application", "asyncio")
# a cost is measured of the whole process, which therefore does one job at a time
_ALONE = threading.Lock()


class LocalExecutor(Executor):
    """Executor that runs each job in this process, before `submit` returns."""

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Call the function at once, and return a finished future with its result.
        If the function raises a HandbenchError, the future has that error; any other error is
        raised here."""
        future: Future[Any] = Future()
        try:
            future.set_result(function(*args, **kwargs))
        except HandbenchError as error:
            future.set_exception(error)
        return future


class ProcessExecutor(ThreadPoolExecutor):
    """Executor that runs jobs in several processes of this machine, each with its own share of the
    cores.
    The processes start with their first job and end with `shutdown` or with this process. If the
    system kills a process for want of memory, its job is tried once more while the other processes
    are idle; other jobs are not affected. count: number of processes."""

    def __init__(self, count: int) -> None:
        super().__init__(count)
        cores = sorted(os.sched_getaffinity(0))[: workers()]
        self._shares = [
            cores[n * len(cores) // count : (n + 1) * len(cores) // count] for n in range(count)
        ]
        self._machine = cost.calibrated_machine()  # measured while nothing else runs
        self._pools = [self._pool(number) for number in range(count)]
        self._idle: SimpleQueue[int] = SimpleQueue()
        for number in range(count):
            self._idle.put(number)
        self._alone, self._ended = threading.Lock(), False

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Queue a call of the function in the next idle process, and return its future."""
        return super().submit(
            self._call, partial(elsewhere, self._machine, function, *args, **kwargs)
        )

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Kill all processes, including those that have a job. No job writes files after this
        returns."""
        self._ended = True
        super().shutdown(wait=False, cancel_futures=True)
        for pool in self._pools:
            for process in list((pool._processes or {}).values()):
                process.kill()
            pool.shutdown()
        super().shutdown(wait=True)

    def _pool(self, number: int) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(
            1, get_context("spawn"), begin_process, (self._shares[number], os.getpid())
        )

    def _call(self, job: Callable[[], Any]) -> Any:
        """Run a job in an idle process, and return its result.
        If the process dies, the job is tried once more while all other processes are idle. Raises
        HandbenchError if that process dies too."""
        try:
            return self._tried(self._idle.get(), job)
        except BrokenProcessPool:
            with self._alone:
                held = [self._idle.get() for _ in self._pools]
                try:
                    return self._tried(held.pop(), job)
                except BrokenProcessPool:
                    raise HandbenchError(
                        "the operating system ended its process twice, probably for lack of "
                        "memory; free memory, or set HANDBENCH_WORKERS=1"
                    ) from None
                finally:
                    for number in held:
                        self._idle.put(number)

    def _tried(self, number: int, job: Callable[[], Any]) -> Any:
        try:
            with script_left_out():
                future = self._pools[number].submit(job)
            return future.result()
        except BrokenProcessPool:
            if not self._ended:
                self._pools[number] = self._pool(number)
            raise
        finally:
            self._idle.put(number)


class DaskExecutor(Executor):
    """Executor that runs jobs on the workers of a Dask scheduler.
    If a worker is lost, the scheduler gives its job to another worker. This is safe because the
    folder of a stage appears complete or not at all."""

    def __init__(self, client: Client) -> None:
        # its futures fail when the scheduler has gone; those of get_executor() then never end
        self._client = client

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Send a call of the function to one of the cluster's workers, and return its future."""
        future: Future[Any] = Future()
        sent = self._client.submit(elsewhere, {}, function, *args, pure=False, **kwargs)
        sent.add_done_callback(partial(_pass_on, future))
        return future


def _pass_on(future: Future[Any], ended: Future[Any]) -> None:
    """Copy the result or the error of a Dask future, `ended`, to an ordinary future.
    If the workers were killed, the error becomes a HandbenchError that suggests more memory."""
    from distributed import KilledWorker

    try:
        future.set_result(ended.result())
    except KilledWorker as error:
        deaths = error.allowed_failures + 1
        future.set_exception(
            HandbenchError(
                f"{deaths} workers ended while computing it; give the workers more memory"
            )
        )
    except BaseException as error:
        future.set_exception(error)


def elsewhere(
    machine: dict[str, Any], function: Callable[[Path, Stage], Any], root: Path, stage: Stage
) -> Any:
    """Execute a stage in a worker process, and return what `function(root, stage)` returns.
    machine: facts of this machine that were measured already (may be empty). root: folder of all
    stages. An error that cannot be pickled, and so not be sent back, is raised as a RuntimeError
    with the traceback as its text."""
    cost.CALIBRATED |= machine
    try:
        with _ALONE:
            if stage.name != HASH:
                _require_same(root, stage)
            return function(root, stage)
    except Exception as error:
        try:
            pickle.loads(pickle.dumps(error))
        except Exception:
            raise RuntimeError(traceback.format_exc()) from None  # one that arrives
        raise


def _require_same(root: Path, stage: Stage) -> None:
    """Check that a worker can execute a stage exactly as the machine that sent it.
    Raises HandbenchError if the worker does not see the result folder, or has other versions of
    handbench or of its libraries."""
    if not root.is_dir():
        raise HandbenchError(
            f"{root}: this machine does not have the result folder; put it on a disk that all "
            "workers share"
        )
    plugged = method_key(stage.method) if stage.method else ()
    if stage_code_hash(stage.function, plugged) != stage.code:
        raise HandbenchError(
            f"{stage.label}: this worker has another version of handbench or of a library than "
            "the client; install the same versions on both"
        )


def assigned(
    executor: Executor, root: Path, stages: Sequence[Stage]
) -> list[tuple[Executor, list[int]]]:
    """Decide which executor runs which stages.
    Returns a list of executors, to be used one after the other, each with the indices of its
    stages. If the executor has several processes, they get the unfinished stages that do no
    imaging, provided there are at least two. All other stages run in this process while nothing
    else is at work, because the time of imaging is a result."""
    numbers = list(range(len(stages)))
    if not isinstance(executor, ProcessExecutor):
        return [(executor, numbers)]
    long = [n for n in numbers if not stages[n].method and stages[n].name != HASH]
    long = [n for n in long if not stages[n].folder(root).exists()]
    if len(long) < 2:
        return [(LocalExecutor(), numbers)]
    return [(executor, long), (LocalExecutor(), [n for n in numbers if n not in long])]


def room(bytes_: float = 0.0) -> int:
    """Return the number of processes for which this machine has cores and free memory.
    bytes_: memory that one stage needs, if more than usual. Returns 1 if this process may not start
    others."""
    if current_process().daemon:
        return 1
    cores = min(workers(), len(os.sched_getaffinity(0)))
    return min(cores, MOST, int(psutil.virtual_memory().available / max(bytes_, STAGE_BYTES)))


@contextmanager
def executor(
    scheduler: str | None = None, core_s: float = 0.0, bytes_: float = 0.0
) -> Iterator[Executor]:
    """Provide the executor of a run as a context manager.
    scheduler: address of a Dask scheduler, tcp://host:port, whose workers are then used. Without
    it, the run uses several processes of this machine if the predicted processor time core_s, s, is
    worth starting them, and otherwise only this process. bytes_: memory that one stage needs.
    Raises HandbenchError if no scheduler answers, or if it stops answering during the run."""
    if scheduler is None:
        count = room(bytes_) if core_s > WORTH_S else 1
        with ProcessExecutor(count) if count > 1 else LocalExecutor() as found:
            yield found
        return
    try:
        from distributed import Client
    except ImportError as error:
        raise HandbenchError(
            f"--scheduler: needs Dask, which cannot be imported ({error}); run pip install "
            "'handbench[cluster]', or leave --scheduler out"
        ) from error
    for name in LOGS:  # an error of the cluster is reported once, in a sentence
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        client = Client(scheduler, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise HandbenchError(
            f"--scheduler: no Dask scheduler answers at '{scheduler}' ({error}); give "
            "tcp://host:port of a running `dask scheduler`"
        ) from error
    try:
        with client:
            yield DaskExecutor(client)
    except (CancelledError, OSError) as error:
        # a file's; those of connections have none
        if isinstance(error, OSError) and error.errno is not None:
            raise
        raise HandbenchError(
            "--scheduler: the connection to the scheduler is lost; start the scheduler again, "
            "then run the same command, which resumes the run"
        ) from error
