"""Waves that creep around round edges: Pekeris' function against its residues, and the field behind
a cylinder's mesh against the exact series, which share nothing with it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ai_zeros, airy, hankel2, jv

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, qar50
from handbench.radar.simulation.physics.creeping import (
    pekeris,
    round_differences,
    round_ratios,
    roundness_of,
)
from handbench.radar.simulation.physics.diffraction import (
    cells_of,
    edge_waves,
    edges_of,
    outline,
    visible_outline,
)
from handbench.radar.simulation.physics.reflection import dielectric_permittivity, interface
from handbench.radar.simulation.scene import Body, EchoScene, Material
from handbench.support.rays import Rays, load_open3d
from tests.references.exact.cases import MATERIALS, mesh_of
from tests.references.exact.cylinders import ACROSS, ALONG, Cylinder, scattered

TONE_HZ = 80e9
K = 2 * np.pi * TONE_HZ / SPEED_OF_LIGHT_M_S
AXIS_M = 0.265


@pytest.mark.parametrize("hard", [False, True])
def test_pekeris_function_is_its_residues_and_the_knife_edge_s_part(hard):
    """Deep in the shadow: 1/(2√π ξ) and the waves that creep, at the zeros of W₂, or of W₂' across
    the edge."""
    xi = np.linspace(0.8, 3, 12)
    zeros, slopes = ai_zeros(40)[:2]
    tau = -(slopes if hard else zeros) * np.exp(-1j * np.pi / 3)
    ai, dai, bi, dbi = airy(tau)
    residues = dai / (tau * (bi - 1j * ai)) if hard else ai / (dbi - 1j * dai)
    crept = -2j * np.pi * (residues * np.exp(-1j * np.multiply.outer(xi, tau))).sum(axis=1)
    found = pekeris(xi, np.array([float(hard)]), np.array([float(not hard)]))[:, 0]
    np.testing.assert_allclose(np.sqrt(np.pi) * found, crept + 1 / (2 * xi), atol=1e-5)


@pytest.mark.parametrize("size", [1.9, 3.0])
@pytest.mark.parametrize("incidence_deg", [20, 45, 60, 68])
def test_a_round_mirror_is_the_exact_series_of_a_cylinder(size, incidence_deg):
    """A plane wave with its field along a metal cylinder, far away, over geometrical optics,
    √(a cos θ/2r) e^{2jka cos θ}. What Pekeris' function leaves out is of the order of 1/ka."""
    ka, cosine, m = 2 * size**3, np.cos(np.radians(incidence_deg)), np.arange(-90, 91)
    waves = jv(m, ka) / hankel2(m, ka) * np.exp(1j * m * (np.pi - 2 * np.radians(incidence_deg)))
    optics = np.sqrt(np.pi * ka * cosine / 4) * np.exp(2j * ka * cosine - 0.25j * np.pi)
    found = 1 - round_differences(0j, size, np.array([cosine]))[0, 0]
    assert found == pytest.approx(waves.sum() / optics, abs=0.65 / ka)


def exact_field(radius_m, antenna_m, points_m, polarisation, material):
    """The field along the dipole at points [n, 3] around one cylinder over that without it, by the
    series."""
    permittivity = None if material.kind == "metal" else dielectric_permittivity(material)
    cylinder = Cylinder(0.0, AXIS_M, radius_m)
    field = scattered([cylinder], K, antenna_m[None], points_m, polarisation, permittivity)[0]
    way_m = np.linalg.norm(points_m - antenna_m, axis=1)
    cosine2 = (points_m - antenna_m)[:, 1 if polarisation == ALONG else 0] ** 2 / way_m**2
    near = 1j / (K * way_m) + 1 / (K * way_m) ** 2
    return 1 + field / (np.exp(-1j * K * way_m) / way_m * (1 - cosine2 + (3 * cosine2 - 1) * near))


def fields(radius_m, antenna_m, points_m, polarisation, material):
    """The same by the outline of a mesh, as a knife's edge and as a round one."""
    mesh = mesh_of(Cylinder(0.0, AXIS_M, radius_m))
    body = Body(np.asarray(mesh.vertices), np.asarray(mesh.triangles), material)
    angle_deg = 90.0 if polarisation == ALONG else 0.0
    scene = EchoScene(qar50(), np.array([TONE_HZ]), np.zeros(1), body, polarisation_deg=angle_deg)
    rays, cells = Rays(body.vertices_m, body.faces), cells_of(points_m, 6e-3)
    for roundness in (None, roundness_of(scene, body)):
        edges = visible_outline(
            outline(body, edges_of(body), antenna_m, roundness), rays, antenna_m
        )
        waves = edge_waves(antenna_m, cells, edges, np.array([K]), farthest=40.0, widest=4.0)[0]
        yield rays.in_sight(points_m, antenna_m) + waves


@pytest.mark.parametrize("height_m", [0.0, 0.1])
@pytest.mark.parametrize("radius_m", [2e-3, 8e-3, 25e-3])
@pytest.mark.parametrize(
    ("polarisation", "material", "bound"),
    [
        (ALONG, "metal", 0.02),
        (ALONG, "skin", 0.02),
        (ACROSS, "metal", 0.08),
        (ACROSS, "skin", 0.05),
    ],
)
def test_the_field_behind_a_cylinder_is_that_of_the_exact_series(
    polarisation, material, bound, radius_m, height_m
):
    """In the shadow and a third of its half-width beside it, 18 mm behind; a knife's edge is off by
    0.08 to 0.2. Across the edge the expansion's next term is larger."""
    antenna_m = np.array([0.03, height_m, 0.0])
    place_m = np.linspace(-1.3, 1.3, 80) * radius_m
    depth_m = AXIS_M + radius_m + 0.018
    x_m = place_m + antenna_m[0] * (1 - depth_m / AXIS_M)
    points_m = np.stack([x_m, 0 * x_m, 0 * x_m + depth_m], axis=1)
    given = antenna_m, points_m, polarisation, MATERIALS[material]
    exact = exact_field(radius_m, *given)
    knife, round_ = (
        np.sqrt(np.mean(np.abs(found - exact) ** 2)) for found in fields(radius_m, *given)
    )
    assert round_ < bound
    assert round_ < 0.5 * knife


def test_nothing_creeps_around_sharp_edges():
    """A box, whose vertices' normals are means over three sides."""
    box = load_open3d().geometry.TriangleMesh.create_box(0.04, 0.04, 2e-3).subdivide_midpoint(4)
    body = Body(np.asarray(box.vertices) + [-0.02, -0.02, 0.3], np.asarray(box.triangles))
    scene = EchoScene(qar50(), np.array([TONE_HZ]), np.zeros(1), body)
    edges = outline(body, edges_of(body), np.zeros(3), roundness_of(scene, body))
    assert len(edges.creeping) > 60
    assert not edges.creeping[:, 3].any()


@pytest.mark.parametrize("permittivity", [2.7, 6.4])
def test_a_round_mirror_of_plastic_has_no_pole(permittivity):
    """A ratio to the plane's reflection has one, where a constant impedance reflects nothing."""
    material = Material(kind="plastic", permittivity=permittivity)
    normal = abs(interface(1.0, dielectric_permittivity(material), 1.0)[0])
    # 150 with the ratio; 1.5 is metal's near grazing
    assert np.abs(round_ratios(material, 80e9) * normal).max() < 1.5
