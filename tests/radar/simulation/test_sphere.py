"""Echoes of metal spheres against the exact series of one sphere before short dipoles, which shares
nothing with them."""

import numpy as np
import pytest

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray
from handbench.radar.simulation.spheres import sphere_echo
from tests.references.exact.mie_series import CoatedSphere, sphere_echoes

ANTENNAS_M = np.array([[-40.0, 0.0, 0.0], [0.0, 10.0, 0.0], [0.0, 35.0, 0.0]])
CENTRE_M = np.array([1.0, -2.0, 100.0])


@pytest.mark.parametrize("ka", [0.05, 1.03, 8.0, 35.0])
def test_the_echo_of_a_sphere_is_that_of_the_exact_series(ka):
    """From afar, where dipoles have no near field; antennas in one place and up to 40° apart. The
    echo is the mean over the fields along x and y, which are not quite across every ray."""
    tones_hz, k = np.array([72e9, 77e9]), 2 * np.pi * 77e9 / SPEED_OF_LIGHT_M_S
    array, sphere = AntennaArray(ANTENNAS_M, ANTENNAS_M * [-1, 1, 1]), (CENTRE_M, ka / k, 0.0)
    exact = []
    for field in np.eye(3)[:2]:
        # a dipole is as strong as it looks from the sphere; the product's fields are of one size
        looks = (np.cross(field, leg.directions(CENTRE_M)) for leg in array.legs)
        strengths = [np.linalg.norm(look, axis=1) for look in looks]
        echoes = sphere_echoes(CoatedSphere(tuple(CENTRE_M), ka / k), tones_hz, array, field)
        exact.append(echoes / np.outer(*strengths))
    np.testing.assert_allclose(
        sphere_echo(*sphere, tones_hz, array), np.mean(exact, axis=0), rtol=1e-2
    )
