"""Depth of a mesh on the radar's grid, against analytic surfaces."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibration.meshes import load_open3d, mesh
from groundtruth.depth import depth_on_grid


def plane(a, b, c, half=1.0):
    xy = np.array([[-half, -half], [half, -half], [half, half], [-half, half]])
    return mesh(np.c_[xy, a * xy[:, 0] + b * xy[:, 1] + c], np.array([[0, 1, 2], [0, 2, 3]]))


@settings(max_examples=25, deadline=None)
@given(st.floats(-2, 2), st.floats(-2, 2), st.floats(0.05, 50))
def test_a_plane_is_met_in_double_precision(a, b, c):
    x, y = np.linspace(-0.2, 0.2, 7), np.linspace(-0.1, 0.15, 5)
    z = depth_on_grid(plane(a, b, c), x, y)
    assert z.dtype == np.float64
    np.testing.assert_allclose(z, a * x + b * y[:, None] + c, rtol=1e-12, atol=1e-12)


def test_a_sphere_shows_its_near_side_and_nothing_beside_it():
    radius, centre = 0.08, np.array([0.01, -0.02, 0.3])
    sphere = load_open3d().geometry.TriangleMesh.create_sphere(radius, resolution=200).translate(centre)
    x, y = np.linspace(-0.15, 0.15, 61), np.linspace(-0.15, 0.15, 61)
    z = depth_on_grid(sphere, x, y)
    offset = np.hypot(x - centre[0], y[:, None] - centre[1])
    inside = offset < 0.95 * radius
    exact = centre[2] - np.sqrt(radius**2 - np.where(inside, offset, 0) ** 2)
    # facets lie within radius · (π / 200)² / 2 = 0.01 mm of the sphere, seen under at most 1 / cos = 3.2
    np.testing.assert_allclose(z[inside], exact[inside], atol=4e-5)
    assert np.isnan(z[offset > radius]).all()


def test_the_first_of_two_surfaces_counts():
    both = plane(0, 0, 0.4) + plane(0, 0, 0.3)
    assert depth_on_grid(both, np.array([0.1]), np.array([0.2])) == pytest.approx(0.3, abs=1e-12)
