"""The volume of the dense stage, from board, cameras and sparse points whose places are known."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from handbench.groundtruth.cameras.cameras import Camera
from handbench.groundtruth.dense.volume import (
    board_plane,
    narrow_volume,
    off_plane,
    plane_through,
    volume,
)
from handbench.groundtruth.dense_stage import coarser
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
    assert found.source == "the board, cameras and sparse points"
    assert np.prod(np.ptp(found.box(), axis=0)) < 40 * np.prod(np.ptp(HAND_M, axis=0))
    board_m = random.uniform((-0.15, -0.1, -2e-4), (0.15, 0.1, 2e-4), (20_000, 3))
    points_m = np.concatenate(
        [board_m, random.uniform(*HAND_M, (20_000, 3)), [(0.14, 0.09, 0.2)] * 3]
    )
    cloud = replace(cloud_of(points_m, np.zeros_like(points_m)), pixel_m=1e-3)
    box_m = narrow_volume(found, cloud, PLANE, sparse).box()
    assert (box_m[0] < HAND_M[0]).all() and (box_m[1] > HAND_M[1]).all()
    assert (box_m >= found.box()[0]).all() and (box_m <= found.box()[1]).all()
    assert np.prod(np.ptp(box_m, axis=0)) < 0.4 * np.prod(np.ptp(found.box(), axis=0))
    assert narrow_volume(found, cloud.at(np.arange(20_000)), PLANE, sparse) == found


def test_the_plane_is_that_of_the_board_beside_the_photographs(tmp_path):
    corners_m = [[0, 0.1, 0], [0.1, 0.1, 0], [0.1, 0, 0], [0, 0, 0]]
    (tmp_path / "board.toml").write_text(f"[[marker]]\nid = 3\ncorners_m = {corners_m}\n")
    plane = board_plane(tmp_path, None, solved([]))
    assert plane.local(np.array([[0.3, 0.2, 0.07]]))[0, 2] == pytest.approx(0.07)
    assert board_plane(tmp_path, None, solved([], "poses")) is None


def test_the_surroundings_of_a_board():
    """Its diagonal aside, 1 cm down, and as high as that or to nine tenths of the
    lowest camera."""
    few_m = np.tile([0.0, 0.0, 0.008], (29, 1))  # one more would bound it
    for height_m, ceiling_m in ((0.6, 0.36056), (0.2, 0.18)):
        centres_m = CENTRES_M * (1, 1, 0) + (0, 0, height_m)
        box_m, _ = off_plane(PLANE, few_m, centres_m)
        expected_m = [[-0.51056, -0.46056, -0.01], [0.51056, 0.46056, ceiling_m]]
        np.testing.assert_allclose(box_m, expected_m, atol=1e-5)


def test_small_photographs_are_not_shrunk_until_nothing_is_left():
    """720 × 480 at draft quality were 45 × 30, too few for a matching window."""
    for width, height, expected in ((2400, 1600, 16), (720, 480, 7), (200, 200, 4)):
        camera = looking_at_the_board(CENTRES_M[0]).model_copy(
            update={"width": width, "height": height}
        )
        assert coarser(4, [camera]) == expected
