"""First guesses of a textured floor, whose depth is known in closed form, and clouds rendered into
a view."""

import numpy as np
import pytest

from handbench.groundtruth.dense.completion import render_cloud
from handbench.groundtruth.dense.first_guess import first_guess
from handbench.groundtruth.dense.fusion import Cloud
from handbench.groundtruth.dense.views import Stereo, View
from tests.groundtruth.ball import FOCAL_PX, texture

HEIGHT_M = 0.11  # of the cameras, which look level, above the floor: seen under 71° to 79°
SIDE_M = 0.10  # distance between cameras
SIZE = (40, 112)
TOP_PX = 50  # the picture's first row, below the horizon
COARSE = 3  # times the ball's texture


def floor_view(x_m):
    """A camera at x_m that sees nothing but floor, and the true depth [h, w]."""
    K = np.array([[FOCAL_PX, 0, SIZE[1] / 2 - 0.5], [0, FOCAL_PX, -TOP_PX], [0, 0, 1]])
    flat = np.zeros(SIZE, np.float32)
    near_m, far_m = np.full(SIZE, 0.3, np.float32), np.full(SIZE, 0.7, np.float32)
    bare = View(f"{x_m:+.2f}", flat, K, np.eye(3), np.array([-x_m, 0, 0]), near_m, far_m)
    depth_m = HEIGHT_M / bare.rays()[..., 1]
    gray = texture((bare.rays() * depth_m[..., None] - bare.t) / COARSE).astype(np.float32)
    return View(bare.name, gray, K, bare.R, bare.t, near_m, far_m), depth_m


@pytest.mark.parametrize(("slanted", "median"), [(False, (1.0, 9.0)), (True, (0.0, 0.3))])
def test_a_floor_that_is_seen_at_a_low_angle_is_found_by_slanted_sweeps(slanted, median):
    """Over a window of the sweep, 18 rows, the floor's disparity changes by 16."""
    (view, depth_m), *others = (floor_view(x_m) for x_m in (0, SIDE_M, -SIDE_M))
    sources = [other for other, _ in others]
    stereo = Stereo.of(view, sources)
    planes = first_guess(
        view, view.halved(), [source.halved() for source in sources], stereo.unit, slanted
    )
    off = np.abs(planes[..., 0] - 1 / (depth_m * stereo.unit))[8:-8, 8:-8]
    assert median[0] <= np.median(off) <= median[1]


def test_a_cloud_shows_its_nearest_points_that_face_the_view():
    view, _ = floor_view(0)
    rays = view.rays()
    depth_m = np.repeat([0.5, 0.4, 0.35, -0.4], SIZE[1])  # of row 20, four times
    points_m = np.tile(rays[20], (4, 1)) * depth_m[:, None]
    normals = np.repeat([(0, 0, -1.0), (0, 0, -2.0), (0, 0, 1.0), (0, 0, -1.0)], SIZE[1], axis=0)
    few = np.ones(len(points_m))
    shown_m, facing = render_cloud(
        Cloud(points_m, normals, few[:, None] > 0, few, ("v",), 1e-3), view
    )
    np.testing.assert_allclose(shown_m[20], 0.4, rtol=1e-12)
    np.testing.assert_allclose(facing[20], np.tile((0, 0, -1.0), (SIZE[1], 1)))
    assert np.isnan(np.delete(shown_m, 20, axis=0)).all()
