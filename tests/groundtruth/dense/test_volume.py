"""The volume of the dense stage, from board, cameras and sparse points whose places are known."""

from types import SimpleNamespace

import numpy as np

from handbench.groundtruth.cameras import Camera
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


def solved(points_m, source="board"):
    """What the volume reads of a sparse stage, whose cameras look along −z."""
    track = SimpleNamespace(length=lambda: 4)
    points = {i: SimpleNamespace(xyz=xyz, track=track) for i, xyz in enumerate(points_m)}
    cameras = [SimpleNamespace(centre_m=centre_m) for centre_m in CENTRES_M]
    model, scale = SimpleNamespace(points3D=points), Scale(source, 20, 20, 1e-4)
    return SimpleNamespace(model=model, cameras=lambda: cameras, scale=scale)


def boxes_of_points(*boxes, seed=0):
    """So many points in each box (lowest and highest corner)."""
    random = np.random.default_rng(seed)
    return np.concatenate([random.uniform(low, high, (n, 3)) for n, low, high in boxes])


BOARD = (-0.15, -0.1, -2e-4), (0.15, 0.1, 2e-4)
WALL = (-2, -2, -2.1), (2, 2, -2)
LAMP = ((0.0, 0.1, 0.59),) * 2  # beside a camera
FEATURES_M = boxes_of_points((2000, *BOARD), (500, *WALL), (200, *HAND_M), (1, *LAMP))


def bare(points_m):
    return cloud_of(points_m, np.zeros_like(points_m))


def size_m3(box_m):
    return np.prod(np.ptp(box_m, axis=0))


def test_points_and_coarse_depth_maps_narrow_the_volume_to_the_hand():
    """Points on the hand and on the board, and few wrong ones, which widen nothing; without the
    hand's, no change; without its fingers, the sparse points show them."""
    sparse = solved(FEATURES_M)
    found = volume(None, PLANE, sparse)
    assert size_m3(found.box()) < 40 * size_m3(HAND_M)
    wrong = (3, *((0.14, 0.09, 0.2),) * 2)
    points_m = boxes_of_points((20_000, *BOARD), (20_000, *HAND_M), wrong, seed=1)
    box_m = narrow_volume(found, bare(points_m), PLANE, sparse).box()
    assert (box_m[0] < HAND_M[0]).all() and (box_m[1] > HAND_M[1]).all()
    assert size_m3(box_m) < 0.4 * size_m3(found.box())
    assert narrow_volume(found, bare(points_m[:20_000]), PLANE, sparse) == found
    half = bare(points_m[points_m[:, 1] < 0])
    assert narrow_volume(found, half, PLANE, sparse).box()[1, 1] > HAND_M[1, 1]


def test_a_box_that_cuts_the_target_is_reported(capsys):
    """Not if it cuts the board only."""
    found = volume(None, PLANE, solved(FEATURES_M))
    for low_m, high_m, cut in ((*HAND_M, False), (found.box()[0] + (0, 0, 0.1), HAND_M[1], True)):
        points_m = boxes_of_points((20_000, low_m, high_m), (4, *BOARD))
        warn_of_cuts(found, bare(points_m), PLANE)
        assert ("volume" in capsys.readouterr().err) == cut


def test_the_plane_is_that_of_the_board_beside_the_photographs(tmp_path):
    corners_m = [[0, 0.1, 0], [0.1, 0.1, 0], [0.1, 0, 0], [0, 0, 0]]
    (tmp_path / "board.toml").write_text(f"[[marker]]\nid = 3\ncorners_m = {corners_m}\n")
    plane = board_plane(tmp_path, None, solved([]))
    np.testing.assert_allclose(plane.height_m(np.array([[0.3, 0.2, 0.07]])), 0.07)
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
        camera = Camera(name="a", width=width, height=height, params=(1,) * 8)
        assert coarser(4, [camera]) == expected
