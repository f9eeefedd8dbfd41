"""Exact echoes of a sphere against what they must obey: boundary conditions, reciprocity, limits,
and closed forms.

None of these shares anything with the series: the direct field is the dipole's closed form, the
others are electrostatics, geometrical optics, and the same sphere cut into layers elsewhere."""

from __future__ import annotations

import numpy as np
import pytest

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray
from tests.references.exact.dipole_fields import K, dipole_field
from tests.references.exact.mie_series import CoatedSphere, mie, scattered_by_sphere, sphere_echoes

SKIN = 7.0 - 8.0j
ALONG_Y = np.array([0.0, 1.0, 0.0])
BALL = CoatedSphere((0.01, -0.02, 0.2), 0.01)
TX_M = np.array([[0.03, 0.05, 0.0], [-0.06, 0.02, 0.01]])
RX_M = np.array([[0.05, -0.06, 0.0], [0.0, 0.07, 0.0], [-0.02, 0.0, 0.03]])


def test_no_field_along_a_metal_surface():
    """Where y lies in the surface."""
    normals = np.array(
        [[np.cos(a), 0, np.sin(a)] for a in np.radians([-160, -110, -90, -60, 20, 90])]
    )
    points_m = np.array(BALL.centre_m) + BALL.radius_m * normals
    known = dipole_field(TX_M[0], points_m, ALONG_Y)
    total = scattered_by_sphere(BALL, K, TX_M[:1], points_m, ALONG_Y, None)[0] + known
    assert (
        np.abs(total).max() < 1e-6 * np.abs(known).max()
    )  # degrees are left out that count at the surface alone


@pytest.mark.parametrize(("core", "coat"), [(None, None), (SKIN, None), (SKIN, 3 - 0.5j)])
def test_transmitters_and_receivers_may_change_places(core, coat):
    ball = CoatedSphere(BALL.centre_m, BALL.radius_m, 4e-4 if coat else 0.0)
    to, back = (
        scattered_by_sphere(ball, K, *ends, ALONG_Y, core, coat)
        for ends in ((TX_M, RX_M), (RX_M, TX_M))
    )
    np.testing.assert_allclose(to, back.T, rtol=0, atol=1e-12 * np.abs(to).max())


@pytest.mark.parametrize("permittivity", [None, SKIN])
def test_a_large_sphere_mirrors(permittivity):
    """Geometrical optics at normal incidence: Γ/R · q/(q + R) e^{−2jkR}, 1/q = 1/R + 2/a; right to
    1/ka."""
    distance_m, sphere = 0.2, CoatedSphere((0.0, 0.0, 0.3), 0.1)
    index = 1e12 if permittivity is None else np.sqrt(permittivity)
    image_m = 1 / (1 / distance_m + 2 / sphere.radius_m)
    expected = (
        (1 - index)
        / (1 + index)
        * image_m
        / (image_m + distance_m)
        / distance_m
        * np.exp(-2j * K * distance_m)
    )
    f_hz, filling = (
        K * SPEED_OF_LIGHT_M_S / (2 * np.pi),
        None if permittivity is None else np.array([permittivity]),
    )
    array = AntennaArray(np.zeros((1, 3)), np.zeros((1, 3)))
    found = sphere_echoes(sphere, np.array([f_hz]), array, ALONG_Y, filling)
    assert found[0, 0, 0] == pytest.approx(
        1j * 2 * np.pi / K * expected, rel=1 / (K * sphere.radius_m)
    )


def test_a_small_sphere_is_rayleigh_s():
    """A dielectric sphere far smaller than the wave has the moment a³(ε − 1)/(ε + 2) of the field
    at its centre."""
    tiny = CoatedSphere(BALL.centre_m, 2e-5)
    field = scattered_by_sphere(tiny, K, TX_M[:1], TX_M[:1], ALONG_Y, SKIN)[0, 0]
    centre_m = np.array([tiny.centre_m])
    squared = sum(
        dipole_field(TX_M[0], centre_m, ALONG_Y, component)[0] ** 2 for component in np.eye(3)
    )
    moment = tiny.radius_m**3 * (SKIN - 1) / (SKIN + 2)
    assert field == pytest.approx(K**2 * moment * squared, rel=1e-3)


def test_a_coat_of_the_core_is_none_and_a_coat_of_air_is_none():
    degrees = np.arange(1, 20)
    bare, coated = CoatedSphere(BALL.centre_m, 0.01), CoatedSphere(BALL.centre_m, 0.01, 1e-3)
    np.testing.assert_allclose(
        mie(coated, K, degrees, SKIN, SKIN), mie(bare, K, degrees, SKIN, None), rtol=1e-9
    )
    smaller = CoatedSphere(BALL.centre_m, 9e-3)
    for filling in (SKIN, None):
        np.testing.assert_allclose(
            mie(coated, K, degrees, filling, 1.0),
            mie(smaller, K, degrees, filling, None),
            rtol=1e-9,
        )


def test_what_absorbs_nothing_gives_everything_back():
    """|1 + 2a| = 1 for every wave of metal and of dielectrics without losses; less with losses."""
    degrees, coated = np.arange(1, 15), CoatedSphere(BALL.centre_m, 0.01, 1e-3)
    for core, coat in ((None, None), (4.0, None), (None, 2.5), (4.0, 2.5)):
        both = np.concatenate(mie(coated if coat else BALL, K, degrees, core, coat))
        np.testing.assert_allclose(np.abs(1 + 2 * both), 1, rtol=1e-10)
    assert np.all(np.abs(1 + 2 * np.concatenate(mie(coated, K, degrees, SKIN, 2.5 - 1j))) < 1)
