"""Sizes of effects by coarse simulations against two whole simulations, imaged as users do; and the
causes of effects."""

from dataclasses import replace

import numpy as np
import pytest

from handbench.radar.simulation.scene import Ball, Material
from tests.radar.simulation.effects.plates import sheet
from tests.radar.simulation.effects.small_scenes import (
    bead_scene,
    effect,
    estimated,
    simulated_change,
)

FOAM_BALL = Ball(np.array([0.01, -0.02, 0.3]), 5e-3, 0.025, 1.03)
CENTRE = ("shadow_centre",)


def wall(level_db):
    return bead_scene(room=(replace(sheet(0.1, 5e-3, 0.4), reflectivity_db=level_db),))


@pytest.mark.parametrize(
    ("scene", "without", "others", "rel", "within_db"),
    [
        (bead_scene(), "obliquity", CENTRE, 0.2, np.inf),
        (wall(-30.0), "clutter", (), 0.2, 1),
        # 0.0074 · 25 mm / 5 mm and as much from behind
        (bead_scene(target=None, balls=(FOAM_BALL,)), "dielectric", None, 0.2, 0.5),
        # with the very numbers of the simulation's first frame: a closed form knows their spread
        (bead_scene({"noise": {"phase_noise_rad": 0.02}}), "noise", CENTRE, 0.4, 0.5),
        (bead_scene({"oscillator": {"level_dbc_hz": -70.0}}), "oscillator", CENTRE, 0.4, 0.5),
        (bead_scene({"roughness": {"rms_m": 3e-5}}), "roughness", (), 0.5, 1),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_size_is_what_leaving_the_effect_out_changes(scene, without, others, rel, within_db):
    names = [without] if others is None else {"obliquity": 0, **dict.fromkeys(others), without: 0}
    changes, level_db = estimated(scene, *names, without=without)
    change, expected_db = simulated_change(scene, *names, without=without)
    assert changes["3fsk"].depth_mm == pytest.approx(change.depth_mm, rel=rel)
    assert level_db == pytest.approx(expected_db, abs=within_db)


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
def test_an_effect_is_missing_where_the_scene_has_no_cause_of_it(name, scene, there):
    assert bool(effect(name).missing(scene)) != there
