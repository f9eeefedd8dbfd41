"""Stages wherever they are carried out: each comes back once, times are taken alone, and nothing
outlives a run."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from concurrent.futures import Executor
from multiprocessing import get_context
from pathlib import Path
from tempfile import gettempdir

import psutil
import pytest

from handbench.bench.run import engine
from handbench.bench.run.engine import DaskExecutor, ProcessExecutor
from handbench.support.files import read_json
from handbench.support.parallel import workers
from handbench.support.store import locked
from tests.bench.run.stages_of_tests import SPAN, engine_of, stages_of
from tests.refusals import refuse

COUNT = min(len(os.sched_getaffinity(0)), 2)  # of processes


@pytest.fixture(scope="module")
def beside() -> Iterator[ProcessExecutor]:
    with ProcessExecutor(COUNT, gettempdir()) as processes:
        yield processes


@pytest.fixture(params=["here", "processes", "cluster"])
def executor(request) -> Iterator[Executor | None]:
    if request.param == "here":
        yield None
    elif request.param == "processes":
        yield request.getfixturevalue("beside")
    else:
        distributed = pytest.importorskip("distributed")
        # threads of this process: what is tested is the client's side
        one = {"processes": False, "n_workers": 1, "threads_per_worker": 2}
        with distributed.Client(**one, dashboard_address=":0") as client:
            yield DaskExecutor(client)


def test_every_stage_comes_back_once_in_order_and_a_bug_keeps_its_exception(executor, tmp_path):
    engine, stages = engine_of(tmp_path / "work", executor), stages_of("a", "bad", "b", "bad", "c")
    made = {stages[n]: stages[n].folder(engine.work) for n in (0, 2, 4)}
    assert list(engine.perform(stages).items()) == list(made.items())
    assert [(f.capture, f.stage, f.message) for f in engine.failures] == [
        ("bad", "mesh", "mend me")
    ] * 2
    assert [task["cached"] for task in engine.tasks] == [False] * 3
    assert engine.perform([]) == {}
    assert [*engine.perform(stages_of("a")).values()] == [stages[0].folder(engine.work)]
    assert engine.tasks[-1]["cached"] and engine.progress.done == 6
    bad = iter(stages_of("bad"))
    refuse(lambda: engine.follow([bad], essential=[bad]), "mesh-bad", "mend me")
    with pytest.raises(ZeroDivisionError) as caught:
        engine.perform(stages_of("d", "bug", "e"))
    if isinstance(executor, ProcessExecutor):
        assert "in act" in str(caught.value.__cause__)


def test_stages_run_beside_each_other_and_imaging_here(beside, tmp_path):
    engine = engine_of(tmp_path / "work", beside)
    stages = [*stages_of(*"abcd"), *stages_of("f", shares=False)]
    *meshes, image = [
        read_json(folder / SPAN, "a span") for folder in engine.perform(stages).values()
    ]
    assert len({pid for pid, _ in meshes}) == COUNT  # a process for each core
    assert {threads for _, threads in meshes} == {max(workers() // COUNT, 1)}  # its share
    assert image == [os.getpid(), workers()]  # this process keeps its cores


@pytest.mark.skipif(COUNT < 2, reason="one core has one process")
def test_chains_overlap_and_each_keeps_its_order(beside, tmp_path):
    """The second stage of a short chain begins while the first of another one is at work."""
    engine = engine_of(tmp_path / "work", beside)
    long, short = iter(stages_of("slow", "a")), iter(stages_of("b", "c", "d"))
    ended = [stage.capture for stage in engine.follow([long, short])]
    assert sorted(ended) == ["a", "b", "c", "d", "slow"]
    assert ended.index("c") < ended.index("slow") < ended.index("a")
    assert ended.index("b") < ended.index("c") < ended.index("d")


def test_one_chain_or_too_little_memory_starts_no_process(monkeypatch):
    assert engine.process_count(1) == 0
    monkeypatch.setattr(engine, "STAGE_BYTES", 1e18)
    with engine.executor(engine.process_count(2)) as none:
        assert none is None


def test_a_process_ended_by_the_system_says_how_to_resume(tmp_path):
    def end() -> None:
        with engine.executor(2) as processes:
            engine_of(tmp_path / "work", processes).perform(stages_of("a", "deadly"))

    refuse(end, "HANDBENCH_WORKERS=1")


def _endless(root: Path) -> None:
    # ignored where a shell started the tests in background
    signal.signal(signal.SIGINT, signal.default_int_handler)
    with locked(root) as work, engine.executor(COUNT) as processes:
        engine_of(work, processes).perform(stages_of("endless", "endless"))


@pytest.mark.parametrize("sign", [signal.SIGKILL, signal.SIGINT])
def test_no_process_outlives_a_killed_run(tmp_path, sign):
    """The next run's folders would be filled by what the last one left."""
    parent = get_context("spawn").Process(target=_endless, args=(tmp_path,))
    parent.start()
    guard_s, pids = time.monotonic() + 60, list[int]()
    while len(pids) < COUNT:  # a process for each core
        assert time.monotonic() < guard_s
        pids = [int(file.read_text()) for file in tmp_path.rglob("pid.json")]
        time.sleep(0.05)
    processes = [psutil.Process(pid) for pid in pids]
    os.kill(parent.pid, sign)
    parent.join()
    while any(one.is_running() and one.status() != psutil.STATUS_ZOMBIE for one in processes):
        assert time.monotonic() < guard_s
        time.sleep(0.05)
    assert sign == signal.SIGKILL or not list(tmp_path.glob("work/.*-*")), "half-written"
