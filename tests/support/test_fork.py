"""A forked child, as data loaders make, has none of its parent's threads."""

import multiprocessing
import time

import pytest

from handbench.support.parallel import for_each


def _squares(pipe):
    found = []
    for_each(lambda i: found.append(i * i), range(8))
    pipe.send(sorted(found))


@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_forked_child_has_threads_of_its_own(monkeypatch):
    monkeypatch.setenv("HANDBENCH_WORKERS", "2")
    for_each(lambda _: time.sleep(0.05), range(8))  # so that both threads are there, and wait
    time.sleep(0.05)
    here, there = multiprocessing.Pipe()
    child = multiprocessing.get_context("fork").Process(target=_squares, args=(there,))
    child.start()
    answered = here.poll(60)
    if not answered:
        child.kill()
    child.join()
    assert answered
    assert here.recv() == [i * i for i in range(8)]
