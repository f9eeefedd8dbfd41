"""Who carries out the jobs of a run: this process, one after the other, or the workers of a Dask cluster.

The jobs of one call depend on nothing in that call: what needs another stage's outcome is in a later call. So the order
in which they end does not matter, and a worker's loss costs the jobs that it had.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from bench.tasks import Done, Job, perform
from radar.errors import HandbenchError

if TYPE_CHECKING:  # an extra
    from distributed import Client, Future

IN_FLIGHT = 256  # jobs that the scheduler knows of at once: enough for as many workers, and little of anyone's memory
BATCH = 64
CONNECT_S = 20.0


class Executor(Protocol):
    """Carries out jobs that do not depend on each other."""

    def run(self, root: Path, jobs: Sequence[Job]) -> Iterator[tuple[int, Done]]:
        """Yield each job's number and outcome as it ends; folders go under `root`. Unknown exceptions are raised."""
        ...


class InPlace:
    """In this process, in the order of the list."""

    def __init__(self, perform: Callable[[Path, Job], Done] = perform) -> None:
        self.perform = perform

    def run(self, root: Path, jobs: Sequence[Job]) -> Iterator[tuple[int, Done]]:
        """See `Executor`."""
        for number, job in enumerate(jobs):
            yield number, self.perform(root, job)


class Cluster:
    """On the workers of a Dask scheduler. Few jobs are submitted ahead, so that neither side holds the whole run.

    A job whose worker is lost is given to another one by the scheduler, which is safe, for a stage's folder appears
    complete or not at all.
    """

    def __init__(self, client: Client, perform: Callable[[Path, Job], Done] = perform) -> None:
        self.client, self.perform = client, perform

    def run(self, root: Path, jobs: Sequence[Job]) -> Iterator[tuple[int, Done]]:
        """See `Executor`."""
        from distributed import as_completed

        waiting, numbers = iter(range(len(jobs))), {}

        def submit(count: int) -> list[Future]:
            batch = list(islice(waiting, count))
            futures = self.client.map(partial(self.perform, root), [jobs[number] for number in batch], pure=False)
            numbers.update(zip((future.key for future in futures), batch, strict=True))
            return futures

        ending = as_completed(submit(IN_FLIGHT), loop=self.client.loop)
        try:
            for future in ending:
                number = numbers.pop(future.key)
                done = _outcome(future, jobs[number])
                if len(numbers) <= IN_FLIGHT - BATCH:  # one by one they would cost the scheduler more than the jobs
                    ending.update(submit(BATCH))
                yield number, done
        finally:
            self.client.cancel(list(ending.futures))


def _outcome(future: Future, job: Job) -> Done:
    from concurrent.futures import CancelledError

    from distributed import KilledWorker

    try:
        return future.result()
    except KilledWorker as error:
        deaths = error.allowed_failures + 1
        return Done(failure=f"{job.label}: {deaths} workers died over it; give the workers more memory")
    except CancelledError as error:
        raise HandbenchError(
            f"--scheduler: {job.label} was cancelled ({error}); is the scheduler alive? Run again, it resumes"
        ) from error


@contextmanager
def executor(scheduler: str | None = None) -> Iterator[Executor]:
    """In place, or the cluster of the Dask scheduler at this address, tcp://host:port."""
    if scheduler is None:
        yield InPlace()
        return
    try:
        from distributed import Client
    except ImportError as error:
        raise HandbenchError(
            f"--scheduler: needs Dask ({error}); pip install 'handbench[cluster]', or leave the option out"
        ) from error
    try:
        client = Client(scheduler, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise HandbenchError(
            f"--scheduler: no Dask scheduler answers at '{scheduler}' ({error}); expected tcp://host:port of a "
            "running `dask scheduler`"
        ) from error
    with client:
        yield Cluster(client)
