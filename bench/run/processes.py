"""Stages beside each other in processes of this machine: each has its share of the cores to itself, so that what one
stage does on a single core leaves the others' cores busy. Imaging is done alone, for its seconds are results."""

import ctypes
import os
import pickle
import signal
import traceback
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import suppress
from multiprocessing import current_process, get_context
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from threading import current_thread, main_thread
from typing import Any

import psutil

from handbench.bench.run.tasks import HASH, Done, perform
from handbench.support import cost, progress
from handbench.support.parallel import script_left_out, workers
from handbench.support.store import Stage

PR_SET_PDEATHSIG = 1  # of Linux's prctl: the signal that a process gets when its parent ends
WORTH_S = 60.0  # processor time of a run, several times what the processes take to import the libraries
MOST = 4  # rounds have about as many long stages
STAGE_BYTES = 3.3e9  # of a stage with eight photographs of 4 megapixels at its peak, measured


def room(bytes_: float = 0.0) -> int:
    """Processes that the cores and the memory that is free have room for; bytes_: what a stage takes, if more than most
    do. One where this process may not start others."""
    if current_process().daemon:
        return 1
    return min(workers(), MOST, int(psutil.virtual_memory().available / max(bytes_, STAGE_BYTES)))


class Processes:
    """An executor: stages without a method run beside each other, then the others here, one after the other. The
    processes start when there is work for two of them and live until `close`, or as long as this one. bytes_: what a
    stage takes."""

    def __init__(self, perform: Callable[[Path, Stage], Done] = perform, bytes_: float = 0.0) -> None:
        self.perform, self.bytes_ = perform, bytes_
        self.pipes: dict[Connection, BaseProcess] = {}

    def run(self, root: Path, jobs: Sequence[Stage]) -> Iterator[tuple[int, Done]]:
        """See `bench.run.executors.Executor`."""
        beside = [number for number, job in enumerate(jobs) if _long(root, job)]
        if len(beside) < 2 or not (self.pipes or room(self.bytes_) > 1):
            beside = []
        lost = yield from self._beside(root, jobs, beside)
        for number in lost:  # the system ends processes when memory runs out: each once more, without others
            if (yield from self._beside(root, jobs, [number])):
                failure = f"{jobs[number].label}: its process was ended twice; free memory, or set HANDBENCH_WORKERS=1"
                yield number, Done(failure=failure)
        for number in sorted({*range(len(jobs))} - {*beside}):
            yield number, self.perform(root, jobs[number])

    def close(self) -> None:
        """End the processes, and what they are at."""
        for process in self.pipes.values():
            process.kill()
        for process in self.pipes.values():
            process.join()  # nothing writes any more once this returns
        self.pipes.clear()

    def _beside(
        self, root: Path, jobs: Sequence[Stage], numbers: list[int]
    ) -> Generator[tuple[int, Done], None, list[int]]:
        """Yields the numbers of the jobs that were done, with their outcome; returns those whose process ended."""
        waiting, at_work, lost = numbers[::-1], dict[Connection, int](), list[int]()
        while waiting or at_work:
            if not self.pipes:
                self._start()
            for pipe in [pipe for pipe in self.pipes if pipe not in at_work][: len(waiting)]:
                at_work[pipe] = waiting.pop()
                with suppress(ConnectionError):  # of a process that has ended, which its answer tells
                    pipe.send((root, jobs[at_work[pipe]]))
            for ready in wait(list(at_work)):
                assert isinstance(ready, Connection)
                number = at_work.pop(ready)
                if (answer := self._answer(ready)) is None:
                    lost.append(number)
                else:
                    yield number, answer
        return lost

    def _answer(self, pipe: Connection) -> Done | None:
        """The outcome that a process sends; None if it has ended."""
        try:
            answer: Done | BaseException = pipe.recv()
        except (EOFError, ConnectionError):
            self.pipes.pop(pipe).kill()
            return None
        if isinstance(answer, BaseException):
            raise answer
        return answer

    def _start(self) -> None:
        context, machine, allowed = get_context("spawn"), cost.calibrated_machine(), os.sched_getaffinity(0)
        cores = sorted(allowed)[: workers()]
        count = max(min(room(self.bytes_), len(cores)), 1)
        here_only = current_thread() is main_thread()  # Ctrl-C is this process's, which ends the others
        before = signal.signal(signal.SIGINT, signal.SIG_IGN) if here_only else None
        try:
            for n in range(count):
                here, there = context.Pipe()
                share = cores[n * len(cores) // count : (n + 1) * len(cores) // count]
                os.sched_setaffinity(0, share)  # the process inherits it, and each library that counts cores heeds it
                told = there, self.perform, len(share), machine, os.getpid()
                process = context.Process(target=_serve, args=told, daemon=True)
                with script_left_out():
                    process.start()
                there.close()  # so that a process that ends is noticed
                self.pipes[here] = process
        finally:
            os.sched_setaffinity(0, allowed)
            if here_only:
                signal.signal(signal.SIGINT, before)


def _sent(error: BaseException, text: str) -> BaseException:
    """An exception with its traceback, as it arrives in another process; the traceback alone of one that does not."""
    error.add_note(text)
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError(text)
    return error


def _long(root: Path, job: Stage) -> bool:
    """True for a stage that has to be made and whose time is no result."""
    return not job.method and job.name != HASH and not job.folder(root).exists()


def _serve(
    pipe: Connection, perform: Callable[[Path, Stage], Done], threads: int, machine: dict[str, Any], parent: int
) -> None:
    """A process's work: jobs come and outcomes go until the pipe is closed. machine: measured while it was quiet."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)  # what outlives the run would write into the next one's
    if os.getppid() != parent:
        return
    os.environ["HANDBENCH_WORKERS"] = str(threads)
    progress.BARS = False  # several would draw over each other
    cost.CALIBRATED |= machine
    with suppress(EOFError, ConnectionError):
        while job := pipe.recv():
            try:
                answer: Done | BaseException = perform(*job)
            except BaseException as error:
                answer = _sent(error, traceback.format_exc())
            pipe.send(answer)
