"""Signed distances against analytic ones, and the zero set of bodies whose surface is known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from handbench.bench.scenes.implicit import round_cone, smooth_minimum, smooth_union, zero_set

POINT = arrays(np.float64, 3, elements=st.floats(-0.1, 0.1))
DISTANCE = st.floats(-0.05, 0.05)


@given(POINT)
def test_a_round_cone_is_the_hull_of_its_spheres(point: np.ndarray) -> None:
    start, end, radii = np.array([0.0, -0.02, 0.0]), np.array([0.01, 0.03, 0.0]), (0.012, 0.005)
    t = np.linspace(0, 1, 2001)[:, None]
    spheres = np.linalg.norm(point - start - t * (end - start), axis=1) - (
        radii[0] + t[:, 0] * (radii[1] - radii[0])
    )
    # The hull is the union of all spheres between the ends; sampling them costs less than a
    # micrometre.
    assert round_cone(start, end, *radii)(point[None])[0] == pytest.approx(spheres.min(), abs=1e-6)


def test_a_sphere_that_holds_the_other_is_refused() -> None:
    with pytest.raises(ValueError, match="end sphere"):
        round_cone([0, 0, 0], [0, 0, 0.001], 0.01, 0.005)


@given(DISTANCE, DISTANCE, st.floats(1e-4, 0.02))
def test_smooth_minimum(a: float, b: float, blend_m: float) -> None:
    got = float(smooth_minimum(np.array([a]), np.array([b]), blend_m)[0])
    assert got == float(smooth_minimum(np.array([b]), np.array([a]), blend_m)[0])
    assert min(a, b) - blend_m / 6 - 1e-12 <= got <= min(a, b)
    if abs(a - b) >= blend_m:
        assert got == min(a, b)


def test_zero_set_of_a_sphere() -> None:
    radius_m, edge_m = 0.02, 2e-3
    sphere = round_cone([-1e-9, 0, 0], [1e-9, 0, 0], radius_m, radius_m)
    vertices, faces = zero_set(sphere, np.full(3, -0.025), np.full(3, 0.025), edge_m)
    assert np.abs(np.linalg.norm(vertices, axis=1) - radius_m).max() < 1e-6
    triangles = vertices[faces]
    volume = (
        np.einsum("ij,ij->i", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])).sum() / 6
    )
    # Flat triangles cut (edge / radius)² / 5 or so of the volume off; the sign says that they face
    # outwards.
    assert volume == pytest.approx(4 / 3 * np.pi * radius_m**3, rel=5e-3)
    edges = np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2)
    assert edges.mean() == pytest.approx(edge_m, rel=0.1)


def test_zero_set_keeps_the_largest_body_alone() -> None:
    body = smooth_union(
        [
            round_cone([0, 0, 0], [0.01, 0, 0], 0.01, 0.01),
            round_cone([0.035, 0, 0], [0.036, 0, 0], 0.004, 0.004),
        ],
        1e-3,
    )
    vertices, _ = zero_set(body, np.full(3, -0.015), np.array([0.045, 0.015, 0.015]), 2e-3)
    assert vertices[:, 0].max() < 0.021
