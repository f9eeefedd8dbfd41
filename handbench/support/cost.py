"""Measure what work costs (wall-clock time, processor time, peak memory) and the machine's speed,
and refuse work that would take too much memory before it begins."""

import os
import platform
import re
import threading
import time
import timeit
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from handbench.support.errors import HandbenchError
from handbench.support.parallel import setting

SAMPLE_S = 0.05
GEMM_SIZE = 1024  # large enough for the full rate, too small to show in a stage's peak memory
PRODUCTS = 6  # of which the first makes threads and buffers


@dataclass
class Cost:
    """The cost of some work, measured for the entire process: wall-clock seconds; seconds of
    processor time, with that of the programs that it ran; peak memory, MB; the mean number of cores
    that other work on the machine took meanwhile; and facts of the machine that did it."""

    seconds: float = 0.0
    cpu_seconds: float = 0.0
    peak_memory_mb: float = 0.0
    others_cores: float = 0.0
    machine: dict[str, Any] = field(default_factory=dict)


@contextmanager
def measured() -> Iterator[Cost]:
    """Context manager that measures the work in its block. It yields a Cost, which has its values
    when the block ends."""
    cost, done, process = Cost(), threading.Event(), psutil.Process()

    def watch() -> None:
        while True:
            cost.peak_memory_mb = max(cost.peak_memory_mb, process.memory_info().rss / 1e6)
            if done.wait(SAMPLE_S):
                return

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    before = _times_s()
    try:
        yield cost
    finally:
        cost.seconds, cost.cpu_seconds, busy_s = (_times_s() - before).tolist()
        cost.others_cores = max(busy_s - cost.cpu_seconds, 0.0) / max(cost.seconds, 1e-9)
        done.set()
        watcher.join()


def _times_s() -> np.ndarray:
    """Return three clocks, s: the time; the processor time of this process and of the programs that
    it ran; and that of the whole machine, including time withheld by the host of a virtual
    machine."""
    programs, all_ = os.times(), psutil.cpu_times()
    own_s = time.process_time() + programs.children_user + programs.children_system
    busy_s = all_.user + all_.nice + all_.system + all_.irq + all_.softirq + all_.steal
    return np.array([time.perf_counter(), own_s, busy_s])


@cache
def machine() -> dict[str, Any]:
    """Return facts of this machine that affect computing times, measured once per process: its name
    ("host"), processor, number of cores, memory_gb, operating system, version of Python, and its
    rate of matrix products ("gemm_gflops"), by which times of different machines can be
    compared."""
    named = re.search(r"model name\s*:\s*(.*)", Path("/proc/cpuinfo").read_text("utf-8", "replace"))
    return {
        "host": platform.node(),
        "processor": named[1] if named else platform.machine(),
        "cores": len(os.sched_getaffinity(0)),
        "memory_gb": round(psutil.virtual_memory().total / 1e9, 1),
        "system": platform.platform(),
        "python": platform.python_version(),
        "gemm_gflops": round(gemm_gflops(), 1),
    }


def gemm_gflops() -> float:
    """Measure the rate of float32 matrix products on all cores, GFLOP/s: the best of several,
    because other work on the machine can only lower it."""
    generator = np.random.default_rng(0)
    a, b = (generator.standard_normal((GEMM_SIZE, GEMM_SIZE), dtype=np.float32) for _ in range(2))
    best_s = min(timeit.repeat(lambda: np.matmul(a, b), repeat=PRODUCTS, number=1))
    return 2e-9 * GEMM_SIZE**3 / best_s


def require_memory(needed_bytes: float, what: str, advice: str) -> None:
    """Raise a HandbenchError for work that needs more memory than HANDBENCH_MEMORY_GB, or, if that
    is not set, than is free now.
    The message begins with `what`, the work, and ends with `advice`."""
    free_gb = psutil.virtual_memory().available / 1e9
    most_gb = setting("HANDBENCH_MEMORY_GB", free_gb, "number of gigabytes")
    if needed_bytes > 1e9 * most_gb:
        raise HandbenchError(
            f"{what}: needs {needed_bytes / 1e9:.3g} GB of memory, more than the {most_gb:.3g} GB "
            f"that it may take; {advice}, or set HANDBENCH_MEMORY_GB"
        )
