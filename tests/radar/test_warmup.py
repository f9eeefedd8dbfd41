"""Kernels are compiled by a process of their own, so that all that image or simulate load the same
code."""

import sys
import time
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import pytest

from handbench.groundtruth.dense import kernels
from handbench.radar import warmup
from handbench.support import compiled

BOTH = [
    (warmup.compile_kernels, "handbench.radar.warmup"),
    (kernels.compile_kernels, "handbench.groundtruth.dense.kernels"),
]


@pytest.mark.parametrize(("compile_kernels", "module"), BOTH)
def test_kernels_without_a_cache_are_compiled_elsewhere_before_any_runs_here(
    compile_kernels, module, monkeypatch
):
    done = []
    ended = SimpleNamespace(returncode=0)
    monkeypatch.setattr(
        compiled.subprocess, "run", lambda command, **_: done.append(command) or ended
    )
    monkeypatch.setattr(warmup, "_run_every_kernel", lambda: done.append("here"))
    monkeypatch.setattr(compiled, "_cached", lambda _: False)
    compile_kernels()
    here = ["here"] * (module == "handbench.radar.warmup")
    assert done == [[sys.executable, "-m", module], *here]
    monkeypatch.setattr(compiled, "_cached", lambda _: True)
    compile_kernels()
    assert done[1 + len(here) :] == here


def test_kernels_are_compiled_without_being_loaded(monkeypatch):
    monkeypatch.setattr(compiled, "_cached", lambda _: True)
    monkeypatch.setattr(warmup, "_run_every_kernel", lambda: pytest.fail("they were loaded"))
    warmup.compile_kernels(load=False)


def test_of_two_that_ask_at_once_one_compiles(monkeypatch):
    compiled_by, asked = [], []

    def cached(_):
        asked.append(1)
        while len(asked) < 2:  # both have found nothing before either compiles
            pass
        return bool(compiled_by)

    def child(command, **_):
        time.sleep(0.2)  # the other would find nothing, and compile, if it did not wait
        compiled_by.append(command)
        return SimpleNamespace(returncode=0)

    monkeypatch.setattr(compiled, "_cached", cached)
    monkeypatch.setattr(compiled.subprocess, "run", child)
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(lambda _: kernels.compile_kernels(), range(2)))
    assert len(compiled_by) == 1


def test_kernels_that_ran_are_cached_for_this_processor_alone(monkeypatch):
    warmup.compile_kernels()
    assert compiled._cached([warmup.gather])
    monkeypatch.setattr(
        type(warmup.gather.targetctx.codegen()), "magic_tuple", lambda self: ("another processor",)
    )
    assert not compiled._cached([warmup.gather])


def test_nothing_is_compiled_where_nothing_shall_be(monkeypatch):
    monkeypatch.setattr(compiled.config, "DISABLE_JIT", True)
    assert compiled._cached([None])
