"""What a simulation depends on: its seed and its frames, and no number of threads."""

from dataclasses import replace

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from handbench.radar.data.arrays import AntennaArray, qar50
from handbench.radar.imaging.plan import fresh_plans
from handbench.radar.simulation.catalogue import choose
from handbench.radar.simulation.scene import EchoScene, Material
from handbench.radar.simulation.simulate import simulate_scene
from tests.radar.simulation.effects.plates import dihedral
from tests.radar.simulation.effects.small_scenes import EVERYTHING, bead_scene, causes, simulated

RANDOM = ("positions", "motion", "channels", "oscillator", "noise")


@pytest.mark.parametrize("other", ["positions", "motion", "channels", "oscillator"])
def test_no_effect_changes_the_noise(other):
    """But for its size, which is relative to the strongest pixel."""
    scene = bead_scene(EVERYTHING)
    quiet, noisy, disturbed, both = (
        simulated(scene, *names).capture.samples.ravel()
        for names in ((), ("noise",), (other,), (other, "noise"))
    )
    alone, beside = noisy - quiet, both - disturbed
    size = np.linalg.norm(alone) * np.linalg.norm(beside)
    assert np.vdot(alone, beside).real == pytest.approx(size, rel=1e-3)


def swept(tones: int) -> EchoScene:
    """A corner of skin before a part of the array, with a cause of every effect but the converter,
    which would round a difference away."""
    few = AntennaArray(qar50().tx_m[::6], qar50().rx_m[::6])
    corner = dihedral(0.02, 0.03, (0.01, 0.005, 0.33))
    caused = causes(**EVERYTHING | {"converter": {}, "roughness": {"rms_m": 5e-5}})
    skin, time_s = replace(corner, material=Material(kind="skin")), 1e-3 * np.arange(tones)
    return EchoScene(few, np.linspace(72e9, 82e9, tones), time_s, skin, seed=3, **caused)


@pytest.mark.parametrize("tones", [4, pytest.param(128, marks=pytest.mark.slow)])
def test_threads_change_no_bit_of_any_effect(tones, monkeypatch):
    """Multipath at 128 tones once differed by 5e-9 where BLAS had two threads."""
    scene, results = swept(tones), []
    for threads in (1, 2, 3):
        monkeypatch.setenv("HANDBENCH_WORKERS", str(threads))
        with fresh_plans(), threadpool_limits(threads, user_api="blas"):
            made = simulate_scene(scene, choose(scene, "auto"), frames=2)
        results.append(made.capture.samples)
    np.testing.assert_equal(results[1], results[0])
    np.testing.assert_equal(results[2], results[0])


def test_a_seed_repeats_a_capture():
    once, again, other = (
        simulated(bead_scene(EVERYTHING, seed=seed), *RANDOM).capture.samples for seed in (3, 3, 4)
    )
    np.testing.assert_array_equal(again, once)
    assert not np.array_equal(other, once)
