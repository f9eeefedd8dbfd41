"""A kernel computes the same bits in the process that compiles it as in those that load it."""

import subprocess
import sys

import pytest

from handbench.radar import warmup
from handbench.support import compiled

SIMULATE = """
import hashlib
from tests.radar.simulation.effects.small_scenes import EVERYTHING, bead_scene, simulated
made = simulated(bead_scene(EVERYTHING), "obliquity", "shadow", "multipath", "noise")
print(hashlib.sha256(made.capture.samples.tobytes()).hexdigest())
"""


@pytest.mark.slow
def test_echoes_are_the_same_bits_with_and_without_kernels_in_the_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))

    def simulate():
        return subprocess.run([sys.executable, "-c", SIMULATE], stdout=-1, check=True).stdout

    first, cached = simulate(), [*tmp_path.rglob("*.nbi")]
    assert simulate() == first
    for file in cached[::2]:  # others compile anew, beside kernels that are loaded
        file.unlink()
    assert len(cached) > 5
    assert simulate() == first


def test_a_compilation_for_this_processor_is_announced_once(monkeypatch, capsys):
    warmup.compile_kernels()
    compiled._announce.cache_clear()
    capsys.readouterr()
    warmup.announce()
    assert not capsys.readouterr().err
    code = type(warmup.gather.targetctx.codegen())
    monkeypatch.setattr(code, "magic_tuple", lambda _: ("another processor",))
    warmup.announce()
    warmup.announce()
    assert capsys.readouterr().err.count("\n") == 1
