"""Polarised reflection of echoes over two places, against Fresnel's formulas and image theory."""

import numpy as np
import pytest

from handbench.radar.simulation.physics.bounces import Tubes
from handbench.radar.simulation.physics.creeping import round_ratios
from handbench.radar.simulation.physics.polarisation import tube_factors
from handbench.radar.simulation.physics.reflection import interface, layer_reflection
from handbench.radar.simulation.scene import Material

METAL = round_ratios(Material(), 80e9)
SKIN = Material(kind="plastic", permittivity=6.4, loss_tangent=1.35)
ALONG, ACROSS = np.array([0.0, 1, 0]), np.array([1.0, 0, 0])


def factor(dipole, ratios=METAL, at=((-0.1, 0, 0), (-0.1, 0, 1.0), (0.1, 0, 1.0), (0.1, 0, 0))):
    """Of one tube from place to place; by default of a right-angled dihedral with its edge along
    y, met at 45°."""
    tx_m, start_m, end_m, rx_m = np.array(at, float)
    after, before = (way / np.linalg.norm(way) for way in (rx_m - end_m, end_m - start_m))
    normal = (after - before) / np.linalg.norm(after - before)
    zero, flat, one = np.zeros(1, int), np.zeros((1, 3)), np.ones(1)
    made = Tubes(
        transmitter=zero,
        patch=zero,
        faces=zero[:, None],
        points_m=np.array([[start_m, end_m]]),
        normal=normal[None],
        length_m=one,
        root_m2=one,
        edge_m=flat[None],
        longer_m=flat,
        caustics=zero,
        bend_per_m=np.zeros((1, 2)),
    )
    layers, wavenumber = np.zeros((1, 2), int), 1e3
    return tube_factors(made, tx_m[None], np.asarray(dipole, float), ratios, layers, wavenumber)[0]


def test_a_metal_dihedral_turns_the_field_across_its_edge():
    """Image theory: two mirrors at a right angle turn space by 180° about the edge: a field along
    it stays, one across it comes back as its opposite, and one at 45° comes back crossed (Ruck et
    al., Radar Cross Section Handbook)."""
    assert factor(ALONG) == pytest.approx(1, abs=1e-6)
    assert factor(ACROSS) == pytest.approx(-1, abs=1e-6)
    assert factor((ALONG + ACROSS) / 2**0.5) == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize(("dipole", "sign", "part"), [(ALONG, 1, 0), (ACROSS, -1, 1)])
def test_skin_reflects_by_fresnels_formulas(dipole, sign, part):
    """At 45°; the formulas as in Born & Wolf, sec. 1.5.2. The table of cosines is interpolated:
    1e-3."""
    n, inside = np.sqrt(6.4 * (1 - 1.35j)), np.sqrt(6.4 * (1 - 1.35j) - 0.5)
    s = (0.5**0.5 - inside) / (0.5**0.5 + inside)
    p = (inside - n**2 * 0.5**0.5) / (inside + n**2 * 0.5**0.5)
    expected = ((s, p)[part] * (1 + n) / (1 - n)) ** 2
    assert factor(dipole, round_ratios(SKIN, 80e9)) == pytest.approx(sign * expected, rel=1e-3)


def test_layers_at_an_angle_have_their_limits():
    """A layer of the half-space's own medium, and of no thickness, is the half-space at any angle;
    at normal incidence both polarisations agree."""
    f, epsilon = np.array([80e9]), np.array([6.4 - 8.6j])
    for cosine in (1.0, 0.7, 0.2):
        bare = interface(1.0, epsilon, cosine)
        np.testing.assert_allclose(
            layer_reflection(epsilon, epsilon, 1e-3, f, cosine), bare, atol=1e-12
        )
        np.testing.assert_allclose(
            layer_reflection(np.array([3.0]), epsilon, 0.0, f, cosine), bare, atol=1e-12
        )
    both = layer_reflection(np.array([3.0]), epsilon, 1e-4, f, 1.0)
    np.testing.assert_allclose(both, [both[0]] * 2, atol=1e-12)
