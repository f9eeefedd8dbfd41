"""From points to a surface."""

from dataclasses import replace

import numpy as np
import pytest

from handbench.groundtruth.dense.fusion import Cloud
from handbench.groundtruth.mesh.poisson import clean, surface
from tests.refusals import refuse

RADIUS_M = 0.05
PIXEL_M = 1e-3


def cap(count, centre=(0.0, 0.0, 0.0), lowest=-0.3):
    """Points on the part of a sphere with z above `lowest` radii, a Fibonacci lattice."""
    k = np.arange(count) + 0.5
    z, turn = 1 - 2 * k / count, np.pi * (1 + 5**0.5) * k
    ring = np.sqrt(1 - z**2)
    normals = np.stack([ring * np.cos(turn), ring * np.sin(turn), z], axis=1)[z > lowest]
    return RADIUS_M * normals + centre, normals


def cloud_of(points_m, normals):
    """A cloud that three views agree on, to a tenth of a pixel."""
    n = len(points_m)
    seen, spread_m = np.ones((n, 3), bool), np.full(n, 0.1 * PIXEL_M)
    return Cloud(points_m, normals, seen, spread_m, ("a", "b", "c"), PIXEL_M)


@pytest.fixture(scope="module")
def cloud():
    points_m, normals = cap(60_000)
    noise = np.random.default_rng(0).normal(scale=0.1 * PIXEL_M, size=points_m.shape)
    return cloud_of(points_m + noise, normals)


def test_cleaning_thins_drops_what_stands_alone_and_keeps_what_belongs_to_a_point(cloud):
    """Spreads (as variances) and views that say where a point is: still true afterwards, of the
    mean of a voxel. About one point is left a voxel that the surface crosses."""
    stray = cloud_of(
        np.r_[cloud.points_m, [[0, 0, 0.2], [0.2, 0, 0]]], np.r_[cloud.normals, np.eye(3)[[2, 0]]]
    )
    cleaned = clean(replace(stray, spread_m=stray.points_m[:, 2] + 0.1, views=stray.points_m > 0))
    radius = np.linalg.norm(cleaned.points_m, axis=1)
    assert 10_000 < len(cleaned.points_m) < 40_000
    assert np.abs(radius - RADIUS_M).max() < PIXEL_M
    assert (cleaned.normals * cleaned.points_m).sum(axis=1).min() > 0.9 * RADIUS_M
    np.testing.assert_allclose(cleaned.spread_m - 0.1, cleaned.points_m[:, 2], atol=0.02 * PIXEL_M)
    far = np.abs(cleaned.points_m) > PIXEL_M
    np.testing.assert_array_equal(cleaned.views[far], cleaned.points_m[far] > 0)


def test_the_surface_follows_the_points_and_keeps_its_opening(cloud):
    mesh = surface(clean(cloud))
    vertices = np.asarray(mesh.vertices)
    radius = np.linalg.norm(vertices, axis=1)
    assert np.median(np.abs(radius - RADIUS_M)) < 0.1 * PIXEL_M
    assert np.abs(radius - RADIUS_M).max() < PIXEL_M
    # Poisson alone would close the sphere
    assert vertices[:, 2].min() > -0.3 * RADIUS_M - 5 * PIXEL_M
    assert mesh.is_edge_manifold() and not mesh.is_watertight()


def test_next_to_no_points_are_refused():
    refuse(lambda: clean(cloud_of(np.eye(5, 3), np.eye(5, 3))), "5 points")
