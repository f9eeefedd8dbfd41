"""Waves at a body's outline against closed forms: Fresnel's knife edge and strip, which share
nothing with it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import erfc

from handbench.radar.simulation.physics.diffraction import (
    cells_of,
    edge_waves,
    edges_of,
    outline,
    visible_outline,
)
from handbench.radar.simulation.scene import Body
from handbench.support.rays import Rays, load_open3d

K = np.array([1500.0, 1718.0])
ANTENNA_M = np.zeros(3)
BEFORE_M, BEHIND_M = 0.25, 0.03


def knife_edge(x_m, at_m):
    """½ erfc(±√(jkδ)): the field over that without a screen from x_m to the left, behind where the
    rays cross its plane at at_m [n]; δ the detour over its edge."""
    far_m = at_m * (BEFORE_M + BEHIND_M) / BEFORE_M
    detour_m = (
        np.hypot(x_m, BEFORE_M)
        + np.hypot(far_m - x_m, BEHIND_M)
        - np.hypot(far_m, BEFORE_M + BEHIND_M)
    )
    return erfc(np.sign(x_m - at_m) * np.sqrt(1j * K[:, None] * detour_m)) / 2


def screen(x_m):
    """A thin plate of small faces at BEFORE_M between x_m[0] and x_m[1]."""
    box = load_open3d().geometry.TriangleMesh.create_box(x_m[1] - x_m[0], 0.24, 1e-5)
    box = box.translate([x_m[0], -0.12, BEFORE_M])
    for _ in range(7):
        box = box.subdivide_midpoint(1)
    return Body(np.asarray(box.vertices), np.asarray(box.triangles))


@pytest.mark.parametrize("x_m", [(0.0, 0.12), (-0.008, 0.008)])
def test_a_straight_screen_diffracts_as_fresnel_says(x_m):
    """A half-plane, and a strip as wide as a finger: 1 − (one knife edge's hidden part − the
    other's)."""
    at_m = np.linspace(-0.03, 0.03, 121) + 1e-5  # where the ray crosses the screen's plane
    points_m = (
        np.stack([at_m, 0 * at_m, 0 * at_m + BEFORE_M], axis=1) * (BEFORE_M + BEHIND_M) / BEFORE_M
    )
    body = screen(x_m)
    lines_m = visible_outline(
        outline(body, edges_of(body), ANTENNA_M), Rays(body.vertices_m, body.faces), ANTENNA_M
    )
    visible = ~((at_m > x_m[0]) & (at_m < x_m[1]))
    found = visible + edge_waves(
        ANTENNA_M, cells_of(points_m, 6e-3), lines_m, K, farthest=40.0, widest=4.0
    )
    expected = 1 - (knife_edge(x_m[0], at_m) - knife_edge(x_m[1], at_m))
    np.testing.assert_allclose(found, expected, atol=0.05)  # the waves of detours that are left out
