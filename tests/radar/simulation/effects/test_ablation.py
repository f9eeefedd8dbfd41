"""What leaving an effect out changes in a coarse simulation against two whole simulations, and the
causes of effects."""

from dataclasses import replace

import numpy as np
import pytest

from handbench.radar.methods.fsk import Fsk, fsk
from handbench.radar.simulation.catalogue import EFFECTS
from handbench.radar.simulation.scene import Ball, Material
from tests.radar.simulation.effects.plates import sheet
from tests.radar.simulation.effects.small_scenes import bead_scene, explained, simulated

FOAM_BALL = Ball(np.array([0.01, -0.02, 0.3]), 5e-3, 0.025, 1.03)


def wall(level_db):
    return bead_scene(room=(replace(sheet(0.1, 5e-3, 0.4), reflectivity_db=level_db),))


@pytest.mark.parametrize(
    ("scene", "without", "rel"),
    [
        (bead_scene(), "obliquity", 0.2),
        (bead_scene({"noise": {"phase_noise_rad": 0.02}}), "noise", 0.4),
        (bead_scene({"oscillator": {"level_dbc_hz": -70.0}}), "oscillator", 0.4),
        (bead_scene({"roughness": {"rms_m": 3e-5}}), "roughness", 0.5),
    ],
)
def test_a_change_is_that_of_whole_simulations(scene, without, rel):
    """With the very numbers of the simulation's first frame, and 3-FSK as users run it."""
    names = dict.fromkeys(("obliquity", without))
    row = explained(scene, *names)[without]
    rest = [name for name in names if name != without]
    captures = [simulated(scene, *effects).capture for effects in (names, rest)]
    config = Fsk(first_depth_m=0.3)
    maps_m = [fsk(capture, config)[0].z_m for capture in captures]
    samples = [capture.samples for capture in captures]
    level = np.linalg.norm(samples[1] - samples[0]) / np.linalg.norm(samples[0])
    assert row.level_db == pytest.approx(20 * np.log10(level), abs=0.5)
    moved_mm = 1e3 * np.nanmean(np.abs(maps_m[1] - maps_m[0]))
    assert row.depth_mm == pytest.approx(moved_mm, rel=rel)
    assert row.seconds >= 0


BEAD = bead_scene().target


@pytest.mark.parametrize(
    ("name", "scene", "there"),
    [
        ("skin", bead_scene(), False),
        ("skin", bead_scene(target=replace(BEAD, material=Material(kind="skin"))), True),
        ("dielectric", bead_scene(target=None, balls=(FOAM_BALL,)), True),
        (
            "dielectric",
            bead_scene(target=None, balls=(replace(FOAM_BALL, foam_permittivity=1.0),)),
            False,
        ),
        ("clutter", bead_scene(), False),
        ("clutter", wall(-30.0), True),
    ],
)
def test_an_effect_has_a_cause(name, scene, there):
    [effect] = [effect for effect in EFFECTS if effect.id == name]
    assert bool(effect.cause(scene)) == there
