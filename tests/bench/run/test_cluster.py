"""Runs on a Dask cluster: lost workers, workers that differ, and schedulers that do not answer."""

from __future__ import annotations

import shutil
import socket
import sys
from concurrent.futures import CancelledError, Future
from unittest.mock import MagicMock

import pytest

from handbench.bench.benchmarks.benchmark_file import load_benchmark
from handbench.bench.run import engine
from handbench.bench.run.engine import DaskExecutor, elsewhere
from handbench.bench.run.runner import run
from tests.bench.run.faults import figures
from tests.bench.run.stages_of_tests import engine_of, stages_of
from tests.refusals import refuse

distributed = pytest.importorskip("distributed")


def test_a_cluster_gives_the_serial_table(small_bench, small_result, tmp_path):
    """Of its last stages. (Its worker is a thread of this process.)"""
    bench, base = load_benchmark(str(small_bench))
    out = shutil.copytree(small_result, tmp_path / "out")
    for stage in ("reconstruct", "repeat", "score"):
        for folder in (out / "work").glob(f"{stage}-*"):
            shutil.rmtree(folder)
    one = {"processes": False, "protocol": "tcp://", "n_workers": 1, "threads_per_worker": 1}
    with distributed.LocalCluster(**one, dashboard_address=":0") as cluster:
        result = run(bench, base, out, scheduler=cluster.scheduler_address)
    assert result.tasks.cached.tolist() == [True, True, False, False, False, False]
    assert figures(out) == figures(small_result)


class Blaming:
    """Stands for a client of one worker, which dies of "deadly" when it has all stages."""

    def __init__(self) -> None:
        self._given: set[str] = set()

    def submit(self, function, root, stage, pure) -> Future:
        future = Future()
        if stage.capture == "deadly" or stage.capture not in self._given:
            self._given.add(stage.capture)
            future.set_exception(distributed.KilledWorker("task", "worker", 0))
        else:
            future.set_result(function(root, stage))
        return future

    def wait_for_workers(self, number, timeout) -> None:
        """There is always one."""


def test_a_stage_that_kills_its_workers_fails_alone(tmp_path):
    """Though Dask blames all that a worker had."""
    engine = engine_of(tmp_path / "work", DaskExecutor(Blaming()))
    made = engine.perform(stages_of("deadly", "a", "b"))
    assert [stage.capture for stage in made] == ["a", "b"]
    assert [failure.capture for failure in engine.failures] == ["deadly"]
    assert engine.progress.done == 3


def test_a_worker_with_other_code_or_without_the_folder_refuses(tmp_path):
    [stage] = stages_of("a")
    refuse(lambda: elsewhere(tmp_path / "elsewhere", stage), f"{tmp_path}/elsewhere")
    object.__setattr__(stage, "code", "0" * 64)
    refuse(lambda: elsewhere(tmp_path, stage), "mesh-a-m0")


@pytest.mark.parametrize(
    "address", ["tcp://127.0.0.1:{}", "tcp://127.0.0.1:1", "tcp://x:99999", "x"]
)
def test_an_address_without_a_scheduler_is_named(monkeypatch, address):
    """Another server, which takes the connection and never answers; no server; no address."""
    monkeypatch.setattr(engine, "CONNECT_S", 0.1)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = address.format(silent.getsockname()[1])
        refuse(engine.executor(1, address).__enter__, "--scheduler", f"'{address}'")


def test_a_scheduler_without_workers_is_named(monkeypatch):
    monkeypatch.setattr(engine, "CONNECT_S", 1.0)
    none = {"processes": False, "protocol": "tcp://", "n_workers": 0, "dashboard_address": ":0"}
    with distributed.LocalCluster(**none) as cluster:
        address = cluster.scheduler_address
        refuse(engine.executor(1, address).__enter__, "--scheduler", "dask worker")


def test_a_cluster_needs_its_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    refuse(engine.executor(1, "tcp://x").__enter__, "--scheduler", "handbench[cluster]")


def test_a_scheduler_that_is_lost_is_named_and_a_file_s_error_stays(monkeypatch):
    monkeypatch.setattr(engine, "_require_scheduler", lambda _: None)
    monkeypatch.setattr(distributed, "Client", lambda *_, **__: MagicMock())

    def lose(error: BaseException) -> None:
        with engine.executor(1, "tcp://127.0.0.1:1"):
            raise error

    for lost in (CancelledError(), OSError("closed")):
        refuse(lambda error=lost: lose(error), "--scheduler")
    with pytest.raises(FileNotFoundError):
        lose(FileNotFoundError(2, "No such file", "a"))
