"""The parametric hand: a sound mesh on the true surface, in the pose asked for, not inside itself.
Its size: test_people."""

import numpy as np
import pytest

from handbench.bench.scenes.hand_pose import POSES, Pose, WristPose
from handbench.bench.scenes.implicit import triangle_quality
from handbench.bench.scenes.textures import marked_skin, skin
from handbench.groundtruth.mesh.surface import mesh
from handbench.support.rays import Rays
from tests.bench.scenes.hand_field import hand_field, one_body

EDGE_M = 3e-3  # three times that of scenes
COARSE_M = 5e-3  # enough for shape and topology


def test_mesh_is_sound() -> None:
    """It does not cross itself, and has a hand's volume with its 38 mm of forearm."""
    vertices_m, faces = one_body(POSES["B"], EDGE_M)
    assert not mesh(vertices_m, faces).is_self_intersecting()
    assert 2.6e-4 < np.linalg.det(vertices_m[faces]).sum() / 6 < 4.5e-4
    edges_m = np.linalg.norm(vertices_m[faces] - vertices_m[np.roll(faces, 1, axis=1)], axis=2)
    assert edges_m.mean() == pytest.approx(EDGE_M, rel=0.05) and edges_m.max() < 2 * EDGE_M
    # 0.3 at 1 mm; at 3 mm the groove between two fingers is narrower than a triangle
    assert triangle_quality(vertices_m[faces]).min() > 0.15
    marks = marked_skin(POSES["B"], 3)(vertices_m) / skin(vertices_m, 3)
    assert np.isfinite(marks).all() and marks.min() > 0.4 and (marks < 0.9).sum() > 20


@pytest.mark.parametrize("name", "BFUSXD")  # the paper's, and those of the narrowest grooves
def test_letters_are_one_body_that_fits_the_scene(name: str) -> None:
    """No deeper than the radar's volume."""
    vertices_m, faces = one_body(POSES[name], COARSE_M)
    placed_m = vertices_m + [0.0, -0.030, 0.310]  # as in scenes
    seen = Rays(placed_m, faces).in_sight(placed_m, np.zeros(3))
    assert np.ptp(vertices_m[seen, 2]) < 0.080


def test_the_wrist_bends_and_leans() -> None:
    # inside the straight forearm; on its palm's side; towards the little finger; the thumb
    arm = np.array([(0.0, -80, 0), (0, -70, -25), (25, -70, 0), (-25, -70, 0)]) / 1000
    wrists = ({}, {"flexion_deg": 60}, {"deviation_deg": 25})
    still, flexed, leaning = (
        list(hand_field(Pose(wrist=WristPose(**wrist)))(arm) < 0) for wrist in wrists
    )
    assert still == [True, False, True, True] and flexed[:2] == [False, True]
    assert leaning[2:] == [False, True]
