"""Dielectrics: the foam's delay, a slab's closed form, the echo of the balls' foam."""

from dataclasses import replace

import numpy as np
import pytest

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray
from handbench.radar.simulation.effects.dielectric import dielectric
from handbench.radar.simulation.effects.target_surface import obliquity
from handbench.radar.simulation.physics.reflection import fresnel
from handbench.radar.simulation.physics.spheres import foam_delays_m, foam_echoes
from handbench.radar.simulation.scene import Ball, EchoScene, Material
from handbench.radar.simulation.scene_echoes import bare_echoes
from tests.radar.simulation.effects.small_scenes import TONES_HZ, bead_scene, estimated, simulated


def foam_ball(**changes):
    return Ball(
        **{
            "centre_m": np.array([0.01, -0.02, 0.3]),
            "radius_m": 5e-3,
            "foam_radius_m": 0.025,
            "foam_permittivity": 1.03,
            **changes,
        }
    )


def dielectric_samples(scene):
    """The scene's samples [f, t, r] with the effect."""
    return dielectric(obliquity(bare_echoes(scene, tolerance=None))).samples[0]


@pytest.mark.parametrize(
    ("permittivity", "reflected_db", "delay_mm"), [(1.03, -42.6, 0.74), (1.05, -38.3, 1.23)]
)
def test_foam_as_published(permittivity, reflected_db, delay_mm):
    assert 20 * np.log10(abs(fresnel(np.array(permittivity)))) == pytest.approx(
        reflected_db, abs=0.05
    )
    balls = (
        foam_ball(foam_radius_m=0.055, foam_permittivity=permittivity),
        foam_ball(foam_radius_m=0),
    )
    delays_m = foam_delays_m(balls)
    assert 1e3 * delays_m == pytest.approx([delay_mm, 0], abs=0.01)  # of 50 mm; and of none


def test_plastic_reflects_by_fresnel_alone():
    plastic = Material(kind="plastic", loss_tangent=0.015)
    scene = bead_scene(target=replace(bead_scene().target, material=plastic))
    metal, samples = (
        simulated(scene, "obliquity", *more).capture.samples[0] for more in ((), ("dielectric",))
    )
    n = np.sqrt(2.7 * (1 - 0.015j))
    assert np.allclose(
        samples, metal * ((n - 1) / (n + 1)), rtol=1e-5, atol=1e-6 * np.abs(metal).max()
    )
    changes, _ = estimated(scene, "obliquity", "dielectric", without="dielectric")
    assert changes["3fsk"].depth_mm < 1e-3  # the same phase at all tones


def test_the_ball_is_delayed_and_hides_the_back():
    ball, array = (
        foam_ball(),
        AntennaArray([[0.01, -0.02, 0]], [[0.012, -0.02, 0], [0.01, 0.14, 0]]),
    )
    scene = EchoScene(array, TONES_HZ, np.zeros(3), balls=(ball,))
    bare, foamed = bare_echoes(scene).samples[0], dielectric_samples(scene)
    shell = foam_echoes((ball,), TONES_HZ, array)
    delay_m = (np.sqrt(1.03) - 1) * 0.02
    delayed = bare * np.exp(-4j * np.pi * TONES_HZ * delay_m / SPEED_OF_LIGHT_M_S)[:, None, None]
    assert np.allclose(foamed - shell, delayed, rtol=1e-5)
    front = np.abs(
        foam_echoes((replace(ball, radius_m=0.0249),), TONES_HZ, array)
    )  # so large a ball hides any back
    along, aslant = np.abs(np.abs(shell) / front - 1).max(axis=0)[0]
    assert along < 1e-5
    assert aslant > 0.1  # rays under 15° pass the ball at 25 sin 15° = 6.4 mm
