"""Selection of effects: "auto" is what the scene has a cause for, a list is a list, and what a
scene lacks is reported."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from handbench.bench.scenes.stand import cuboid
from handbench.radar.simulation.physics.meshes import convex_block
from handbench.radar.simulation.scene import Body
from handbench.radar.simulation.selection import choose
from handbench.radar.simulation.simulate import simulate_scene
from handbench.support.errors import HandbenchError
from tests.radar.simulation.effects.plates import dihedral, joined, plate, sheet, sphere_body
from tests.radar.simulation.effects.small_scenes import EVERYTHING, bead_scene

FLAT = plate((-0.01, -0.01, 0.3), (0, 0.02, 0), (0.02, 0, 0), 8)
BOX = Body(*cuboid(np.array([[-0.01, -0.01, 0.3], [0.01, 0.01, 0.302]]), 1e-3))
CORNER = dihedral(0.02, 0.02, (0, 0, 0.3), 8)
ROOM = (replace(sheet(0.1, 5e-3, 0.4), reflectivity_db=-80.0),)


def on(choices):
    return {choice.effect for choice in choices if choice.on}


@pytest.mark.parametrize(
    ("scene", "expected"),
    [
        (bead_scene(target=FLAT), set()),
        (bead_scene(target=BOX), set()),
        (bead_scene(target=FLAT, room=ROOM), {"shadow", "multipath", "clutter"}),
        (bead_scene(), {"shadow", "multipath"}),
        (bead_scene(target=CORNER), {"shadow", "multipath"}),
        (bead_scene({"motion": {"amplitude_m": 1e-9}}, target=FLAT), {"motion"}),
        (bead_scene(EVERYTHING), {"shadow", "multipath", *EVERYTHING}),
    ],
)
def test_auto_is_everything_that_the_scene_has_a_cause_for(scene, expected):
    assert on(choose(scene, "auto")) == {"obliquity", *expected}


@pytest.mark.parametrize("body", [FLAT, BOX])
def test_what_auto_leaves_out_of_a_body_with_flat_sides_changes_little(body):
    scene = bead_scene(target=body)
    rows = choose(scene, "auto")
    samples = simulate_scene(scene, rows).capture.samples
    every = [row.model_copy(update={"on": row.on or "lone plate" in row.why}) for row in rows]
    everything = simulate_scene(scene, tuple(every)).capture.samples
    assert np.linalg.norm(samples - everything) < 2e-3 * np.linalg.norm(everything)


@pytest.mark.parametrize(
    ("body", "flat"),
    [
        (FLAT, True),
        (BOX, True),
        (CORNER, False),
        (joined(FLAT, replace(FLAT, vertices_m=FLAT.vertices_m + [0, 0, 0.01])), False),
        (sphere_body(0.01), False),
    ],
)
def test_blocks(body, flat):
    turn = Rotation.from_rotvec([0.3, 0.5, 0.2]).as_matrix()
    for vertices_m in (body.vertices_m, body.vertices_m @ turn.T):
        assert convex_block(Body(vertices_m, body.faces)) == flat


def test_what_the_scene_lacks_is_off_and_reported():
    rows = {row.effect: row for row in choose(bead_scene(), "auto")}
    assert not rows["noise"].on and rows["noise"].why.startswith("needs [noise]")


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (("nois",), "did you mean 'noise'"),
        (("noise", "noise"), "twice"),
        (("clutter",), r"'clutter' needs \[stand\] with reflectivity_db; add this"),
    ],
)
def test_names_are_checked(names, message):
    with pytest.raises(HandbenchError, match=message):
        choose(bead_scene({"noise": {"phase_noise_rad": 0.1}}), names)
