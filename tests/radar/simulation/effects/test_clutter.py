"""The room: image theory, the target's shadow, and that it stays where it is."""

from dataclasses import replace

import numpy as np
import pytest

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray
from handbench.radar.simulation.effects.surfaces import room_echoes
from handbench.radar.simulation.scene import EchoScene
from handbench.radar.simulation.scene_echoes import bare_echoes
from tests.radar.simulation.effects.plates import sheet, sphere_body
from tests.radar.simulation.effects.small_scenes import bead_scene, simulated

HERE = AntennaArray(np.zeros((1, 3)), np.zeros((1, 3)))


def plate(side_m=0.1, z_m=0.4):
    return replace(sheet(side_m, 5e-3, z_m), reflectivity_db=-10.0)


def room(*bodies, tones_hz=(80e9,), **values):
    return EchoScene(HERE, np.array(tones_hz), np.zeros(len(tones_hz)), room=bodies, **values)


def clutter(scene):
    """The samples [f, t, r] that the effect adds."""
    return room_echoes(bare_echoes(scene), scene.target)


def test_a_wide_plate_mirrors():
    """Image theory: the wave of an antenna at 2D, 2π/(jk)·1/(2D)·e^{−2jkD}; edges echo too, but 94
    mm later, so that they average out over 10 GHz."""
    tones_hz = np.linspace(72e9, 82e9, 101)
    k = 2 * np.pi * tones_hz / SPEED_OF_LIGHT_M_S
    samples = clutter(room(plate(0.4), tones_hz=tones_hz))[:, 0, 0]
    mirrored = np.sqrt(0.1) * np.pi / (1j * k * 0.4) * np.exp(-2j * k * 0.4)
    assert (samples / mirrored).mean() == pytest.approx(1, abs=0.02)


def test_the_target_hides_what_stands_behind_it():
    # 53 mm of shadow there
    scene = room(plate(0.03), target=sphere_body(0.02, (0.0, 0.0, 0.3)))
    alone = clutter(replace(scene, target=None))
    assert not clutter(scene).any() and alone.all()
    empty = simulated(scene, "clutter", empty=True).empty
    np.testing.assert_array_equal(empty.samples[0], alone)


def test_bodies_of_the_room_hide_each_other():
    hidden, screen = plate(0.04), plate(0.1, z_m=0.35)
    np.testing.assert_array_equal(clutter(room(hidden, screen)), clutter(room(screen)))


def test_the_room_stays_when_the_target_moves():
    scene = bead_scene({"motion": {"velocity_m_s": 0.01}}, room=(plate(),))
    with_room, without = (
        simulated(scene, "motion", *more, frames=2).capture.samples for more in (("clutter",), ())
    )
    off = np.abs(with_room - without - clutter(scene))
    assert off.max() < 1e-6 * np.abs(with_room).max()  # float32
