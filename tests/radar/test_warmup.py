"""A kernel computes the same bits in the process that compiles it as in those that load it."""

import subprocess
import sys

import pytest

from handbench.radar import warmup
from handbench.support import compiled

SIMULATE = """
import hashlib
from handbench.bench.scenes.build import load_scene
from handbench.bench.scenes.echoes import echoes
print(hashlib.sha256(echoes(load_scene("scene.toml")).capture.samples.tobytes()).hexdigest())
"""
SCENE = """
version = 1
name = "two"
[target]
kind = "dihedral"
side_m = 0.03
edge_m = 3e-3
[sensor]
tones_hz = [82e9, 79.5e9]
sweep = []
"""


@pytest.mark.slow
def test_echoes_are_the_same_bits_with_and_without_kernels_in_the_cache(tmp_path, monkeypatch):
    (tmp_path / "scene.toml").write_text(SCENE)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))

    def simulate():
        call = [sys.executable, "-c", SIMULATE]
        return subprocess.run(call, cwd=tmp_path, stdout=-1, check=True).stdout

    first, cached = simulate(), [*(tmp_path / "cache").rglob("*.nbi")]
    assert simulate() == first
    for file in cached[::2]:  # others compile anew, beside kernels that are loaded
        file.unlink()
    assert len(cached) > 10
    assert simulate() == first


def test_kernels_that_ran_are_cached_for_this_processor_alone(monkeypatch):
    warmup.compile_kernels()
    assert compiled._cached([warmup.gather])
    monkeypatch.setattr(
        type(warmup.gather.targetctx.codegen()), "magic_tuple", lambda self: ("another processor",)
    )
    assert not compiled._cached([warmup.gather])


def test_a_compilation_is_announced_once_where_there_is_one(monkeypatch, capsys):
    compiled._announce.cache_clear()
    monkeypatch.setattr(compiled.config, "DISABLE_JIT", True)
    assert compiled._cached([None])
    compiled.announce_compilation(None)
    assert not capsys.readouterr().err
    monkeypatch.setattr(compiled, "_cached", lambda _: False)
    compiled.announce_compilation(None)
    compiled.announce_compilation(None)
    assert capsys.readouterr().err.count("compiling") == 1
