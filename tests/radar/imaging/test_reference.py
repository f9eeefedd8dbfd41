"""The reference of all images against its own formula, term by term."""

import cmath
from itertools import product
from math import dist, pi

import numpy as np
import pytest

from handbench.radar.imaging.exact import image_points_exact

RANDOM = np.random.default_rng(0)
TONES_HZ = [82e9, 79.5e9]
TX_M, RX_M = RANDOM.uniform(-0.1, 0.1, (3, 3)), RANDOM.uniform(-0.1, 0.1, (3, 3))
POINTS_M = RANDOM.uniform(-0.1, 0.1, (4, 3)) + [0, 0, 0.3]
SAMPLES = RANDOM.normal(size=(2, 3, 3, 2)) @ [1, 1j]


@pytest.mark.parametrize("pairs", [False, True])
def test_an_image_is_the_sum_over_tones_transmitters_and_receivers(pairs):
    """Or over pairs of them, which are as many pairs as there are transmitters."""
    samples = np.diagonal(SAMPLES, axis1=1, axis2=2) if pairs else SAMPLES
    expected = np.zeros(4, complex)
    for i, f, t, r in product(range(4), range(2), range(3), range(3)):
        path_m = dist(POINTS_M[i], TX_M[t]) + dist(POINTS_M[i], RX_M[r])
        there = SAMPLES[f, t, r] * (t == r or not pairs)
        expected[i] += there * cmath.exp(2j * pi * TONES_HZ[f] * path_m / 299_792_458.0)
    image = image_points_exact(samples, TONES_HZ, TX_M, RX_M, POINTS_M)
    np.testing.assert_allclose(image, expected, rtol=1e-11)
    with pytest.raises(ValueError):
        image_points_exact(samples[:1], TONES_HZ, TX_M, RX_M, POINTS_M)
