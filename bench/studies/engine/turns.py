"""Timing in turns: every case in a process of its own, so that its plan is built there and its
memory is nobody else's; in turns, so that a machine that gets slower does so for all of them.
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
    """Something to time.
    work: called without arguments. keep: takes from its result, untimed, what is to be returned.
    fraction: the part of the whole task that `work` does; the time of the whole is extrapolated.
    fixed: does what is needed even for none of it. repeats: timings after the first call (0: the
    first one counts), each the mean of `calls` calls in sequence."""

    method: str
    work: Work
    keep: Callable[[Any], Any] | None = None
    fraction: float = 1.0
    fixed: Work | None = None
    repeats: int = 5
    calls: int = 1


class Timing(NamedTuple):
    """The timing of some calls: seconds of one; peak_mb: by how much they raised the process's
    resident memory at most (None: unknown); kept: what was kept of the result."""

    seconds: float
    peak_mb: float | None
    kept: Any


@dataclass(frozen=True)
class Measured:
    """A case's timings: of its first call, of its fixed part (0 if it has none), and of the later
    calls, seconds."""

    case: EngineCase
    first: Timing
    fixed_s: float
    repeats_s: list[float] = field(default_factory=list)

    @property
    def seconds(self) -> float:
        """Median time of the whole."""
        return self._whole(np.median)

    @property
    def plan_s(self) -> float:
        """The extra time of the first call over the later ones, s: that of preparing (planning)."""
        later_s = float(np.median(self.repeats_s or [self.first.seconds]))
        return max(self.first.seconds - later_s, 0.0)

    def _whole(self, of: Callable[[Sequence[float]], float]) -> float:
        part_s = float(of(self.repeats_s or [self.first.seconds]))
        return self.fixed_s + max(part_s - self.fixed_s, 0.0) / self.case.fraction

    def record(self, section: str, exact: Measured | None = None, **known: Any) -> Record:
        """Return the case's record: its times, memory, and what else is known of it.
        exact: timings of the exact computation, for the ratio. known: further columns; those that
        are None are left out."""
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
    """Start a process in which the compiled functions are ready; what is submitted to it must be
    picklable."""
    return ProcessPoolExecutor(1, get_context("spawn"), initializer=compile_kernels)


def interleaved(title: str, cases: Sequence[EngineCase], apart: bool = True) -> dict[str, Measured]:
    """Time all cases in turns: name of the case → its timings.
    apart: each case has a process of its own; else they share one, and peaks of memory mean
    nothing."""
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
    """Keep a result as it is."""
    return result


def named(what: str, tolerance: float | None) -> str:
    """A method's name with its tolerance, as fast volume, 1e-3."""
    return "exact" if tolerance is None else f"{what}, {tolerance:.0e}".replace("e-0", "e-")


def timed(work: Work, keep: Callable[[Any], Any] | None = None, calls: int = 1) -> Timing:
    """Call `work` so many times in this process; return the mean time and the rise of memory. keep:
    takes from the last result what is to be returned."""
    with contextlib.suppress(OSError):  # the peak starts from here, where the kernel allows it
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    before_mb, start = _status_mb("VmRSS"), time.perf_counter()
    for _ in range(calls):
        result = work()
    seconds, peak_mb = (time.perf_counter() - start) / calls, _status_mb("VmHWM")
    raised_mb = None if before_mb is None or peak_mb is None else peak_mb - before_mb
    return Timing(seconds, raised_mb, keep(result) if keep else None)


def _status_mb(name: str) -> float | None:
    """Read a figure of /proc/self/status, in MB; None where there is none. Linux keeps the exact
    peak of memory there, which sampling would miss."""
    with contextlib.suppress(OSError):
        for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines():
            if line.startswith(name):
                return int(line.split()[1]) * 1024 / 1e6
    return None
