"""The field behind an outline against a closed form."""

import numpy as np
import pytest
from scipy.special import erfc

from handbench.radar.simulation.physics.shadows import (
    cubes_of,
    edge_waves,
    edges_of,
    visible_outline,
)
from handbench.radar.simulation.scene import Body
from handbench.support.errors import HandbenchError
from handbench.support.rays import Rays, load_open3d
from tests.radar.simulation.effects.plates import sphere_body

K = 2 * np.pi * 80e9 / 299_792_458.0
DISTANCE_M = 0.25  # from the antenna to the edge of a screen


@pytest.mark.parametrize("behind_m", [0.02, 0.1])
def test_a_straight_edge_is_fresnel_s_knife_edge(behind_m):
    """½ erfc(√(jkδ)) in the shadow of a screen x < 0, with the detour δ past its edge, and 1 less
    that in sight. Waves fade from kδ = 10 on."""
    box = load_open3d().geometry.TriangleMesh.create_box(0.2, 0.2, 1e-3).subdivide_midpoint(7)
    body = Body(np.asarray(box.vertices) + [-0.2, -0.1, DISTANCE_M], np.asarray(box.triangles))
    antenna_m, far_m = np.zeros(3), DISTANCE_M + behind_m
    angle = np.linspace(-1, 1, 101)[np.arange(101) != 50]
    x_m = angle * np.sqrt(2 * 9 / K * behind_m * far_m / DISTANCE_M)
    points_m = np.stack([x_m, 0 * x_m, np.full(100, far_m)], axis=1)
    rays = Rays(body.vertices_m, body.faces)
    outline = visible_outline(body, edges_of(body), rays, antenna_m)
    waves = np.empty(len(points_m), np.complex64)
    order, starts = cubes_of(points_m)
    waves[order] = edge_waves(antenna_m, points_m[order], starts, outline, np.array([K]))[0]
    detour_m = DISTANCE_M + np.hypot(x_m, behind_m) - np.hypot(x_m, far_m)
    edge = erfc(np.sqrt(1j * K * detour_m)) / 2
    expected = np.where(x_m < 0, edge, 1 - edge)
    found = rays.in_sight(points_m, antenna_m) + waves
    assert np.abs(found - expected).max() < 0.03


def test_a_mesh_turned_inside_out_is_refused():
    body = sphere_body(0.01, splits=1)
    with pytest.raises(HandbenchError, match="normals of its mesh point inwards"):
        edges_of(Body(body.vertices_m, body.faces[:, ::-1]))
