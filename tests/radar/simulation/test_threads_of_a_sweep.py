"""A sweep's echoes do not depend on the number of threads, its own or BLAS's."""

from dataclasses import replace

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from handbench.radar.data.arrays import AntennaArray, qar50
from handbench.radar.imaging.plan import fresh_plans
from handbench.radar.simulation.catalogue import EFFECTS
from handbench.radar.simulation.scene import EchoScene, Material
from tests.radar.simulation.effects.plates import dihedral
from tests.radar.simulation.effects.small_scenes import EVERYTHING, causes, simulated

SOME = AntennaArray(qar50().tx_m[::2], qar50().rx_m[::2])
SWEEP_HZ = np.linspace(72e9, 82e9, 128)
CORNER = dihedral(0.02, 0.03, (0.01, 0.005, 0.33))


@pytest.mark.slow
def test_threads_change_no_bit_of_any_effect(monkeypatch):
    """Multipath at 128 tones once differed by 5e-9 where BLAS had two threads."""
    # a converter would round a difference away
    caused = causes(**EVERYTHING | {"converter": {}, "roughness": {"rms_m": 5e-5}})
    skin = replace(CORNER, material=Material(kind="skin"))
    time_s, found = 1e-3 * np.arange(128), []
    for threads in (1, 2, 3):
        scene = EchoScene(SOME, SWEEP_HZ, time_s, skin, seed=3, **caused)
        there = [effect.id for effect in EFFECTS if effect.cause(scene)]
        assert {"multipath", "skin", "roughness", "noise"} <= set(there)
        monkeypatch.setenv("HANDBENCH_WORKERS", str(threads))
        with fresh_plans(), threadpool_limits(threads, user_api="blas"):
            found.append(simulated(scene, *there).capture.samples)
    np.testing.assert_array_equal(found[0], found[1])
    np.testing.assert_array_equal(found[0], found[2])
