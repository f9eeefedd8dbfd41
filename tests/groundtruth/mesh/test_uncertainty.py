"""The standard deviation of a surface: what it comes from, and where it grows."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import Delaunay

from handbench.groundtruth.cameras import registered_images
from handbench.groundtruth.dense.fusion import Cloud
from handbench.groundtruth.mesh.uncertainty import (
    NEIGHBOURS,
    OBSERVED_PX,
    REACH_PX,
    SHARED_PX,
    SLOPE,
    camera_variance,
    matching_variance,
    surface_sigma,
    window_sigma,
)
from handbench.groundtruth.sparse.adjust import point_covariance
from tests.groundtruth.noisy_model import noisy_model

PIXEL_M = 1e-3
NAMES = tuple(f"p{i}.png" for i in range(5))


def plate():
    """A cloud on the plane z = 0 about the origin, a point a pixel, on which five views agree."""
    x, y = np.meshgrid(*[PIXEL_M * np.arange(-15.0, 16)] * 2)
    points_m = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    n = len(points_m)
    normals, seen = np.tile([0.0, 0, 1], (n, 1)), np.ones((n, 5), dtype=bool)
    return Cloud(points_m, normals, seen, np.full(n, 1e-4), NAMES, PIXEL_M)


@pytest.fixture(scope="module")
def cameras():
    """Photographs and their covariance."""
    scene = noisy_model()
    return registered_images(scene.model), scene.covariance()


def test_cameras_count_along_the_normal(cameras):
    cloud = plate()
    tilted = np.array([0.3, -0.2, 0.5]) / np.sqrt(0.38)
    cloud = replace(cloud, normals=np.tile(tilted, (len(cloud.points_m), 1)))
    cloud.views[::2, 1] = False
    variance = camera_variance(cloud, *cameras)
    for i in (0, 1, 480):
        [covariance] = point_covariance(*cameras, cloud.points_m[[i]], cloud.views[[i]])
        assert variance[i] == pytest.approx(tilted @ covariance @ tilted, rel=1e-9)
    assert variance[0] != pytest.approx(variance[1], rel=1e-3)


def test_the_parts_add_as_variances(cameras):
    """Of five maps: 2 · 4/(5 · 3) of the square of their spread."""
    images, covariance = cameras
    cloud, middle = plate(), np.zeros((1, 3))
    both, _ = surface_sigma(cloud, middle, images, covariance)
    matching, _ = surface_sigma(cloud, middle, images, 0 * covariance)
    steady = replace(cloud, spread_m=0 * cloud.spread_m)
    of_cameras, _ = surface_sigma(steady, middle, images, covariance)
    assert both[0] == pytest.approx(np.hypot(matching[0], of_cameras[0]), rel=1e-9)
    assert matching[0] == pytest.approx(1e-4 * np.sqrt(8 / 15), rel=1e-9)
    assert of_cameras[0] > 2e-5


def test_beyond_the_points_it_grows_and_was_not_seen(cameras):
    images, covariance = cameras
    beyond_px = np.array([0.0, 0.4, 0.9, 1.4, 1.6, 4.0])
    vertices_m = np.stack([PIXEL_M * (15 + beyond_px), 0 * beyond_px, 0 * beyond_px], axis=1)
    sigma_m, observed = surface_sigma(plate(), vertices_m, images, 0 * covariance)
    grown_m = SLOPE * PIXEL_M * np.maximum(beyond_px - REACH_PX, 0)
    np.testing.assert_allclose(sigma_m, np.hypot(1e-4 * np.sqrt(8 / 15), grown_m), rtol=1e-9)
    np.testing.assert_array_equal(observed, beyond_px < OBSERVED_PX)


def test_the_border_is_less_certain_as_far_as_a_matching_window_reaches():
    """A grid of one pixel's spacing, its right half unseen: at the border of what was seen 0.1 px
    more, none from 3 px on."""
    n = 21
    column, row = (axis.ravel() for axis in np.meshgrid(np.arange(n), np.arange(n)))
    vertices_m = PIXEL_M * np.stack([column, row, 0 * row], axis=1)
    faces = Delaunay(vertices_m[:, :2]).simplices
    sigma_m = window_sigma(vertices_m, faces, column <= 15, PIXEL_M)
    more_px = np.interp(np.arange(n), [0, 3, 12, 15, 18, 20], [0.1, 0, 0, 0.1, 0, 0])
    expected_m = PIXEL_M * np.hypot(SHARED_PX, more_px)
    assert sigma_m.reshape(n, n)[10] == pytest.approx(expected_m)
    unseen = window_sigma(vertices_m, faces, np.zeros(n * n, dtype=bool), PIXEL_M)
    assert (unseen == SHARED_PX * PIXEL_M).all()


def test_two_maps_of_one_pair_take_the_spread_of_the_others():
    """Fusion takes two views only of three, and one map's variance is twice the spread that three
    show."""
    seen = np.array([(1, 1, 0), (1, 1, 1), (1, 1, 1)], dtype=bool)
    none_m = np.zeros((3, 3))
    cloud = Cloud(none_m, none_m, seen, np.array([0.0, 3e-4, 4e-4]), NAMES[:3], PIXEL_M)
    expected = [2 * (3e-4**2 + 4e-4**2) / 2, 4 / 3 * 3e-4**2, 4 / 3 * 4e-4**2]
    np.testing.assert_allclose(matching_variance(cloud), expected)


def test_a_vertex_takes_the_mean_of_its_neighbours(cameras):
    images, covariance = cameras
    cloud = plate()
    at = np.argmin(np.linalg.norm(cloud.points_m, axis=1))
    cloud.spread_m[at] = 1e-3  # a draw of few views, by chance
    sigma_m, _ = surface_sigma(cloud, np.zeros((1, 3)), images, 0 * covariance)
    expected = 8 / 15 * ((NEIGHBOURS - 1) * 1e-4**2 + 1e-3**2) / NEIGHBOURS
    assert sigma_m[0] ** 2 == pytest.approx(expected, rel=1e-9)
