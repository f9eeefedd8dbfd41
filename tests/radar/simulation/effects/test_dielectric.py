"""Dielectrics: the foam's delay, and Fresnel's reflection."""

from dataclasses import replace

import numpy as np
import pytest

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray
from handbench.radar.simulation.effects.surfaces import dielectric
from handbench.radar.simulation.reflection import interface
from handbench.radar.simulation.scene import EchoScene, Material
from handbench.radar.simulation.scene_echoes import bare_echoes
from tests.radar.simulation.effects.small_scenes import (
    FOAM_BALL,
    TONES_HZ,
    bead_scene,
    explained,
    shaped,
    simulated,
)


@pytest.mark.parametrize(
    ("permittivity", "reflected_db", "delay_mm"), [(1.03, -42.6, 0.74), (1.05, -38.3, 1.23)]
)
def test_foam_as_published(permittivity, reflected_db, delay_mm):
    reflected = 20 * np.log10(abs(interface(1.0, permittivity)[0]))
    assert reflected == pytest.approx(reflected_db, abs=0.05)
    # 50 mm of foam
    ball = replace(FOAM_BALL, foam_radius_m=0.055, foam_permittivity=permittivity)
    assert 1e3 * ball.foam_delay_m == pytest.approx(delay_mm, abs=0.01)
    assert replace(FOAM_BALL, foam_radius_m=0).foam_delay_m == 0


def test_plastic_reflects_by_fresnel_alone():
    plastic = Material(kind="plastic", loss_tangent=0.015)
    scene = bead_scene(target=replace(bead_scene().target, material=plastic))
    metal, samples = (
        simulated(scene, "obliquity", *more).capture.samples for more in ((), ("dielectric",))
    )
    n = np.sqrt(2.7 * (1 - 0.015j))
    expected = metal * ((n - 1) / (n + 1))
    np.testing.assert_allclose(samples, expected, rtol=1e-5, atol=1e-6 * np.abs(metal).max())
    row = explained(scene, "obliquity", "dielectric")["dielectric"]
    assert row.depth_mm < 1e-3  # the same phase at all tones


def test_the_ball_is_delayed():
    array = AntennaArray([[0.01, -0.02, 0]], [[0.012, -0.02, 0], [0.01, 0.14, 0]])
    scene = EchoScene(array, TONES_HZ, np.zeros(3), balls=(FOAM_BALL,))
    bare, foamed = bare_echoes(scene).samples(), shaped(scene, dielectric).samples()
    path_m = 2 * (np.sqrt(1.03) - 1) * 0.02
    delayed = bare * np.exp(-2j * np.pi * TONES_HZ * path_m / SPEED_OF_LIGHT_M_S)[:, None, None]
    np.testing.assert_allclose(foamed, delayed, rtol=1e-5)
