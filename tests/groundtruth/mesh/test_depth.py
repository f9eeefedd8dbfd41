"""Depth of a surface on the radar's grid, against analytic surfaces. Planes in double precision:
tests/hard_cases."""

from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from handbench.calibration.transforms import Transform
from handbench.groundtruth.mesh.depth import STEEPEST, Reference, reference_on_grid
from handbench.groundtruth.mesh.surface import Surface
from tests.strategies import examples

X_M, Y_M = np.linspace(-0.2, 0.2, 7), np.linspace(-0.1, 0.15, 5)
TILTED = (-0.7, 0.4, 0.3)  # slopes along x and y, depth on the axis


def sheet(a, b, c, sigma_m=0.0, observed=True, half_m=1.0, middle_m=(0.0, 0.0)):
    """The plane z = ax + by + c over a square."""
    x, y = (half_m * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) + middle_m).T
    vertices_m, faces = (
        np.stack([x, y, a * x + b * y + c], axis=1),
        np.array([[0, 1, 2], [0, 2, 3]]),
    )
    return Surface(vertices_m, faces, np.full(4, sigma_m), np.full(4, observed))


def registered(surface, *deviations) -> Reference:
    """The surface on the grid, where its registration has these standard deviations (m, rad)."""
    covariance = np.diag(deviations) ** 2
    return reference_on_grid(surface, X_M, Y_M, Transform("photo", "radar", np.eye(4), covariance))


def test_a_patch_is_met_within_its_edges():
    """The grid lies off-centre, and is no symmetric one about the patch either."""
    half_m, x0_m, y0_m = 0.031, -0.3, 0.12
    x, y = x0_m + np.arange(-0.06, 0.05, 0.004), y0_m + np.arange(-0.08, 0.07, 0.004)[:, None]
    patch = sheet(0.3, -0.2, 0.4, half_m=half_m, middle_m=(x0_m, y0_m))
    inside = (np.abs(x - x0_m) < half_m) & (np.abs(y - y0_m) < half_m)
    expected_m = np.where(inside, 0.4 + 0.3 * x - 0.2 * y, np.nan)
    found_m = reference_on_grid(patch, x, y[:, 0]).z_m
    np.testing.assert_allclose(found_m, expected_m, rtol=0, atol=1e-9)


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
    slopes of 3, squared. A motion with that much covariance makes depths as uncertain (to the root
    of rounding at 1e-12 of 1e-12), whichever way the faces are turned."""
    step = 1e-6 * np.random.default_rng(seed).uniform(-1, 1, 6)
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_rotvec(step[3:6]).as_matrix()
    matrix[:3, 3] = step[:3]
    surface = sheet(a, b, 0.3)
    surface = replace(surface, faces=surface.faces[:, :: -1 if turned else 1])
    registration = Transform("photo", "radar", np.eye(4), np.outer(step, step))
    still = reference_on_grid(surface, X_M, Y_M, registration)
    moved = reference_on_grid(surface.moved(Transform("radar", "radar", matrix)), X_M, Y_M)
    np.testing.assert_allclose(moved.z_m - still.z_m, still.leverage @ step, atol=5e-11)
    np.testing.assert_allclose(
        still.registration_sigma_m, np.abs(still.leverage @ step), atol=1e-12
    )


def test_a_steep_surface_is_uncertain_within_bounds():
    """The normal is x to 0.01 rad: cos 5e-5."""
    found = registered(sheet(100, 0, 0.3, sigma_m=1e-4), 0, 0, 0, 0, 0, 0)
    np.testing.assert_allclose(found.mesh_sigma_m, 1e-4 / STEEPEST, rtol=1e-12)
    sideways = registered(sheet(100, 0, 0.3), 1e-4, 0, 0, 0, 0, 0)
    np.testing.assert_allclose(sideways.sigma_m, 1e-4 / STEEPEST, rtol=1e-4)


def test_what_is_not_known_stays_so():
    """A mesh that does not know itself, a registration that does not, and a surface that nobody
    saw."""
    registration = (0, 0, 1e-4, 0, 0, 0)
    foreign = registered(sheet(*TILTED, sigma_m=np.nan), *registration)
    assert np.isnan(foreign.sigma_m).all() and np.isfinite(foreign.registration_sigma_m).all()
    for unsure in (None, Transform("photo", "radar", np.eye(4))):
        alone = reference_on_grid(sheet(*TILTED, sigma_m=1e-4), X_M, Y_M, unsure)
        assert np.isnan([alone.sigma_m, alone.registration_sigma_m]).all()
        assert np.isfinite([alone.mesh_sigma_m, alone.z_m]).all()
    unseen = registered(sheet(*TILTED, sigma_m=1e-4, observed=False), *registration)
    assert np.isnan([unseen.z_m, unseen.sigma_m]).all() and np.isnan(unseen.leverage).all()


def test_a_covariance_that_rounding_left_not_quite_positive_gives_no_nan():
    transform = Transform("photo", "radar", np.eye(4), np.diag([1e-8, 0, -1e-15, 0, 0, 0]))
    found = reference_on_grid(sheet(0, 0, 0.3), X_M, Y_M, transform)
    assert (found.registration_sigma_m == 0).all()
