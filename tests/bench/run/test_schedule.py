"""Runs that outgrow one process: the same jobs in place and on a Dask cluster, failures and lost
workers included."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import CancelledError, Executor
from contextlib import nullcontext
from pathlib import Path

import pytest

from handbench.bench.benchmarks.benchmark_file import load_benchmark
from handbench.bench.run import executors
from handbench.bench.run.executors import HASH, DaskExecutor, LocalExecutor, elsewhere
from handbench.bench.run.runner import run
from handbench.support.errors import HandbenchError
from handbench.support.store import Stage, cached
from tests.bench.run.faults import figures
from tests.bench.run.jobs_of_tests import deadly, performed, stage_of

STAGES = 6  # of the small benchmark


def finished(work: Path) -> int:
    return len(list(work.glob("[!.]*-*")))


def _fails_or_ends(root: Path, job: Stage) -> str:
    if job.capture == "bug":
        raise ZeroDivisionError("a bug")
    if job.capture == "bad":
        raise HandbenchError("mend me")
    return job.capture


@pytest.mark.slow
def test_a_cluster_that_loses_a_worker_gives_the_serial_table(small_bench, small_result, tmp_path):
    distributed = pytest.importorskip("distributed")
    import dask

    (bench, base), cluster = load_benchmark(str(small_bench)), tmp_path / "cluster"
    killed_at = list[int]()

    def kill_in_the_middle(process: int) -> None:
        while finished(cluster / "work") < 2:
            time.sleep(0.005)
        os.kill(process, signal.SIGKILL)
        killed_at.append(finished(cluster / "work"))

    two = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": ":0"}
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 3}),
        distributed.LocalCluster(**two) as workers,
    ):
        killed = workers.workers[0].pid
        threading.Thread(target=kill_in_the_middle, args=[killed], daemon=True).start()
        address = workers.scheduler_address
        result = run(bench, base, cluster, scheduler=address)
        assert run(bench, base, cluster, scheduler=address).tasks.cached.all()
        assert 2 <= killed_at[0] < STAGES and workers.workers[0].pid != killed
    assert figures(cluster) == figures(small_result)
    for path in small_result.glob("*/*.npz"):
        assert path.read_bytes() == (cluster / path.relative_to(small_result)).read_bytes()
    assert len(result.tasks) == STAGES and result.about.failures == ()


@pytest.fixture(params=["in place", "cluster"])
def executor(request, tmp_path) -> Iterator[Executor]:
    if request.param == "in place":
        yield LocalExecutor()
        return
    distributed = pytest.importorskip("distributed", reason="dask.distributed is not installed")
    # Threads of this process: what is tested is the client's side.
    with distributed.Client(
        processes=False, n_workers=1, threads_per_worker=2, dashboard_address=":0"
    ) as client:
        yield DaskExecutor(client)


def test_a_worker_with_other_code_or_without_the_folder_refuses(tmp_path):
    known = stage_of("simulate", "a")
    with pytest.raises(HandbenchError, match="that all workers share"):
        elsewhere({}, cached, tmp_path / "elsewhere", known)
    object.__setattr__(known, "code", "0" * 64)
    with pytest.raises(HandbenchError, match="than the client"):
        elsewhere({}, cached, tmp_path, known)


def test_every_job_comes_back_once_with_its_number_and_a_bug_with_its_exception(
    executor, tmp_path, monkeypatch
):
    monkeypatch.setattr(executors, "IN_FLIGHT", 5)
    names = ["bad" if k % 5 == 2 else f"c{k}" for k in range(20)]
    ended = performed(executor, _fails_or_ends, tmp_path, [stage_of(HASH, name) for name in names])
    found = [done.key if done.failure is None else done.failure.message for done in ended]
    assert found == [name.replace("bad", "mend me") for name in names]
    assert performed(executor, _fails_or_ends, tmp_path, []) == []
    stages = [stage_of(HASH, name) for name in ("a", "bug", "b")]
    with pytest.raises(ZeroDivisionError, match="a bug"):
        performed(executor, _fails_or_ends, tmp_path, stages)


def test_the_job_that_kills_its_workers_fails_alone(tmp_path):
    """(Dask blames what a worker merely had waiting too; with this saturation nothing waits
    there.)"""
    distributed = pytest.importorskip("distributed")
    import dask

    names, scheduler = ["a", "b", "deadly", "c", "d"], "distributed.scheduler."
    limits = {f"{scheduler}allowed-failures": 0, f"{scheduler}worker-saturation": 1.0}
    one = {"n_workers": 1, "threads_per_worker": 1, "dashboard_address": ":0"}
    with (
        dask.config.set(limits),
        distributed.LocalCluster(**one) as cluster,
        distributed.Client(cluster, set_as_default=False) as client,
    ):
        stages = [stage_of(HASH, name) for name in names]
        ended = performed(DaskExecutor(client), deadly, tmp_path, stages)
    assert [done.key for done in ended] == [name if name != "deadly" else "" for name in names]
    assert (
        ended[2].failure.message
        == "1 workers ended while computing it; give the workers more memory"
    )


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nonsense://x", "without the extra"])
def test_no_scheduler_is_one_line(monkeypatch, address):
    monkeypatch.setattr(executors, "CONNECT_S", 0.5)
    pytest.importorskip("distributed")
    words = "no Dask scheduler answers"
    if " " in address:
        monkeypatch.setitem(sys.modules, "distributed", None)
        words = r"handbench\[cluster\]"
    with pytest.raises(HandbenchError, match=words), executors.executor(address):
        pass


@pytest.mark.parametrize(
    ("error", "expected", "words"),
    [
        (CancelledError(), HandbenchError, "--scheduler: the connection to the scheduler is lost"),
        (OSError("closed"), HandbenchError, "which resumes the run"),
        (FileNotFoundError(2, "No such file", "a"), FileNotFoundError, "No such file"),
    ],
)
def test_a_scheduler_that_is_lost_is_one_line_and_a_file_s_error_stays(
    monkeypatch, error, expected, words
):
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr(distributed, "Client", lambda *_, **__: nullcontext())
    with pytest.raises(expected, match=words), executors.executor("tcp://127.0.0.1:1"):
        raise error
