"""Kernels are compiled by a process of their own, so that all that image or simulate load the same code."""

import sys
from types import SimpleNamespace

from radar import warmup


def test_kernels_without_a_cache_are_compiled_elsewhere_before_any_runs_here(monkeypatch):
    done = []
    ended = SimpleNamespace(returncode=0)
    monkeypatch.setattr(warmup.subprocess, "run", lambda command, **_: done.append(command) or ended)
    monkeypatch.setattr(warmup, "_run_every_kernel", lambda: done.append("here"))
    monkeypatch.setattr(warmup, "_cached", lambda: False)
    warmup.compile_kernels()
    assert done == [[sys.executable, "-m", "radar.warmup"], "here"]
    monkeypatch.setattr(warmup, "_cached", lambda: True)
    warmup.compile_kernels()
    assert done[2:] == ["here"]
    warmup.compile_kernels(load=False)
    assert done[3:] == []


def test_kernels_that_ran_are_cached_for_this_processor_alone(monkeypatch):
    warmup.compile_kernels()
    assert warmup._cached()
    monkeypatch.setattr(type(warmup.gather.targetctx.codegen()), "magic_tuple", lambda self: ("another processor",))
    assert not warmup._cached()


def test_nothing_is_compiled_where_nothing_shall_be(monkeypatch):
    monkeypatch.setattr(warmup.config, "DISABLE_JIT", True)
    monkeypatch.setattr(warmup, "gather", None)
    assert warmup._cached()
