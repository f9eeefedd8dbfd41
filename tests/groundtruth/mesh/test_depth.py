"""Depth of a mesh on the radar's grid, against analytic surfaces. Planes in double precision:
tests/hard_cases."""

from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from handbench.calibration.transforms import Transform
from handbench.groundtruth.mesh.depth import STEEPEST, Reference, depth_on_grid, reference_on_grid
from handbench.groundtruth.mesh.mesh_files import mesh
from handbench.groundtruth.mesh.surface import Surface
from tests.strategies import examples


def plane(a, b, c, half=1.0):
    xy = np.array([[-half, -half], [half, -half], [half, half], [-half, half]])
    return mesh(np.c_[xy, a * xy[:, 0] + b * xy[:, 1] + c], np.array([[0, 1, 2], [0, 2, 3]]))


def test_a_patch_is_met_within_its_edges():
    """The grid lies off-centre, and is no symmetric one about the patch either."""
    half_m, middle_x_m, middle_y_m = 0.031, -0.3, 0.12
    patch = plane(0.3, -0.2, 0.4, half_m).translate([middle_x_m, middle_y_m, 0])
    x, y = middle_x_m + np.arange(-0.06, 0.05, 0.004), middle_y_m + np.arange(-0.08, 0.07, 0.004)
    inside = (np.abs(x - middle_x_m) < half_m) & (np.abs(y - middle_y_m) < half_m)[:, None]
    z = depth_on_grid(patch, x, y)
    assert inside.any() and (np.isfinite(z) == inside).all()
    exact = 0.4 + 0.3 * (x - middle_x_m) - 0.2 * (y - middle_y_m)[:, None]
    np.testing.assert_allclose(z[inside], exact[inside], rtol=0, atol=1e-9)


X_M, Y_M = np.linspace(-0.2, 0.2, 7), np.linspace(-0.1, 0.15, 5)
TILTED = (-0.7, 0.4, 0.3)  # slopes along x and y, depth on the axis


def sheet(a, b, c, sigma_m=0.0, observed=True):
    flat = plane(a, b, c)
    vertices_m = np.asarray(flat.vertices)
    per_vertex = np.full(len(vertices_m), sigma_m), np.full(len(vertices_m), observed)
    return Surface(vertices_m, np.asarray(flat.triangles), *per_vertex)


def registered(surface, *deviations) -> Reference:
    """The surface on the grid, where its registration has these standard deviations (m, rad)."""
    covariance = np.diag(deviations) ** 2
    return reference_on_grid(surface, X_M, Y_M, Transform("photo", "radar", np.eye(4), covariance))


def test_mesh_and_registration_add_as_variances():
    """The mesh's σ is along the normal, (0.7, −0.4, 1)/√1.65; the registration's here along z."""
    found = registered(sheet(*TILTED, sigma_m=1e-4), 0, 0, 3e-4, 0, 0, 0)
    np.testing.assert_allclose(found.mesh_sigma_m, 1e-4 * np.sqrt(1.65), rtol=1e-12)
    np.testing.assert_allclose(found.registration_sigma_m, 3e-4, rtol=1e-12)
    np.testing.assert_allclose(found.sigma_m**2, 1.65e-8 + 9e-8, rtol=1e-12)


@examples(25)
@given(st.floats(-2, 2), st.floats(-2, 2), st.booleans(), st.integers(0, 2**32 - 1))
def test_the_leverage_is_what_a_small_motion_does(a, b, turned, seed):
    """The surface is moved by 1e-6 (m, rad) and cast again; the second order is 1e-12 times
    slopes of 3, squared. A motion with that much covariance makes depths as uncertain, whichever
    way the faces are turned."""
    step = 1e-6 * np.random.default_rng(seed).uniform(-1, 1, 6)
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_rotvec(step[3:6]).as_matrix()
    matrix[:3, 3] = step[:3]
    surface = sheet(a, b, 0.3)
    surface = replace(surface, faces=surface.faces[:, :: -1 if turned else 1])
    registration = Transform("photo", "radar", np.eye(4), np.outer(step, step))
    before = reference_on_grid(surface, X_M, Y_M, registration)
    after = reference_on_grid(surface.moved(Transform("radar", "radar", matrix)), X_M, Y_M)
    np.testing.assert_allclose(after.z_m - before.z_m, before.leverage @ step, atol=5e-11)
    # the root of rounding at 1e-12 of 1e-12
    moved_m = np.abs(before.leverage @ step)
    np.testing.assert_allclose(before.registration_sigma_m, moved_m, atol=1e-12)


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
