"""The volume of the dense stage, from board, cameras and sparse points whose places are known."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from handbench.groundtruth.cameras.cameras import Camera
from handbench.groundtruth.dense.volume import (
    board_plane,
    narrow_volume,
    plane_through,
    volume,
    warn_of_cuts,
)
from handbench.groundtruth.pipeline import coarser
from handbench.groundtruth.sparse.frame import Scale
from tests.groundtruth.mesh.test_mesh import cloud_of

CORNERS_M = np.array([(x, y, 0.0) for x in (-0.15, 0.15) for y in (-0.1, 0.1)])
CENTRES_M = np.array([(x, 0.0, 0.6) for x in (-0.15, -0.05, 0.05, 0.15)])
HAND_M = np.array([[-0.05, -0.1, 0.06], [0.05, 0.1, 0.12]])
PLANE = plane_through(CORNERS_M, CENTRES_M, 1e-4)


def looking_at_the_board(centre_m):
    """A camera that looks along −z, as wide as its distance."""
    R = np.diag([1.0, -1.0, -1.0])
    return Camera(
        name=f"{centre_m[0]}", width=1000, height=800, params=(1000, 1000, 500, 400, 0, 0, 0, 0),
        R=tuple(map(tuple, R.tolist())), t=tuple((-R @ centre_m).tolist()),
    )  # fmt: skip


def solved(points_m, source="board"):
    """What the volume reads of a sparse stage."""
    track = SimpleNamespace(length=lambda: 4)
    points = {i: SimpleNamespace(xyz=xyz, track=track) for i, xyz in enumerate(points_m)}
    cameras = tuple(looking_at_the_board(centre_m) for centre_m in CENTRES_M)
    return SimpleNamespace(
        model=SimpleNamespace(points3D=points),
        cameras=lambda: cameras,
        scale=Scale(source, 20, 20, 1e-4),
    )


def features(on_hand=200):
    """Many on the board, some on the hand, some on a wall 2 m behind and one on a lamp beside a
    camera."""
    random = np.random.default_rng(0)
    board_m = random.uniform((-0.15, -0.1, -2e-4), (0.15, 0.1, 2e-4), (2000, 3))
    wall_m = random.uniform((-2, -2, -2.1), (2, 2, -2), (500, 3))
    return np.concatenate(
        [board_m, wall_m, random.uniform(*HAND_M, (on_hand, 3)), [(0.0, 0.1, 0.59)]]
    )


def test_points_and_coarse_depth_maps_narrow_the_volume_to_the_hand():
    """Points on the hand and on the board, and few wrong ones, which widen nothing; without the
    hand's, no change."""
    random, sparse = np.random.default_rng(1), solved(features())
    found = volume(None, PLANE, sparse)
    assert np.prod(np.ptp(found.box(), axis=0)) < 40 * np.prod(np.ptp(HAND_M, axis=0))
    board_m = random.uniform((-0.15, -0.1, -2e-4), (0.15, 0.1, 2e-4), (20_000, 3))
    points_m = np.concatenate(
        [board_m, random.uniform(*HAND_M, (20_000, 3)), [(0.14, 0.09, 0.2)] * 3]
    )
    cloud = replace(cloud_of(points_m, np.zeros_like(points_m)), pixel_m=1e-3)
    box_m = narrow_volume(found, cloud, PLANE, sparse).box()
    assert (box_m[0] < HAND_M[0]).all() and (box_m[1] > HAND_M[1]).all()
    assert np.prod(np.ptp(box_m, axis=0)) < 0.4 * np.prod(np.ptp(found.box(), axis=0))
    assert narrow_volume(found, cloud.at(np.arange(20_000)), PLANE, sparse) == found
    half = cloud.at(points_m[:, 1] < 0)  # without the fingers
    assert narrow_volume(found, half, PLANE, sparse).box()[1, 1] > HAND_M[1, 1]


def test_a_box_that_cuts_the_target_is_reported(capsys):
    """Not if it cuts the board only."""
    random, points_m = np.random.default_rng(1), CORNERS_M
    found = volume(None, PLANE, solved(features()))
    for low_m, high_m, cut in ((*HAND_M, False), (found.box()[0] + (0, 0, 0.1), HAND_M[1], True)):
        points_m = np.concatenate([random.uniform(low_m, high_m, (20_000, 3)), CORNERS_M])
        warn_of_cuts(found, cloud_of(points_m, np.zeros_like(points_m)), PLANE)
        assert ("may cut" in capsys.readouterr().err) == cut


def test_the_plane_is_that_of_the_board_beside_the_photographs(tmp_path):
    corners_m = [[0, 0.1, 0], [0.1, 0.1, 0], [0.1, 0, 0], [0, 0, 0]]
    (tmp_path / "board.toml").write_text(f"[[marker]]\nid = 3\ncorners_m = {corners_m}\n")
    plane = board_plane(tmp_path, None, solved([]))
    assert plane.height_m(np.array([[0.3, 0.2, 0.07]]))[0] == pytest.approx(0.07)
    assert board_plane(tmp_path, None, solved([], "poses")) is None


def test_with_few_points_above_it_the_board_gives_the_box():
    low_m = np.tile([0.0, 0.0, 0.013], (200, 1))
    assert volume(None, PLANE, solved(low_m)).source == "sparse points"
    for points_m in (low_m[:29], low_m - (0, 0, 0.003), low_m + (0.5, 0, 0)):
        box_m = volume(None, PLANE, solved(points_m)).box()
        np.testing.assert_allclose(box_m, [[-0.48028] * 3, [0.48028] * 3], atol=1e-5)
    assert volume(None, None, solved(low_m[:29])).box() is None


def test_small_photographs_are_not_shrunk_until_nothing_is_left():
    """2400 × 1600 at draft quality were 150 × 100, where fingers are thinner than matching
    windows."""
    for width, height, expected in ((3600, 2400, 16), (2400, 1600, 12), (200, 200, 4)):
        camera = looking_at_the_board(CENTRES_M[0]).model_copy(
            update={"width": width, "height": height}
        )
        assert coarser(4, [camera]) == expected
