"""The memory of a run's own process: what has ended leaves little, however many stages and captures there are.

Counted are live objects and the allocations of numpy and Python, which are the same on every machine.
"""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from weakref import ref

import numpy as np
import pytest

from handbench.bench.evaluation.floor import RESAMPLES, floor_interval
from handbench.bench.evaluation.statistics.intervals import median_interval, precision_interval
from handbench.bench.results.tables import TASKS, frame
from handbench.bench.run import executors
from handbench.bench.run.benchmark_file import load_benchmark
from handbench.bench.run.runner import Run
from handbench.bench.run.tasks import HASH, Done
from handbench.support.store import Stage, Stamp
from tests.bench.evaluation.test_floor import level

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
    """One draw for each resample and capture would be 8 bytes × RESAMPLES; a fifth leaves room for small things."""
    of(1)()  # what is imported and kept at first
    assert peak_bytes(of(MANY)) - peak_bytes(of(FEW)) < 8 / 5 * RESAMPLES * (MANY - FEW)


class Stamping:
    """An executor whose stages end in reverse, each with a stamp. most: of the stamps that were alive at once."""

    def __init__(self) -> None:
        self.stamps: list[ref[Stamp]] = []
        self.most = 0

    def run(self, root: Path, jobs: Sequence[Stage]) -> Iterator[tuple[int, Done]]:
        for number in reversed(range(len(jobs))):
            yield number, self.ended(number)
            self.most = max(self.most, sum(stamp() is not None for stamp in self.stamps))

    def ended(self, number: int) -> Done:
        stamp = Stamp(float(number), 0.0, 0.0, {"host": f"host{number % 2}", "of": number})
        self.stamps.append(ref(stamp))
        return Done(stamp)


def test_a_run_keeps_no_stamp_of_a_stage_that_has_ended(tmp_path):
    """But its line, in the order of the list, and of each machine what its first stage of the list tells."""
    bench, base = load_benchmark("hands")
    run = Run(bench, base, tmp_path, Stamping())
    assert len(run.perform([Stage(HASH, f"c{k}") for k in range(JOBS)])) == JOBS
    assert run.executor.most <= 2  # the one at hand and the one before it
    assert frame(TASKS, run.tasks).seconds.tolist() == list(range(JOBS))
    assert list(run.machines.items()) == [(f"host{k}", {"host": f"host{k}", "of": k}) for k in range(2)]


def _ends(root: Path, job: Stage) -> Done:
    return Done(key=job.capture)


def test_a_cluster_keeps_no_future_of_a_stage_that_has_ended(tmp_path, monkeypatch):
    """Those that the scheduler knows of, and at most as many that are just being handed on."""
    distributed = pytest.importorskip("distributed", reason="dask.distributed is not installed")
    monkeypatch.setattr(executors, "IN_FLIGHT", 6)
    monkeypatch.setattr(executors, "BATCH", 2)
    monkeypatch.setattr(executors, "LARGEST_GROUP", 1)
    jobs = [Stage(HASH, f"c{k}") for k in range(JOBS)]
    with distributed.Client(processes=False, n_workers=1, threads_per_worker=2, dashboard_address=":0") as client:
        known = [len(client.futures) for _ in executors.Cluster(client, _ends).run(tmp_path, jobs)]
    assert len(known) == JOBS and max(known) <= 2 * executors.IN_FLIGHT
