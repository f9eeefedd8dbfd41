"""Signed distances against analytic ones, and the zero set of bodies whose surface is known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from handbench.bench.scenes.implicit import round_cone, smooth_union, zero_set

POINT = arrays(np.float64, 3, elements=st.floats(-0.1, 0.1))


@given(POINT)
def test_a_round_cone_is_the_hull_of_its_spheres(point: np.ndarray) -> None:
    start, end, radii = np.array([0.0, -0.02, 0.0]), np.array([0.01, 0.03, 0.0]), (0.012, 0.005)
    t = np.linspace(0, 1, 2001)[:, None]
    distance = np.linalg.norm(point - start - t * (end - start), axis=1)
    # The hull is the union of all spheres between the ends; sampling them costs less than a
    # micrometre.
    expected = (distance - np.linspace(*radii, 2001)).min()
    assert round_cone(start, end, *radii)(point[None])[0] == pytest.approx(expected, abs=1e-6)


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
