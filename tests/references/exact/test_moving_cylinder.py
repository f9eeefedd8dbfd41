"""A moving metal finger against the exact series of a cylinder at each tone's place."""

from dataclasses import replace

import numpy as np
import pytest

from handbench.radar.data.arrays import AntennaArray, qar50
from handbench.radar.simulation.catalogue import choose
from handbench.radar.simulation.scene import EchoScene, Motion
from handbench.radar.simulation.simulate import simulate_scene
from tests.references.exact.cases import body
from tests.references.exact.cylinders import Cylinder, cylinder_echoes

FEW = AntennaArray(qar50().tx_m[::16], qar50().rx_m[::16])
TONES_HZ = np.array([82e9, 81.8e9, 79.5e9, 82e9])
TIMES_S = 1e-3 * np.arange(4)


@pytest.mark.slow
@pytest.mark.parametrize("direction", [(0.0, 0.0, 1.0), (0.8, 0.0, -0.6)])
def test_a_moving_finger_echoes_as_the_exact_series_says(direction):
    """Physical optics' error (a few percent) is the same at all places, and nearly so at all tones:
    of the phases from tone to tone, of which motion makes 1.7 rad, it leaves 0.02, and between the
    two times of one tone 1e-3."""
    finger, velocity_m_s = Cylinder(0.0, 0.29, 8e-3), 0.5
    motion = Motion(velocity_m_s=velocity_m_s, direction=direction)
    scene = EchoScene(FEW, TONES_HZ, TIMES_S, body((finger,), "metal"), motion=motion)
    chosen = choose(scene, ("obliquity", "shadow", "motion"))
    samples = simulate_scene(scene, chosen).capture.samples[0]
    ratios = []
    for tone, time_s in enumerate(TIMES_S):
        x_m, _, z_m = velocity_m_s * time_s * np.array(direction)
        there = replace(finger, x_m=finger.x_m + x_m, z_m=finger.z_m + z_m)
        [exact] = cylinder_echoes([there], TONES_HZ[[tone]], FEW)
        assert np.linalg.norm(samples[tone] - exact) < 0.07 * np.linalg.norm(exact)
        ratios.append(np.vdot(exact, samples[tone]) / np.vdot(exact, exact))
    assert np.abs(np.diff(np.angle(ratios))).max() < 0.02
    assert ratios[3] == pytest.approx(ratios[0], abs=3e-3)
