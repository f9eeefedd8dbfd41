"""Echoes of points that antennas see or not, before the paper's array."""

from dataclasses import replace

import numpy as np
import pytest

from handbench.radar.data.arrays import qar50
from handbench.radar.simulation.forward import Scatterers, simulate

pytestmark = pytest.mark.usefixtures("planned")

PLACES_M = np.random.default_rng(5).uniform([-0.1, -0.1, 0.245], [0.1, 0.1, 0.325], (400, 3))


def test_points_that_nothing_sees_echo_nothing():
    tones_hz, every = np.array([72e9, 82e9]), np.ones((94, 400), bool)
    plain = Scatterers(PLACES_M, np.ones(400))
    for tolerance in (None, 1e-5):
        blind = replace(plain, seen=(~every, every))
        assert not simulate(blind, tones_hz, qar50(), tolerance=tolerance).any()
    # Where all antennas see everything, a mask changes nothing at all.
    masked = replace(plain, seen=(every, every))
    echoes = [simulate(points, tones_hz, qar50()) for points in (masked, plain)]
    assert np.array_equal(*echoes)
