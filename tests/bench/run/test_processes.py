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

from handbench.bench.run.executors import LocalExecutor, ProcessExecutor, executor
from handbench.support.parallel import workers
from tests.bench.run.jobs_of_tests import performed, slow, spans, stage_of, stuck


@pytest.fixture
def beside() -> Iterator[ProcessExecutor]:
    with ProcessExecutor(min(len(os.sched_getaffinity(0)), 2)) as found:
        yield found


def test_stages_run_beside_each_other_and_imaging_alone(beside, tmp_path):
    cores = os.sched_getaffinity(0)
    meshes, images = (
        [stage_of("mesh", n) for n in "abcd"],
        [stage_of("reconstruct", n, "m") for n in "ab"],
    )
    jobs = [images[0], *meshes, images[1]]
    ended = performed(beside, spans, tmp_path, jobs)
    assert [done.key for done in ended] == [job.key for job in jobs]
    took = {
        job.label: [float(word) for word in (tmp_path / job.label).read_text().split()]
        for job in jobs
    }
    of_meshes = [took[job.label] for job in meshes]
    assert len({pid for _, _, pid, _ in of_meshes}) == min(len(cores), 2), "a process for each core"
    assert {threads for *_, threads in of_meshes} == {max(workers() // 2, 1)}, "half the cores each"
    for image in (took[job.label] for job in images):
        began_s, ended_s, pid, threads = image
        assert pid == os.getpid() and threads == workers()
        others = [span for span in took.values() if span is not image]
        assert all(other[1] <= began_s or other[0] >= ended_s for other in others), "alone"
    assert os.sched_getaffinity(0) == cores, "this process keeps its cores"


def test_one_stage_or_too_little_memory_for_two_starts_no_process(beside, tmp_path):
    performed(beside, spans, tmp_path, [job := stage_of("mesh", "a")])
    assert int((tmp_path / job.label).read_text().split()[2]) == os.getpid()
    with executor(core_s=1e9, bytes_=1e18) as found:
        assert isinstance(found, LocalExecutor)


def test_a_bug_keeps_its_exception_and_where_it_was(beside, tmp_path):
    """One that cannot be sent, its words."""
    bug = [stage_of("mesh", name) for name in ("a", "bug", "b")]
    with pytest.raises(ZeroDivisionError, match="a bug") as caught:
        performed(beside, spans, tmp_path, bug)
    assert "in spans" in str(caught.value.__cause__)
    with pytest.raises(RuntimeError, match="LockedError: held"):
        performed(beside, stuck, tmp_path, bug)


def _slowly(root: Path) -> None:
    # ignored where a shell started the tests in background
    signal.signal(signal.SIGINT, signal.default_int_handler)
    with ProcessExecutor(min(len(os.sched_getaffinity(0)), 2)) as beside:
        performed(beside, slow, root, [stage_of("mesh", "a"), stage_of("mesh", "b")])


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
    left = [psutil.Process(pid) for pid in pids]
    os.kill(parent.pid, sign)
    parent.join()
    while any(one.is_running() and one.status() != psutil.STATUS_ZOMBIE for one in left):
        assert time.monotonic() < guard_s
        time.sleep(0.05)


def test_a_stage_that_ends_its_process_fails_alone(beside, tmp_path):
    names = ["a", "deadly", "b", "deadly", "c", "d"]
    ended = performed(beside, spans, tmp_path, [stage_of("mesh", name) for name in names])
    assert [done.failure is None for done in ended] == [name != "deadly" for name in names]
    assert all("the operating system ended its process" in ended[k].failure.message for k in (1, 3))
