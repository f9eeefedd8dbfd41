"""Stages beside each other: every job comes back, times are taken alone, results are those of one process."""

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from bench.run import executors, processes
from bench.run.benchmark_file import load_benchmark
from bench.run.processes import Processes
from bench.run.runner import run
from bench.run.tasks import Done
from radar.support.parallel import workers
from radar.support.store import Stage

SPAN_S = 0.2


def _spans(root: Path, job: Stage) -> Done:
    """Writes when it began and ended, and in which process with how many threads."""
    if job.capture == "bug":
        raise ZeroDivisionError("a bug")
    if job.capture == "deadly":
        os.kill(os.getpid(), signal.SIGKILL)
    began_s = time.time()
    time.sleep(SPAN_S)
    (root / job.label).write_text(f"{began_s} {time.time()} {os.getpid()} {workers()}")
    return Done(key=job.capture)


@pytest.fixture
def beside(monkeypatch: pytest.MonkeyPatch) -> Iterator[Processes]:
    monkeypatch.setattr(processes, "room", lambda: 2)
    found = Processes(_spans)
    yield found
    found.close()


def test_stages_run_beside_each_other_and_imaging_alone(beside, tmp_path):
    jobs = [Stage("reconstruct", "a", "m"), *(Stage("mesh", name) for name in "abcd"), Stage("reconstruct", "b", "m")]
    ended = dict(beside.run(tmp_path, jobs))
    assert [ended[k].key for k in range(6)] == [job.capture for job in jobs]
    spans = {job.label: [float(word) for word in (tmp_path / job.label).read_text().split()] for job in jobs}
    assert len({spans[f"mesh-{name}"][2] for name in "abcd"}) == 2, "two processes"
    assert all(spans[f"mesh-{name}"][3] == max(workers() // 2, 1) for name in "abcd"), "each with half the cores"
    imaged = [spans[f"reconstruct-{name}-m"] for name in "ab"]
    assert all(pid == os.getpid() and threads == workers() for _, _, pid, threads in imaged)
    for began_s, ended_s, *_ in imaged:
        others = [span for span in spans.values() if span[0] != began_s]
        assert all(other[1] <= began_s or other[0] >= ended_s for other in others), "nothing else runs then"
    assert len(os.sched_getaffinity(0)) >= workers(), "this process keeps its cores"


def test_a_bug_keeps_its_exception_and_where_it_was(beside, tmp_path):
    with pytest.raises(ZeroDivisionError, match="a bug") as caught:
        list(beside.run(tmp_path, [Stage("mesh", "a"), Stage("mesh", "bug"), Stage("mesh", "b")]))
    assert "in _spans" in caught.value.__notes__[0]


def test_a_stage_that_ends_its_process_fails_alone(beside, tmp_path):
    names = ["a", "deadly", "b", "deadly", "c", "d"]
    ended = dict(beside.run(tmp_path, [Stage("mesh", name) for name in names]))
    assert [ended[k].key for k in (0, 2, 4, 5)] == ["a", "b", "c", "d"]
    assert all("its process was ended" in ended[k].failure for k in (1, 3))


def test_no_room_for_two_means_this_process(tmp_path, monkeypatch):
    monkeypatch.setattr(processes, "room", lambda: 1)
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
    small_bench.write_text(small_bench.read_text().replace("[[method]]", second, 1))
    bench, base = load_benchmark(str(small_bench))
    monkeypatch.setattr(processes, "room", lambda: 2)
    made = {}
    for name, worth_s in {"here": 1e9, "beside": 0.0}.items():
        monkeypatch.setattr(executors, "WORTH_S", worth_s)
        made[name] = run(bench, base, tmp_path / name)
    here, beside = made["here"], made["beside"]
    untimed = here.table.metric != "seconds"
    assert here.table[untimed].equals(beside.table[untimed]) and not beside.about.failures
    assert beside.tasks.gemm_gflops.nunique() == 1, "measured once, before anything runs beside it"
