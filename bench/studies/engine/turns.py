"""Fair timing of several computations.

Each computation has its own process, so that preparation and memory of the others do not count.
Repeats take turns, so that a machine that becomes slower does so for all of them.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from handbench.bench.studies.study import Record
from handbench.radar.warmup import compile_kernels
from handbench.support.progress import say

Work = Callable[[], Any]


@dataclass(frozen=True)
class EngineCase:
    """A computation to time.

    method: its name in tables. work: function without arguments that does it. keep: extracts from
    the result, untimed, what is to be returned. fraction: share of the whole task that `work` does;
    the time is extrapolated to the whole. fixed: function that does only the part that is needed
    for any share. repeats: number of timings after the first call (0: the first call counts).
    calls: number of calls in each timing, of which the mean counts.
    """

    method: str
    work: Work
    keep: Callable[[Any], Any] | None = None
    fraction: float = 1.0
    fixed: Work | None = None
    repeats: int = 5
    calls: int = 1


class Timing(NamedTuple):
    """Timing of one or more calls.

    seconds: mean of the calls. peak_mb: by how much the calls raised the peak of the process's
    resident memory, MB (None: unknown). kept: what was extracted from the result.
    """

    seconds: float
    peak_mb: float | None
    kept: Any


@dataclass(frozen=True)
class Measured:
    """Timings of one computation, in seconds: of its first call, of the part that does not depend
    on the share computed (0 if there is none), and of the later calls."""

    case: EngineCase
    first: Timing
    fixed_s: float
    repeats_s: list[float] = field(default_factory=list)

    @property
    def seconds(self) -> float:
        """Median time in seconds, extrapolated to the whole task."""
        return self._whole(np.median)

    @property
    def plan_s(self) -> float:
        """Time of preparation (the plan, computed once per geometry) in seconds: how much longer
        the first call took than the median of the later ones."""
        later_s = float(np.median(self.repeats_s or [self.first.seconds]))
        return max(self.first.seconds - later_s, 0.0)

    def _whole(self, of: Callable[[Sequence[float]], float]) -> float:
        part_s = float(of(self.repeats_s or [self.first.seconds]))
        return self.fixed_s + max(part_s - self.fixed_s, 0.0) / self.case.fraction

    def record(self, section: str, exact: Measured | None = None, **known: Any) -> Record:
        """Return the row of this computation for a table: its times and memory, and further
        columns.

        section: of the table. exact: timings of the exact computation, from which the ratio is
        computed. known: further columns by name; values of None are left out.
        """
        found = {
            "section": section,
            "method": self.case.method,
            "seconds": self.seconds,
            "seconds_low": self._whole(min),
            "seconds_high": self._whole(max),
            "extrapolated": self.case.fraction < 1,
            "ratio_to_exact": exact.seconds / self.seconds if exact else None,
            **dict.fromkeys(("relative_error", "depth_deviation_mm", "gflops")),
            "peak_memory_mb": self.first.peak_mb,
        }
        known |= {"fraction": self.case.fraction} if self.case.fraction < 1 else {}
        return found | {key: value for key, value in known.items() if value is not None}


def room() -> ProcessPoolExecutor:
    """Start a process in which the compiled functions are loaded. Functions submitted to it must be
    picklable."""
    return ProcessPoolExecutor(1, get_context("spawn"), initializer=compile_kernels)


def interleaved(title: str, cases: Sequence[EngineCase], apart: bool = True) -> dict[str, Measured]:
    """Time several computations in turns, and return the timings by the computation's name.

    title: printed with the progress. apart: True gives each computation its own process; otherwise
    they share one, and peaks of memory mean nothing.
    """
    found: dict[str, Measured] = {}
    with contextlib.ExitStack() as stack:
        rooms = [stack.enter_context(room()) for _ in (cases if apart else cases[:1])]
        places = list(zip(rooms if apart else rooms * len(cases), cases, strict=True))
        for place, case in places:
            say(f"{title}: {case.method}")
            first = place.submit(timed, case.work, case.keep).result()
            fixed_s = place.submit(timed, case.fixed).result().seconds if case.fixed else 0.0
            found[case.method] = Measured(case, first, fixed_s)
        for i in range(max(case.repeats for case in cases)):
            say(f"{title}: repeat {i + 1}")
            for place, case in places:
                if i < case.repeats:
                    again = place.submit(timed, case.work, calls=case.calls).result()
                    found[case.method].repeats_s.append(again.seconds)
    return found


def everything(result: Any) -> Any:
    """Return a result unchanged, for computations whose whole result is kept."""
    return result


def named(what: str, tolerance: float | None) -> str:
    """Return the name of a method with its tolerance, such as "fast volume, 1e-3"; "exact" without
    a tolerance."""
    return "exact" if tolerance is None else f"{what}, {tolerance:.0e}".replace("e-0", "e-")


def timed(work: Work, keep: Callable[[Any], Any] | None = None, calls: int = 1) -> Timing:
    """Call `work` `calls` times in this process. Returns the mean time, the rise of memory, and
    what `keep` extracts from the last result (None: nothing)."""
    with contextlib.suppress(OSError):  # the peak starts from here, where the kernel allows it
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    before_mb, start = _status_mb("VmRSS"), time.perf_counter()
    for _ in range(calls):
        result = work()
    seconds, peak_mb = (time.perf_counter() - start) / calls, _status_mb("VmHWM")
    raised_mb = None if before_mb is None or peak_mb is None else peak_mb - before_mb
    return Timing(seconds, raised_mb, keep(result) if keep else None)


def _status_mb(name: str) -> float | None:
    """Read the entry `name` of Linux's /proc/self/status, in MB; None on other systems. The peak of
    memory there is exact, while sampling would miss it."""
    with contextlib.suppress(OSError):
        for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines():
            if line.startswith(name):
                return int(line.split()[1]) * 1024 / 1e6
    return None
