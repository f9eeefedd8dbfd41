"""Executors carry out the jobs of a run: this process, others beside it, or a Dask cluster's workers.

The jobs of one call depend on nothing in that call: what needs another stage's outcome is in a later call. So the order
in which they end does not matter, and a worker's loss costs the jobs that it had.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from handbench.bench.run.processes import WORTH_S, Processes
from handbench.bench.run.tasks import Done, perform
from handbench.support.errors import HandbenchError
from handbench.support.store import Stage

if TYPE_CHECKING:  # an extra
    from distributed import Client, Future

Group = tuple[int, ...]  # numbers of jobs that go to a worker together

IN_FLIGHT = 256  # groups that the scheduler knows of at once: enough for as many workers, and little of anyone's memory
BATCH = 64
GROUPS_A_THREAD, LARGEST_GROUP = 16, 8  # so many groups at least, that no worker waits long for the last one
CONNECT_S = 20.0
LOGS = "distributed", "distributed.client", "tornado.application", "asyncio"  # print tracebacks of lost connections


class Executor(Protocol):
    """Carries out jobs that do not depend on each other."""

    def run(self, root: Path, jobs: Sequence[Stage]) -> Iterator[tuple[int, Done]]:
        """Yield each job's number and outcome as it ends; folders go under `root`. Unknown exceptions are raised."""
        ...


class InPlace:
    """In this process, in the order of the list."""

    def __init__(self, perform: Callable[[Path, Stage], Done] = perform) -> None:
        self.perform = perform

    def run(self, root: Path, jobs: Sequence[Stage]) -> Iterator[tuple[int, Done]]:
        """See `Executor`."""
        for number, job in enumerate(jobs):
            yield number, self.perform(root, job)


class Cluster:
    """On the workers of a Dask scheduler. Few jobs are submitted ahead, so that neither side holds the whole run; of
    many more than there are workers, some go together, for a Dask task by itself costs as much as a small job.

    A group whose worker is lost is given to another one by the scheduler, which is safe, for a stage's folder appears
    complete or not at all. Where several died over it, its jobs go again one by one, and the one to blame fails alone.
    """

    def __init__(self, client: Client, perform: Callable[[Path, Stage], Done] = perform) -> None:
        self.client, self.perform = client, perform

    def run(self, root: Path, jobs: Sequence[Stage]) -> Iterator[tuple[int, Done]]:
        """See `Executor`."""
        from distributed import as_completed

        threads = max(sum(self.client.nthreads().values()), 1)
        size = min(max(len(jobs) // (GROUPS_A_THREAD * threads), 1), LARGEST_GROUP)
        waiting = [tuple(range(first, min(first + size, len(jobs)))) for first in range(0, len(jobs), size)][::-1]
        groups: dict[str, Group] = {}  # those that the scheduler knows of

        def submit() -> list[Future]:
            batch = [waiting.pop() for _ in range(min(len(waiting), IN_FLIGHT - len(groups)))]
            work = [[jobs[number] for number in group] for group in batch]
            futures = self.client.map(partial(_perform, self.perform, root), work, pure=False)
            groups.update(zip((future.key for future in futures), batch, strict=True))
            return futures

        ending = as_completed(submit(), loop=self.client.loop)
        try:
            for batch in ending.batches():  # what has ended by now, fetched together
                ended = [(groups.pop(future.key), future) for future in batch]
                for group, done in self._outcomes(ended, jobs):
                    if done is None:
                        waiting.extend((number,) for number in group)
                    else:
                        yield from zip(group, done, strict=True)
                if waiting and len(groups) <= IN_FLIGHT - BATCH:
                    ending.update(submit())
        finally:
            self.client.cancel(list(ending.futures))

    def _outcomes(
        self, ended: list[tuple[Group, Future]], jobs: Sequence[Stage]
    ) -> Iterator[tuple[Group, list[Done] | None]]:
        """Each group with what its jobs came to; None where they have to go again one by one."""
        well = [future for _, future in ended if future.status == "finished"]
        fetched = dict(zip((future.key for future in well), self.client.gather(well), strict=True))
        for group, future in ended:
            yield group, fetched[future.key] if future.key in fetched else _unwell(future, [jobs[n] for n in group])


def _perform(perform: Callable[[Path, Stage], Done], root: Path, jobs: list[Stage]) -> list[Done]:
    return [perform(root, job) for job in jobs]


def _unwell(future: Future, jobs: list[Stage]) -> list[Done] | None:
    from distributed import KilledWorker

    try:
        return future.result()
    except KilledWorker as error:
        if len(jobs) > 1:
            return None
        deaths = error.allowed_failures + 1
        return [Done(failure=f"{jobs[0].label}: {deaths} workers died over it; give the workers more memory")]
    except CancelledError as error:
        raise HandbenchError(
            f"--scheduler: {jobs[0].label} was cancelled ({error}); is the scheduler alive? Run again, it resumes"
        ) from error


@contextmanager
def executor(scheduler: str | None = None, core_s: float = 0.0, bytes_: float = 0.0) -> Iterator[Executor]:
    """In place, with processes beside this one where so much processor time, core_s, is worth them; or the cluster of
    the Dask scheduler at this address, tcp://host:port."""
    if scheduler is None:
        with closing(Processes(bytes_=bytes_)) as processes:
            yield processes if core_s > WORTH_S else InPlace()
        return
    try:
        from distributed import Client
    except ImportError as error:
        raise HandbenchError(
            f"--scheduler: needs Dask ({error}); pip install 'handbench[cluster]', or leave the option out"
        ) from error
    for name in LOGS:  # what goes wrong here is told once, in a sentence
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        client = Client(scheduler, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise HandbenchError(
            f"--scheduler: no Dask scheduler answers at '{scheduler}' ({error}); expected tcp://host:port of a "
            "running `dask scheduler`"
        ) from error
    try:
        with client:
            yield Cluster(client)
    except (CancelledError, OSError) as error:
        if isinstance(error, OSError) and error.errno is not None:  # a file's; those of connections have none
            raise
        raise HandbenchError("--scheduler: it has gone away; start it anew and run again, which resumes") from error
