"""Threads for independent parts of a computation, whose number never changes results; and helpers
for starting processes.

This module imports no library that counts the cores, so that a process can restrict its cores
first.
"""

import ctypes
import os
import signal
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager
from functools import cache
from threading import Event, RLock, local
from typing import Any, TypeVar

from threadpoolctl import ThreadpoolController

from handbench.support.errors import HandbenchError

PR_SET_PDEATHSIG = 1  # of Linux's prctl: the signal that a process gets when its parent ends
HIDDEN = {"__file__", "__spec__"}  # of a script
Item = TypeVar("Item")
Number = TypeVar("Number", int, float)


def workers() -> int:
    """Return the number of threads to use: HANDBENCH_WORKERS if set, otherwise the number of cores
    available to this process. Raises HandbenchError if HANDBENCH_WORKERS is not a whole number from
    1 on."""
    return setting(
        "HANDBENCH_WORKERS", len(os.sched_getaffinity(0)), "whole number of threads", int
    )


def setting(name: str, default: Number, what: str, convert: Callable[[str], Any] = float) -> Number:
    """Return a positive number from the environment variable `name`, or `default` if it is not set.
    what: "number of" its unit, for the message. Raises HandbenchError for any other text."""
    wanted = os.environ.get(name, "")
    try:
        value = convert(wanted) if wanted else default
    except ValueError:
        value = convert("0")
    if not value > 0:
        raise HandbenchError(f"{name}: is '{wanted}'; set it to a positive {what}, or unset it")
    return value


def for_each(function: Callable[[Item], None], items: Iterable[Item]) -> None:
    """Call function(item) for all items in several threads, and return when all are done. The first
    exception is raised; items that have not begun are then skipped.

    In the calls, BLAS uses one thread, because nested threads would cost 2.5–3 times the CPU time.
    No new threads are used for a single item, with a single worker, or if one of these threads
    calls `for_each` again.
    """
    items = list(items)
    with one_blas_thread():
        if len(items) == 1 or workers() == 1 or getattr(_inside, "worker", False):
            for item in items:
                function(item)
            return
        remaining = iter(items)  # a list's iterator hands every item to one thread only
        stop = Event()

        def drain() -> None:  # cheaper than a task per item
            _inside.worker = True
            for item in remaining:
                if stop.is_set():
                    return
                function(item)

        futures = [_pool(workers()).submit(drain) for _ in range(min(workers(), len(items)))]
        try:
            for future in futures:
                future.result()
        except BaseException:
            stop.set()
            wait(futures)
            raise


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Context manager in which BLAS uses one thread, for small matrix products outside `for_each`.
    BLAS has one limit for all threads: the first that enters sets it, and the last that leaves
    restores it."""
    global _limited, _limit
    with _limiting:
        if not _limited:
            _limit = _blas().limit(limits=1, user_api="blas")
        _limited += 1
    try:
        yield
    finally:
        with _limiting:
            _limited -= 1
            if not _limited:
                _limit.restore_original_limits()


@cache  # looking for them takes milliseconds
def _blas() -> ThreadpoolController:
    """Return the BLAS libraries of this process: NumPy's, and SciPy's own, which is loaded first,
    since one that is loaded later would escape the limit."""
    import scipy.linalg  # noqa: F401

    return ThreadpoolController()


@contextmanager
def script_left_out() -> Iterator[None]:
    """Context manager in which new processes do not run the user's script.
    With the start method "spawn", multiprocessing runs the script in a new process to be able to
    unpickle its objects. A script without `if __name__ == "__main__"` would then start all over
    again."""
    script = sys.modules["__main__"]
    # of two threads the second would take what the first has hidden for what the script has
    with _hiding:
        hidden = {name: vars(script)[name] for name in HIDDEN & vars(script).keys()}
        vars(script).update(dict.fromkeys(hidden))
        try:
            yield
        finally:
            vars(script).update(hidden)


def begin_process(shares: list[list[int]], begun: Any, parent: int, scratch: str) -> None:
    """Set up this process as a helper of the process with the id `parent`.
    It uses only its share of the cores, leaves Ctrl-C to its parent, and is killed when its parent
    ends; otherwise it could write into the folders of the next run. shares: the cores of each
    helper; begun: shared counter of the helpers that have begun; scratch: folder of its temporary
    files, which it has no time to remove."""
    with begun.get_lock():
        cores = shares[begun.value]
        begun.value += 1
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if os.getppid() != parent:
        os._exit(1)
    os.sched_setaffinity(0, cores)
    os.environ["HANDBENCH_WORKERS"] = str(len(cores))
    tempfile.tempdir = scratch


_hiding = RLock()
_limiting = RLock()
_limited = 0  # how many are within `one_blas_thread` now
_limit: Any = None  # which the last of them restores
# work within a worker stays there: waiting for the pool's other threads could wait for ever
_inside = local()


_pool = cache(ThreadPoolExecutor)  # kept: starting threads takes longer than imaging a plane's leaf
os.register_at_fork(after_in_child=_pool.cache_clear)  # a child has none of its parent's threads
