"""The dense stage on pictures of a textured sphere before a wall, whose depth is known in closed
form."""

import numpy as np
import pytest
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from handbench.groundtruth.dense.dense import choose_sources, depth_maps
from handbench.groundtruth.dense.fusion import fuse
from tests.groundtruth import ball


@pytest.fixture(scope="module")
def maps():
    return depth_maps(*ball.scene(), seed=0)


def test_depths_and_fused_points_are_right_where_they_are_given(maps):
    ball.check(maps, known=0.6, rim=0.6, angle_deg=6, points=3000)


def test_a_source_at_a_useful_angle_is_better_than_a_nearer_one():
    """2° are worth e^(−(10/6)²/2), 25 %, and 20° e^(−(8/25)²/2), 95 %."""
    turns = Rotation.from_euler("y", [[0], [2], [20]], degrees=True).as_matrix()
    views = [ball.view(f"{i}", R) for i, R in enumerate(turns)]
    assert choose_sources(views, np.ones((1, 3), bool), np.zeros((1, 3)))[0] == [2, 1]


def test_twelve_cameras_30_degrees_apart_see_all_around_the_sphere():
    """A point has two or three other cameras that see it well: if two had to confirm it, a tenth
    would be missing (measured)."""
    cloud = fuse(depth_maps(*ball.ring(12), seed=0))
    error = np.abs(np.linalg.norm(cloud.points_m, axis=1) - ball.RADIUS_M) / ball.DISPARITY_M
    assert np.median(error) < 0.02 and np.quantile(error, 0.99) < 0.1
    around, up = np.meshgrid(np.deg2rad(np.arange(0, 360, 2)), np.deg2rad(np.arange(-30, 31, 3)))
    band = np.stack([np.cos(up) * np.sin(around), np.sin(up), np.cos(up) * np.cos(around)], axis=-1)
    distance_m, _ = KDTree(cloud.points_m).query(ball.RADIUS_M * band)
    assert (distance_m < 2 * ball.PIXEL_M).mean() > 0.99


def test_windows_bend_with_the_sphere(maps):
    """Flat windows would put the cap 0.027 of a pixel of disparity behind the sphere (measured)."""
    depth_m, points_m, _, _ = ball.surface(maps[0].view)
    on_cap = np.linalg.norm(points_m[..., :2], axis=-1) < 0.6 * ball.RADIUS_M
    off = ((maps[0].depth_m - depth_m) / ball.DISPARITY_M)[on_cap]
    assert abs(np.nanmedian(off)) < 0.01


def test_the_number_of_threads_changes_nothing(maps, monkeypatch):
    monkeypatch.setenv("HANDBENCH_WORKERS", "1")
    alone = depth_maps(*ball.scene(), seed=0)
    np.testing.assert_array_equal([m.depth_m for m in alone], [m.depth_m for m in maps])
