"""Depth of a mesh on the radar's grid, against analytic surfaces."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from handbench.calibration.transforms import Transform
from handbench.groundtruth.mesh.depth import STEEPEST, Reference, depth_on_grid, reference_on_grid
from handbench.groundtruth.mesh.mesh_files import load_open3d, mesh
from handbench.groundtruth.mesh.surface import Surface
from tests.strategies import examples


def plane(a, b, c, half=1.0):
    xy = np.array([[-half, -half], [half, -half], [half, half], [-half, half]])
    return mesh(np.c_[xy, a * xy[:, 0] + b * xy[:, 1] + c], np.array([[0, 1, 2], [0, 2, 3]]))


@examples(25)
@given(st.floats(-2, 2), st.floats(-2, 2), st.floats(0.05, 50))
def test_a_plane_is_met_in_double_precision(a, b, c):
    x, y = np.linspace(-0.2, 0.2, 7), np.linspace(-0.1, 0.15, 5)
    z = depth_on_grid(plane(a, b, c), x, y)
    assert z.dtype == np.float64
    np.testing.assert_allclose(z, a * x + b * y[:, None] + c, rtol=1e-12, atol=1e-12)


def test_a_sphere_shows_its_near_side_and_nothing_beside_it():
    radius, centre = 0.08, np.array([0.01, -0.02, 0.3])
    sphere = (
        load_open3d().geometry.TriangleMesh.create_sphere(radius, resolution=200).translate(centre)
    )
    x, y = np.linspace(-0.15, 0.15, 61), np.linspace(-0.15, 0.15, 61)
    z = depth_on_grid(sphere, x, y)
    offset = np.hypot(x - centre[0], y[:, None] - centre[1])
    inside = offset < 0.95 * radius
    exact = centre[2] - np.sqrt(radius**2 - np.where(inside, offset, 0) ** 2)
    # facets lie within radius · (π / 200)² / 2 = 0.01 mm of the sphere, seen under at most 1 / cos
    # = 3.2
    np.testing.assert_allclose(z[inside], exact[inside], atol=4e-5)
    assert np.isnan(z[offset > radius]).all()


@pytest.mark.parametrize(("middle_x_m", "middle_y_m"), [(0.1, 0.25), (-0.3, 0.12), (0.2, -0.4)])
def test_a_patch_is_met_within_its_edges_wherever_the_grid_lies(middle_x_m, middle_y_m):
    """The grid lies off-centre, and is no symmetric one about the patch either."""
    half_m = 0.031
    patch = plane(0.3, -0.2, 0.4, half_m).translate([middle_x_m, middle_y_m, 0])
    x, y = middle_x_m + np.arange(-0.06, 0.05, 0.004), middle_y_m + np.arange(-0.08, 0.07, 0.004)
    inside = (np.abs(x - middle_x_m) < half_m) & (np.abs(y - middle_y_m) < half_m)[:, None]
    z = depth_on_grid(patch, x, y)
    assert inside.any() and (np.isfinite(z) == inside).all()
    exact = 0.4 + 0.3 * (x - middle_x_m) - 0.2 * (y - middle_y_m)[:, None]
    np.testing.assert_allclose(z[inside], exact[inside], rtol=0, atol=1e-9)


def test_the_first_of_two_surfaces_counts():
    both = plane(0, 0, 0.4) + plane(0, 0, 0.3)
    assert depth_on_grid(both, np.array([0.1]), np.array([0.2])) == pytest.approx(0.3, abs=1e-12)


X_M, Y_M = np.linspace(-0.2, 0.2, 7), np.linspace(-0.1, 0.15, 5)
TILTED = (-0.7, 0.4, 0.3)  # slopes along x and y, depth on the axis


def sheet(a, b, c, sigma_m=0.0, observed=True):
    flat = plane(a, b, c)
    vertices_m = np.asarray(flat.vertices)
    told = np.full(len(vertices_m), sigma_m), np.full(len(vertices_m), observed)
    return Surface(vertices_m, np.asarray(flat.triangles), *told)


def registered(surface, *deviations, turned=False) -> Reference:
    """The surface on the grid, where its registration has these standard deviations (m, rad, 1)."""
    covariance = np.diag(deviations) ** 2
    faces = surface.faces[:, ::-1] if turned else surface.faces
    surface = Surface(surface.vertices_m, faces, surface.sigma_m, surface.observed)
    return reference_on_grid(surface, X_M, Y_M, Transform("photo", "radar", np.eye(4), covariance))


@pytest.mark.parametrize("turned", [False, True])
def test_a_plane_across_the_axis_moves_with_the_registration(turned):
    """Along z as a whole, about y in proportion to x, about x to y, sideways and about z not at
    all."""
    flat = sheet(0, 0, 0.3)
    along_z = registered(flat, 0, 0, 2e-4, 0, 0, 0, turned=turned)
    np.testing.assert_allclose(along_z.sigma_m, 2e-4, rtol=1e-12)
    about_x = registered(flat, 0, 0, 0, 1e-3, 0, 0, turned=turned)
    np.testing.assert_allclose(about_x.sigma_m, 1e-3 * np.abs(Y_M)[:, None] + 0 * X_M, atol=1e-18)
    about_y = registered(flat, 0, 0, 0, 0, 1e-3, 0, turned=turned)
    np.testing.assert_allclose(about_y.sigma_m, 1e-3 * np.abs(X_M) + 0 * Y_M[:, None], atol=1e-18)
    assert np.all(registered(flat, 1e-3, 1e-3, 0, 0, 0, 1e-3, turned=turned).sigma_m == 0)
    # a common error of one sign: no face's orientation turns it round
    np.testing.assert_allclose(along_z.leverage[..., 2], 1, rtol=1e-12)


def test_a_tilted_plane_turns_what_is_sideways_into_depth():
    np.testing.assert_allclose(
        registered(sheet(*TILTED), 2e-4, 0, 0, 0, 0, 0).sigma_m, 0.7 * 2e-4, rtol=1e-12
    )
    np.testing.assert_allclose(
        registered(sheet(*TILTED), 0, 2e-4, 0, 0, 0, 0).sigma_m, 0.4 * 2e-4, rtol=1e-12
    )


def test_mesh_and_registration_add_as_variances():
    """The mesh's σ is along the normal, (0.7, −0.4, 1)/√1.65; the registration's here along z."""
    found = registered(sheet(*TILTED, sigma_m=1e-4), 0, 0, 3e-4, 0, 0, 0)
    np.testing.assert_allclose(found.mesh_sigma_m, 1e-4 * np.sqrt(1.65), rtol=1e-12)
    np.testing.assert_allclose(found.registration_sigma_m, 3e-4, rtol=1e-12)
    np.testing.assert_allclose(found.sigma_m**2, 1.65e-8 + 9e-8, rtol=1e-12)


@examples(25)
@given(st.floats(-2, 2), st.floats(-2, 2), st.integers(0, 2**32 - 1))
def test_the_leverage_is_what_a_small_motion_does(a, b, seed):
    """The surface is moved by 1e-6 (m, rad, 1) and cast again; the second order is 1e-12 times
    slopes of 3, squared."""
    step = 1e-6 * np.random.default_rng(seed).uniform(-1, 1, 7)
    matrix = np.eye(4)
    matrix[:3, :3] = np.exp(step[6]) * Rotation.from_rotvec(step[3:6]).as_matrix()
    matrix[:3, 3] = step[:3]
    surface = sheet(a, b, 0.3)
    before = registered(surface, *np.ones(7))
    after = reference_on_grid(surface.moved(Transform("radar", "radar", matrix)), X_M, Y_M)
    np.testing.assert_allclose(after.z_m - before.z_m, before.leverage @ step, atol=5e-11)


def test_correlations_of_the_registration_count():
    """Turning about y at the origin, and moving along z so that the axis goes through x = 0.1 m:
    known there."""
    root = np.array([0, 0, 0.1, 0, 1, 0]) * 1e-3
    transform = Transform("photo", "radar", np.eye(4), np.outer(root, root))
    found = reference_on_grid(sheet(0, 0, 0.3), np.array([0, 0.1, 0.2]), np.array([0.0]), transform)
    np.testing.assert_allclose(
        found.sigma_m, [[1e-4, 0, 1e-4]], atol=1e-11
    )  # the root of rounding at 1e-8


def test_a_steep_surface_is_uncertain_within_bounds():
    found = registered(sheet(100, 0, 0.3, sigma_m=1e-4), 0, 0, 0, 0, 0, 0)
    np.testing.assert_allclose(found.mesh_sigma_m, 1e-4 / STEEPEST, rtol=1e-12)
    sideways = registered(sheet(100, 0, 0.3), 1e-4, 0, 0, 0, 0, 0)
    np.testing.assert_allclose(
        sideways.sigma_m, 1e-4 / STEEPEST, rtol=1e-4
    )  # the normal is x to 0.01 rad: cos 5e-5


def test_what_is_not_known_stays_so():
    """A mesh that does not know itself, a registration that does not, and a surface that nobody
    saw."""
    foreign = registered(sheet(*TILTED, sigma_m=np.nan), 0, 0, 1e-4, 0, 0, 0)
    assert np.isnan(foreign.sigma_m).all() and np.isfinite(foreign.registration_sigma_m).all()
    for registration in (None, Transform("photo", "radar", np.eye(4))):
        alone = reference_on_grid(sheet(*TILTED, sigma_m=1e-4), X_M, Y_M, registration)
        assert np.isnan(alone.sigma_m).all() and np.isnan(alone.registration_sigma_m).all()
        assert np.isfinite(alone.mesh_sigma_m).all() and np.isfinite(alone.z_m).all()
    invented = registered(sheet(*TILTED, sigma_m=1e-4, observed=False), 0, 0, 1e-4, 0, 0, 0)
    assert (
        np.isnan(invented.z_m).all()
        and np.isnan(invented.sigma_m).all()
        and np.isnan(invented.leverage).all()
    )


def test_a_covariance_that_rounding_left_not_quite_positive_gives_no_nan():
    transform = Transform("photo", "radar", np.eye(4), np.diag([1e-8, 0, -1e-15, 0, 0, 0]))
    assert np.all(
        reference_on_grid(sheet(0, 0, 0.3), X_M, Y_M, transform).registration_sigma_m == 0
    )
