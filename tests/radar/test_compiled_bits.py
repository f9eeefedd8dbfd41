"""A kernel computes the same bits in the process that compiles it as in those that load it."""

import subprocess
import sys

import pytest

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
    assert len(cached) > 1
    assert simulate() == first
