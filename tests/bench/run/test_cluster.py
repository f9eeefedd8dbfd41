"""Runs on a Dask cluster: lost workers, workers that differ, and schedulers that do not answer."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from concurrent.futures import CancelledError
from contextlib import nullcontext
from pathlib import Path

import pytest

from handbench.bench.benchmarks.benchmark_file import load_benchmark
from handbench.bench.run import executors
from handbench.bench.run.executors import DaskExecutor, elsewhere
from handbench.bench.run.runner import run
from handbench.support.errors import HandbenchError
from tests.bench.run.faults import figures
from tests.bench.run.stages_of_tests import engine_of, stages_of

STAGES = 6  # of the small benchmark


def finished(work: Path) -> int:
    return len(list(work.glob("[!.]*-*")))


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


def test_a_stage_that_kills_its_workers_fails_alone(tmp_path):
    """(Dask blames what a worker merely had waiting too; with this saturation nothing waits
    there.)"""
    distributed = pytest.importorskip("distributed")
    import dask

    names, scheduler = ["a", "deadly", "b"], "distributed.scheduler."
    limits = {f"{scheduler}allowed-failures": 0, f"{scheduler}worker-saturation": 1.0}
    one = {"n_workers": 1, "threads_per_worker": 1, "dashboard_address": ":0"}
    with (
        dask.config.set(limits),
        distributed.LocalCluster(**one) as cluster,
        distributed.Client(cluster, set_as_default=False) as client,
    ):
        engine = engine_of(tmp_path / "work", DaskExecutor(client))
        made = engine.perform(stages_of(*names))
    assert [stage.capture for stage in made] == ["a", "b"]
    assert "its workers ended" in engine.failures[0].message


def test_a_worker_with_other_code_or_without_the_folder_refuses(tmp_path):
    [stage] = stages_of("a")
    with pytest.raises(HandbenchError, match="that all workers share"):
        elsewhere(tmp_path / "elsewhere", stage)
    object.__setattr__(stage, "code", "0" * 64)
    with pytest.raises(HandbenchError, match="than the client"):
        elsewhere(tmp_path, stage)


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
