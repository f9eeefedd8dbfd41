"""Signed distances against analytic ones, and the zero set of bodies whose surface is known."""

import numpy as np
import pytest

from handbench.bench.scenes.implicit import round_cone, smooth_union, zero_set


def test_a_round_cone_is_the_hull_of_its_spheres() -> None:
    start, end, radii = np.array([0.0, -0.02, 0.0]), np.array([0.01, 0.03, 0.0]), (0.012, 0.005)
    points = np.random.default_rng(0).uniform(-0.06, 0.06, (300, 3))
    t = np.linspace(0, 1, 2001)[:, None, None]
    distance = np.linalg.norm(points - start - t * (end - start), axis=2)
    # The hull is the union of all spheres between the ends; sampling them costs less than a
    # micrometre.
    expected = (distance - np.linspace(*radii, 2001)[:, None]).min(axis=0)
    np.testing.assert_allclose(round_cone(start, end, *radii)(points), expected, atol=1e-6)


def test_zero_set_of_a_sphere_without_the_smaller_one_beside_it() -> None:
    radius_m, edge_m = 0.02, 2e-3
    sphere = round_cone([-1e-9, 0, 0], [1e-9, 0, 0], radius_m, radius_m)
    body = smooth_union([sphere, round_cone([0.035, 0, 0], [0.036, 0, 0], 0.004, 0.004)], 1e-3)
    vertices, faces = zero_set(body, np.full(3, -0.025), np.array([0.045, 0.025, 0.025]), edge_m)
    assert np.abs(np.linalg.norm(vertices, axis=1) - radius_m).max() < 1e-6
    # Flat triangles cut (edge / radius)² / 5 or so of the volume off; the sign says that they face
    # outwards.
    volume_m3 = np.linalg.det(vertices[faces]).sum() / 6
    assert volume_m3 == pytest.approx(4 / 3 * np.pi * radius_m**3, rel=5e-3)
