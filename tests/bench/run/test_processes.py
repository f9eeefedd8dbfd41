"""Stages beside each other: every job comes back, times are taken alone, results are those of one process."""

import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import closing
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import psutil
import pytest

from handbench.bench.run import executors, processes
from handbench.bench.run.benchmark_file import load_benchmark
from handbench.bench.run.processes import Processes
from handbench.bench.run.runner import run
from handbench.bench.run.tasks import Done
from handbench.support.parallel import workers
from handbench.support.store import Stage

SPAN_S = 0.2


def _spans(root: Path, job: Stage) -> Done:
    """Writes when it began and ended, and in which process with how many threads."""
    if job.capture == "bug":
        raise ZeroDivisionError("a bug")
    if job.capture == "deadly":
        os.kill(os.getpid(), signal.SIGKILL)
    began_s = time.monotonic()
    time.sleep(SPAN_S)
    (root / job.label).write_text(f"{began_s} {time.monotonic()} {os.getpid()} {workers()}")
    return Done(key=job.capture)


@pytest.fixture
def beside(monkeypatch: pytest.MonkeyPatch) -> Iterator[Processes]:
    monkeypatch.setattr(processes, "room", lambda *_: 2)
    found = Processes(_spans)
    yield found
    found.close()


def test_stages_run_beside_each_other_and_imaging_alone(beside, tmp_path):
    cores = os.sched_getaffinity(0)
    jobs = [Stage("reconstruct", "a", "m"), *(Stage("mesh", name) for name in "abcd"), Stage("reconstruct", "b", "m")]
    ended = dict(beside.run(tmp_path, jobs))
    assert [ended[k].key for k in range(6)] == [job.capture for job in jobs]
    spans = {job.label: [float(word) for word in (tmp_path / job.label).read_text().split()] for job in jobs}
    assert len({spans[f"mesh-{name}"][2] for name in "abcd"}) == min(len(cores), 2), "a process for each core"
    assert all(spans[f"mesh-{name}"][3] == max(workers() // 2, 1) for name in "abcd"), "each with half the cores"
    imaged = [spans[f"reconstruct-{name}-m"] for name in "ab"]
    assert all(pid == os.getpid() and threads == workers() for _, _, pid, threads in imaged)
    for began_s, ended_s, *_ in imaged:
        others = [span for span in spans.values() if span[0] != began_s]
        assert all(other[1] <= began_s or other[0] >= ended_s for other in others), "nothing else runs then"
    assert os.sched_getaffinity(0) == cores, "this process keeps its cores"


def test_a_bug_keeps_its_exception_and_where_it_was(beside, tmp_path):
    with pytest.raises(ZeroDivisionError, match="a bug") as caught:
        list(beside.run(tmp_path, [Stage("mesh", "a"), Stage("mesh", "bug"), Stage("mesh", "b")]))
    assert "in _spans" in caught.value.__notes__[0]


class _LockedError(Exception):
    """One that holds what does not go from one process into another."""

    def __init__(self, what: str, lock: Any) -> None:
        super().__init__(what)
        self.lock = lock


def _stuck(root: Path, job: Stage) -> Done:
    if job.capture == "bug":
        raise _LockedError("held", threading.Lock())
    return Done(key=job.capture)


def test_a_bug_that_cannot_be_sent_is_told_all_the_same(monkeypatch, tmp_path):
    monkeypatch.setattr(processes, "room", lambda *_: 2)
    with closing(Processes(_stuck)) as found, pytest.raises(RuntimeError, match="_LockedError: held"):
        list(found.run(tmp_path, [Stage("mesh", "a"), Stage("mesh", "bug")]))


def _slow(root: Path, job: Stage) -> Done:
    (root / job.label).write_text(str(os.getpid()))
    time.sleep(1000)
    return Done(key=job.capture)


def _slowly(root: Path) -> None:
    processes.room = lambda *_: 2
    list(Processes(_slow).run(root, [Stage("mesh", "a"), Stage("mesh", "b")]))


def _lives(pid: int) -> bool:
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


@pytest.mark.parametrize("sign", [signal.SIGKILL, signal.SIGTERM])
def test_no_process_outlives_a_killed_run(tmp_path, sign):
    """The next run's folders would be filled by what the last one left."""
    parent = get_context("spawn").Process(target=_slowly, args=(tmp_path,))
    parent.start()
    guard_s, pids = time.monotonic() + 600, list[int]()
    while len(pids) < min(len(os.sched_getaffinity(0)), 2):  # a process for each core
        assert time.monotonic() < guard_s
        pids = [int(text) for file in tmp_path.iterdir() if (text := file.read_text())]
        time.sleep(0.05)
    os.kill(parent.pid, sign)
    parent.join()
    while any(map(_lives, pids)):
        assert time.monotonic() < guard_s
        time.sleep(0.05)


def test_a_stage_that_ends_its_process_fails_alone(beside, tmp_path):
    names = ["a", "deadly", "b", "deadly", "c", "d"]
    ended = dict(beside.run(tmp_path, [Stage("mesh", name) for name in names]))
    assert [ended[k].key for k in (0, 2, 4, 5)] == ["a", "b", "c", "d"]
    assert all("its process was ended" in ended[k].failure for k in (1, 3))


def test_no_room_for_two_means_this_process(tmp_path, monkeypatch):
    monkeypatch.setattr(processes, "room", lambda *_: 1)
    found = Processes(_spans)
    list(found.run(tmp_path, [Stage("mesh", "a"), Stage("mesh", "b")]))
    assert not found.pipes and (tmp_path / "mesh-b").read_text().split()[2] == str(os.getpid())


def test_results_are_those_of_one_process(small_bench, tmp_path, monkeypatch):
    """The reference is the same code in one process."""
    scene = small_bench.parent / "ball.toml"
    (small_bench.parent / "other.toml").write_text(
        scene.read_text().replace('"ball"', '"other"').replace("0.30", "0.29")
    )
    second = '[[capture]]\nscene = "other.toml"\n[[method]]'
    one_method = small_bench.read_text().rpartition("[[method]]")[0]
    small_bench.write_text(one_method.replace("[[method]]", second))
    bench, base = load_benchmark(str(small_bench))
    monkeypatch.setattr(processes, "room", lambda *_: 2)
    made = {}
    for name, worth_s in {"here": 1e9, "beside": 0.0}.items():
        monkeypatch.setattr(executors, "WORTH_S", worth_s)
        made[name] = run(bench, base, tmp_path / name)
    here, beside = made["here"], made["beside"]
    untimed = here.table.metric != "seconds"
    assert here.table[untimed].equals(beside.table[untimed]) and not beside.about.failures
    assert beside.tasks.gemm_gflops.nunique() == 1, "measured once, before anything runs beside it"
