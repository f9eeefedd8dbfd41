"""Selection of effects: "auto" is what the scene has a cause for, a list is a list, and what a
scene lacks is reported."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from handbench.bench.scenes.stand import cuboid
from handbench.radar.simulation.catalogue import choose
from handbench.radar.simulation.meshes import convex_block
from handbench.radar.simulation.scene import Body, Material
from handbench.radar.simulation.simulate import simulate_scene
from tests.radar.samples import relative_error
from tests.radar.simulation.effects.plates import dihedral, joined, plate, sheet
from tests.radar.simulation.effects.small_scenes import EVERYTHING, FOAM_BALL, bead_scene
from tests.refusals import refuse

FLAT = plate((-0.01, -0.01, 0.3), (0, 0.02, 0), (0.02, 0, 0), 8)
BOX = Body(*cuboid(np.array([[-0.01, -0.01, 0.3], [0.01, 0.01, 0.302]]), 1e-3))
CORNER = dihedral(0.02, 0.02, (0, 0, 0.3), 8)
BEAD = bead_scene().target
ROOM = (replace(sheet(0.1, 5e-3, 0.4), reflectivity_db=-80.0),)
BARE_BALL = replace(FOAM_BALL, foam_permittivity=1.0)
PARTS = {"obliquity", "shadow", "multipath"}


@pytest.mark.parametrize(
    ("scene", "expected"),
    [
        (bead_scene(target=FLAT), {"obliquity"}),
        (bead_scene(target=BOX), {"obliquity"}),
        (bead_scene(target=FLAT, room=ROOM), PARTS | {"clutter"}),
        (bead_scene(), PARTS),
        (bead_scene(target=CORNER), PARTS),
        (bead_scene({"motion": {"amplitude_m": 1e-9}}, target=FLAT), {"obliquity", "motion"}),
        (bead_scene({"roughness": {"rms_m": 1e-6}}, target=FLAT), {"obliquity", "roughness"}),
        (bead_scene(EVERYTHING), PARTS | EVERYTHING.keys()),
        (bead_scene(target=replace(BEAD, material=Material(kind="skin"))), PARTS | {"skin"}),
        (bead_scene(target=None, balls=(FOAM_BALL,)), {"dielectric"}),
        (bead_scene(target=None, balls=(BARE_BALL,)), set()),
    ],
)
def test_auto_is_everything_that_the_scene_has_a_cause_for(scene, expected):
    assert {row.effect for row in choose(scene, "auto") if row.on} == expected


@pytest.mark.parametrize("body", [FLAT, BOX])
def test_what_auto_leaves_out_of_a_body_with_flat_sides_changes_little(body):
    scene = bead_scene(target=body)
    rows = choose(scene, "auto")
    every = (row.model_copy(update={"on": row.on or "lone plate" in row.why}) for row in rows)
    some, all_ = (simulate_scene(scene, on).capture.samples for on in (rows, tuple(every)))
    assert relative_error(some, all_) < 2e-3


@pytest.mark.parametrize(
    ("body", "flat"),
    [
        (FLAT, True),
        (BOX, True),
        (CORNER, False),
        (joined(FLAT, replace(FLAT, vertices_m=FLAT.vertices_m + [0, 0, 0.01])), False),
        (BEAD, False),
    ],
)
def test_blocks(body, flat):
    turn = Rotation.from_rotvec([0.3, 0.5, 0.2]).as_matrix()
    for vertices_m in (body.vertices_m, body.vertices_m @ turn.T):
        assert convex_block(Body(vertices_m, body.faces)) == flat


@pytest.mark.parametrize(
    ("names", "places"),
    [
        (("nois",), ("'nois'", "'noise'")),
        (("noise", "noise"), ("'noise'",)),
        (("clutter",), ("'clutter'", "[stand]", "reflectivity_db")),
    ],
)
def test_names_are_checked(names, places):
    scene = bead_scene({"noise": {"phase_noise_rad": 0.1}})
    refuse(lambda: choose(scene, names), "effects: ", *places)
