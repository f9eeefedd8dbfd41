"""Stages beside each other in processes of this machine: each has its share of the cores to itself, so that what one
stage does on a single core leaves the others' cores busy. Imaging is done alone, for its seconds are results."""

import os
import signal
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

import psutil

from bench.run.tasks import HASH, Done, perform
from radar.support import cost
from radar.support.parallel import script_left_out, workers
from radar.support.store import Stage

WORTH_S = 60.0  # processor time of a run, several times what the processes take to import the libraries
MOST = 4  # rounds have about as many long stages
STAGE_BYTES = 3.3e9  # of a stage with eight photographs of 4 megapixels at its peak, measured


def room() -> int:
    """Processes that the cores and the memory that is free have room for."""
    return min(workers(), MOST, int(psutil.virtual_memory().available / STAGE_BYTES))


class Processes:
    """An executor: stages without a method run beside each other, then the others here, one after the other. The
    processes start when there is work for two of them and live until `close`."""

    def __init__(self, perform: Callable[[Path, Stage], Done] = perform) -> None:
        self.perform = perform
        self.pipes: dict[Connection, BaseProcess] = {}

    def run(self, root: Path, jobs: Sequence[Stage]) -> Iterator[tuple[int, Done]]:
        """See `bench.run.executors.Executor`."""
        beside = [number for number, job in enumerate(jobs) if _long(root, job)]
        if len(beside) < 2 or not (self.pipes or room() > 1):
            beside = []
        yield from self._beside(root, jobs, beside)
        for number in sorted({*range(len(jobs))} - {*beside}):
            yield number, self.perform(root, jobs[number])

    def close(self) -> None:
        """End the processes, and what they are at."""
        for process in self.pipes.values():
            process.kill()
        self.pipes.clear()

    def _beside(self, root: Path, jobs: Sequence[Stage], numbers: list[int]) -> Iterator[tuple[int, Done]]:
        waiting, at_work = numbers[::-1], dict[Connection, int]()
        while waiting or at_work:
            if not self.pipes:
                self._start()
            for pipe in [pipe for pipe in self.pipes if pipe not in at_work][: len(waiting)]:
                at_work[pipe] = waiting.pop()
                with suppress(ConnectionError):  # of a process that has ended, which its answer tells
                    pipe.send((root, jobs[at_work[pipe]]))
            for ready in wait(list(at_work)):
                assert isinstance(ready, Connection)
                yield (number := at_work.pop(ready)), self._answer(ready, jobs[number])

    def _answer(self, pipe: Connection, job: Stage) -> Done:
        try:
            answer: Done | BaseException = pipe.recv()
        except (EOFError, ConnectionError):  # the system ends processes when memory runs out
            self.pipes.pop(pipe).kill()
            return Done(failure=f"{job.label}: its process was ended; free memory, or set HANDBENCH_WORKERS=1")
        if isinstance(answer, BaseException):
            raise answer
        return answer

    def _start(self) -> None:
        context, machine, allowed = get_context("spawn"), cost.calibrated_machine(), os.sched_getaffinity(0)
        cores = sorted(allowed)[: workers()]
        count = max(min(room(), len(cores)), 1)
        try:
            for n in range(count):
                here, there = context.Pipe()
                share = cores[n * len(cores) // count : (n + 1) * len(cores) // count]
                os.sched_setaffinity(0, share)  # the process inherits it, and each library that counts cores heeds it
                process = context.Process(target=_serve, args=(there, self.perform, len(share), machine), daemon=True)
                with script_left_out():
                    process.start()
                there.close()  # so that a process that ends is noticed
                self.pipes[here] = process
        finally:
            os.sched_setaffinity(0, allowed)


def _long(root: Path, job: Stage) -> bool:
    """True for a stage that has to be made and whose time is no result."""
    return not job.method and job.name != HASH and not job.folder(root).exists()


def _serve(pipe: Connection, perform: Callable[[Path, Stage], Done], threads: int, machine: dict[str, Any]) -> None:
    """A process's work: jobs come and outcomes go until the pipe is closed. machine: measured while it was quiet."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's, which ends this process
    os.environ["HANDBENCH_WORKERS"] = str(threads)
    cost.CALIBRATED |= machine
    with suppress(EOFError):
        while job := pipe.recv():
            try:
                answer: Done | BaseException = perform(*job)
            except BaseException as error:
                error.add_note(traceback.format_exc())
                answer = error
            pipe.send(answer)
