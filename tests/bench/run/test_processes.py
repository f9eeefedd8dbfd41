"""Stages beside each other: every job comes back, times are taken alone, results are those of one
process."""

import os
import signal
import time
from collections.abc import Iterator
from multiprocessing import get_context
from pathlib import Path

import psutil
import pytest

from handbench.bench.run import executors
from handbench.bench.run.benchmark_file import load_benchmark
from handbench.bench.run.executors import LocalExecutor, ProcessExecutor
from handbench.bench.run.runner import run
from handbench.support.parallel import workers
from tests.bench.run.jobs_of_tests import performed, slow, spans, stage_of, stuck


@pytest.fixture
def beside() -> Iterator[ProcessExecutor]:
    with ProcessExecutor(min(len(os.sched_getaffinity(0)), 2)) as found:
        yield found


def test_stages_run_beside_each_other_and_imaging_alone(beside, tmp_path):
    cores = os.sched_getaffinity(0)
    jobs = [
        stage_of("reconstruct", "a", "m"),
        *(stage_of("mesh", n) for n in "abcd"),
        stage_of("reconstruct", "b", "m"),
    ]
    ended = performed(beside, spans, tmp_path, jobs)
    assert [done.key for done in ended] == [job.key for job in jobs]
    took = {
        job.label: [float(word) for word in (tmp_path / job.label).read_text().split()]
        for job in jobs
    }
    assert len({took[f"mesh-{name}"][2] for name in "abcd"}) == min(len(cores), 2), (
        "a process for each core"
    )
    assert all(took[f"mesh-{name}"][3] == max(workers() // 2, 1) for name in "abcd"), (
        "each with half the cores"
    )
    imaged = [took[f"reconstruct-{name}-m"] for name in "ab"]
    assert all(pid == os.getpid() and threads == workers() for _, _, pid, threads in imaged)
    for began_s, ended_s, *_ in imaged:
        others = [span for span in took.values() if span[0] != began_s]
        assert all(other[1] <= began_s or other[0] >= ended_s for other in others), (
            "nothing else runs then"
        )
    assert os.sched_getaffinity(0) == cores, "this process keeps its cores"


def test_a_bug_keeps_its_exception_and_where_it_was(beside, tmp_path):
    with pytest.raises(ZeroDivisionError, match="a bug") as caught:
        performed(beside, spans, tmp_path, [stage_of("mesh", name) for name in ("a", "bug", "b")])
    assert "in spans" in str(caught.value.__cause__)


def test_a_bug_that_cannot_be_sent_is_told_all_the_same(beside, tmp_path):
    with pytest.raises(RuntimeError, match="LockedError: held"):
        performed(beside, stuck, tmp_path, [stage_of("mesh", "a"), stage_of("mesh", "bug")])


def _slowly(root: Path) -> None:
    signal.signal(
        signal.SIGINT, signal.default_int_handler
    )  # ignored where a shell started the tests in background
    with ProcessExecutor(min(len(os.sched_getaffinity(0)), 2)) as beside:
        performed(beside, slow, root, [stage_of("mesh", "a"), stage_of("mesh", "b")])


def _lives(pid: int) -> bool:
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


@pytest.mark.parametrize("sign", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
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
    ended = performed(beside, spans, tmp_path, [stage_of("mesh", name) for name in names])
    assert [done.failure is None for done in ended] == [name != "deadly" for name in names]
    assert all("its process was ended" in ended[k].failure.message for k in (1, 3))


@pytest.mark.parametrize(
    ("count", "core_s", "kind"),
    [(1, 1e9, LocalExecutor), (2, 1.0, LocalExecutor), (2, 1e9, ProcessExecutor)],
)
def test_no_room_for_two_or_little_work_means_this_process(monkeypatch, count, core_s, kind):
    monkeypatch.setattr(executors, "room", lambda *_: count)
    with executors.executor(core_s=core_s) as found:
        assert type(found) is kind


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
    monkeypatch.setattr(executors, "room", lambda *_: 2)
    made = {}
    for name, worth_s in {"here": 1e9, "beside": 0.0}.items():
        monkeypatch.setattr(executors, "WORTH_S", worth_s)
        made[name] = run(bench, base, tmp_path / name)
    here, beside = made["here"], made["beside"]
    untimed = here.table.metric != "seconds"
    assert here.table[untimed].equals(beside.table[untimed]) and not beside.about.failures
    assert beside.tasks.gemm_gflops.nunique() == 1, "measured once, before anything runs beside it"
