"""Round mirrors: Pekeris' function against its residues, and a cylinder's exact series."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ai_zeros, airy, hankel2, jv

from handbench.radar.simulation.physics.creeping import pekeris, round_differences, round_ratios
from handbench.radar.simulation.physics.reflection import dielectric_permittivity, interface
from handbench.radar.simulation.scene import Material


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


@pytest.mark.parametrize("permittivity", [2.7, 6.4])
def test_a_round_mirror_of_plastic_has_no_pole(permittivity):
    """A ratio to the plane's reflection has one, where a constant impedance reflects nothing."""
    material = Material(kind="plastic", permittivity=permittivity)
    normal = abs(interface(1.0, dielectric_permittivity(material), 1.0)[0])
    # 150 with the ratio; 1.5 is metal's near grazing
    assert np.abs(round_ratios(material, 80e9) * normal).max() < 1.5
