"""Exact echoes of cylinders against what they must obey: no field along metal; of skin,
reciprocity, and geometrical optics where they are large."""

import numpy as np
import pytest
from scipy.special import hankel2

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray
from tests.references.exact.cylinders import Cylinder, axial_spectrum, cylinder_echoes, scattered

F_HZ = 30e9
K = 2 * np.pi * F_HZ / SPEED_OF_LIGHT_M_S
TWO = [Cylinder(0.0, 0.15, 0.008), Cylinder(0.01, 0.19, 0.02)]
SKIN = 7.0 - 8.0j


def waves_of_dipole(source_m, points_m):
    """A dipole's field [n] as a sum of the waves that `scattered` takes: −jπ H₀(κρ) e^{−jβy} of g =
    e^{−jkR}/R."""
    (x, y, z) = (points_m - source_m).T
    beta, weight = axial_spectrum(K, np.abs(y).max(), 2 * (points_m[:, 2].max() + 0.02))
    kappa = np.sqrt(K**2 - beta**2)
    field = kappa**2 / K**2 * hankel2(0, kappa * np.hypot(x, z)[:, None])
    return -1j * np.pi * (weight * field * np.cos(np.multiply.outer(y, beta))).sum(axis=1)


def test_no_field_along_a_metal_surface():
    """At the front of either cylinder, between the same waves; orders are left out that count at
    the surface alone."""
    source_m = np.array([[0.03, 0.02, 0.0]])
    fronts_m = np.array([[c.x_m, y, c.z_m - c.radius_m] for c in TWO for y in (-0.02, 0.0, 0.03)])
    direct = waves_of_dipole(source_m[0], fronts_m)
    total = scattered(TWO, K, source_m, fronts_m, None)[0] + direct
    assert np.abs(total).max() < 1e-5 * np.abs(direct).max()


def test_transmitters_and_receivers_may_change_places():
    here_m = np.array([[0.03, 0.05, 0.0], [-0.06, 0.02, 0.01]])
    there_m = np.array([[0.05, -0.06, 0.0]])
    to, back = scattered(TWO, K, here_m, there_m, SKIN), scattered(TWO, K, there_m, here_m, SKIN)
    np.testing.assert_allclose(to, back.T, rtol=0, atol=1e-12 * np.abs(to).max())


def test_a_thick_cylinder_mirrors():
    """Geometrical optics at normal incidence: Γ/R √(q/(q + R)) √½ e^{−2jkR}, 1/q = 1/R + 2/a; right
    to 1/ka. In the scale of the forward model, jλ times as much."""
    radius_m, distance_m = 0.1, 0.2
    array, index = AntennaArray(np.zeros((1, 3)), np.zeros((1, 3))), np.sqrt(SKIN)
    image_m = 1 / (1 / distance_m + 2 / radius_m)
    spreading = np.sqrt(image_m / (image_m + distance_m) / 2) / distance_m
    expected = (1 - index) / (1 + index) * spreading * np.exp(-2j * K * distance_m)
    cylinder = Cylinder(0.0, distance_m + radius_m, radius_m)
    [echo] = cylinder_echoes([cylinder], np.array([F_HZ]), array, np.array([SKIN])).ravel()
    assert echo == pytest.approx(1j * 2 * np.pi / K * expected, rel=1 / (K * radius_m))
