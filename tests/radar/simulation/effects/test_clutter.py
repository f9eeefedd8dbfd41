"""The room: image theory, the target's shadow, and that it stays where it is."""

from dataclasses import replace

import numpy as np
import pytest

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray
from handbench.radar.simulation.effects.clutter import room_echoes
from handbench.radar.simulation.scene import EchoScene
from handbench.radar.simulation.scene_echoes import bare_echoes
from tests.radar.simulation.effects.plates import sheet, sphere_body
from tests.radar.simulation.effects.small_scenes import bead_scene, simulated


def plate(side_m=0.1, z_m=0.4, reflectivity_db=-10.0):
    return replace(sheet(side_m, 5e-3, z_m), reflectivity_db=reflectivity_db)


HERE = AntennaArray(np.zeros((1, 3)), np.zeros((1, 3)))


def clutter(scene):
    """The samples [f, t, r] that the effect adds."""
    return room_echoes(bare_echoes(scene), scene.target)


def test_a_wide_plate_mirrors():
    # Image theory: the wave of an antenna at 2D, 2π/(jk)·1/(2D)·e^{−2jkD}; edges echo too, but 94
    # mm later, so that they average out over 10 GHz.
    tones_hz = np.linspace(72e9, 82e9, 101)
    wavenumber = 2 * np.pi * tones_hz / SPEED_OF_LIGHT_M_S
    samples = clutter(EchoScene(HERE, tones_hz, np.zeros(101), room=(plate(0.4, 0.4),)))[:, 0, 0]
    mirrored = np.sqrt(0.1) * np.pi / (1j * wavenumber * 0.4) * np.exp(-2j * wavenumber * 0.4)
    assert (samples / mirrored).mean() == pytest.approx(1, abs=0.02)


def test_the_target_hides_what_stands_behind_it():
    ball = sphere_body(0.02, (0.0, 0.0, 0.3))
    scene = EchoScene(
        HERE, np.array([80e9]), np.zeros(1), target=ball, room=(plate(0.03),)
    )  # 53 mm of shadow there
    assert not clutter(scene).any()
    assert np.abs(clutter(replace(scene, target=None))).item() > 0
    empty = simulated(scene, "clutter", empty=True).empty
    assert np.array_equal(empty.samples[0], clutter(replace(scene, target=None)))


def test_bodies_of_the_room_hide_each_other():
    hidden, screen = plate(0.04), plate(0.1, z_m=0.35)
    scene = EchoScene(HERE, np.array([80e9]), np.zeros(1), room=(hidden, screen))
    assert np.array_equal(clutter(scene), clutter(replace(scene, room=(screen,))))


def test_the_room_stays_when_the_target_moves():
    scene = bead_scene({"motion": {"velocity_m_s": 0.01}}, room=(plate(),))
    with_room, without = (
        simulated(scene, "motion", *more, frames=2).capture.samples for more in (("clutter",), ())
    )
    still = clutter(scene)
    for frame in with_room - without:
        assert np.abs(frame - still).max() < 1e-6 * np.abs(with_room).max()  # float32
