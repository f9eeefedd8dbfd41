"""The memory of a run's own process: what has ended leaves little, however many stages and captures
there are.

Counted are live objects and the allocations of numpy and Python, which are the same on every
machine.
"""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch
from weakref import ref

import numpy as np
import pytest

from handbench.bench.evaluation.floor import RESAMPLES, floor_interval
from handbench.bench.evaluation.intervals import median_interval, precision_interval
from handbench.bench.evaluation.tables import TASKS, frame
from handbench.bench.run import executors, runner
from handbench.bench.run.executors import LocalExecutor
from handbench.support.store import Stage, Stamp
from tests.bench.evaluation.test_floor import level
from tests.bench.run.jobs_of_tests import performed, run_of, stage_of, stamped

FEW, MANY, JOBS = 4, 16, 60
LEVEL = level(1e-4, (0, 0, 1e-4, 3e-3, 2e-3, 0))


def medians(captures: int) -> Callable[[], object]:
    values = np.arange(100.0 * captures)
    return lambda: median_interval(values)


def precisions(captures: int) -> Callable[[], object]:
    rng = np.random.default_rng(0)
    hands = [rng.normal(0.3, 1e-4, 4) for _ in range(captures)]
    return lambda: precision_interval(hands)


def floors(captures: int) -> Callable[[], object]:
    """Each capture has a registration of its own."""
    m, r = LEVEL
    moved = [replace(r.registration, matrix=np.eye(4) + k) for k in range(captures)]
    return lambda: floor_interval([m] * captures, [r._replace(registration=each) for each in moved])


def peak_bytes(interval: Callable[[], object]) -> int:
    tracemalloc.start()
    try:
        assert interval() is not None
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("of", [medians, precisions, floors])
def test_an_interval_keeps_no_draws_of_a_capture(of):
    """One draw for each resample and capture would be 8 bytes × RESAMPLES; a fifth leaves room for
    small things."""
    of(1)()  # what is imported and kept at first
    assert peak_bytes(of(MANY)) - peak_bytes(of(FEW)) < 8 / 5 * RESAMPLES * (MANY - FEW)


class Stamping:
    """A job whose stages have a stamp each. most: of the stamps that were alive at once."""

    def __init__(self) -> None:
        self.stamps: list[ref[Stamp]] = []
        self.most = 0

    def __call__(self, root: Path, job: Stage) -> tuple[Stamp, bool]:
        number = len(self.stamps)
        stamp = Stamp(float(number), 0.0, 0.0, {"host": f"host{number % 2}", "of": number})
        self.most = max(self.most, sum(known() is not None for known in self.stamps))
        self.stamps.append(ref(stamp))
        return stamp, False


def test_a_run_keeps_no_stamp_of_a_stage_that_has_ended(tmp_path):
    """But its line, in the order of the list, and of each machine what its first stage of the list
    tells."""
    run, job = run_of(LocalExecutor(), tmp_path), Stamping()
    with patch.object(runner, "cached", job):
        assert len(run.perform([stage_of("mesh", f"c{k}") for k in range(JOBS)])) == JOBS
    assert job.most <= 2  # the one at hand and the one before it
    assert frame(TASKS, run.found.tasks).seconds.tolist() == list(range(JOBS))
    assert list(run.found.machines.items()) == [
        (f"host{k}", {"host": f"host{k}", "of": k}) for k in range(2)
    ]


def test_a_cluster_keeps_no_future_of_a_stage_that_has_ended(tmp_path, monkeypatch):
    """Those that the scheduler knows of, and at most as many that are just being handed on."""
    distributed = pytest.importorskip("distributed", reason="dask.distributed is not installed")
    monkeypatch.setattr(executors, "IN_FLIGHT", 6)
    known: list[int] = []
    with distributed.Client(
        processes=False, n_workers=1, threads_per_worker=2, dashboard_address=":0"
    ) as client:
        monkeypatch.setattr(runner, "say", lambda line: known.append(len(client.futures)))
        ended = performed(
            executors.DaskExecutor(client),
            stamped,
            tmp_path,
            [stage_of("mesh", f"c{k}") for k in range(JOBS)],
        )
    assert len(known) == len(ended) == JOBS and max(known) <= 2 * executors.IN_FLIGHT
