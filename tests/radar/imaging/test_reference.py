"""The reference of all images against its own formula, term by term."""

import cmath
from itertools import product
from math import dist, pi

import numpy as np
import pytest

from handbench.radar.data.arrays import AntennaArray, AntennaPairs
from handbench.radar.imaging.reference import image_points_exact
from tests.radar.direct_sums import direct_echoes, direct_sum

RANDOM = np.random.default_rng(0)
TONES_HZ = [82e9, 79.5e9]
TX_M, RX_M = RANDOM.uniform(-0.1, 0.1, (3, 3)), RANDOM.uniform(-0.1, 0.1, (2, 3))
POINTS_M = RANDOM.uniform(-0.1, 0.1, (4, 3)) + [0, 0, 0.3]
SAMPLES = RANDOM.normal(size=(2, 3, 2, 2)) @ [1, 1j]


def wave(f, t, r, point_m):
    return cmath.exp(2j * pi * TONES_HZ[f] * (dist(point_m, t) + dist(point_m, r)) / 299_792_458.0)


def test_an_image_is_the_sum_over_tones_transmitters_and_receivers():
    expected = [
        sum(
            SAMPLES[f, t, r] * wave(f, TX_M[t], RX_M[r], point_m)
            for f, t, r in product(range(2), range(3), range(2))
        )
        for point_m in POINTS_M
    ]
    found = image_points_exact(SAMPLES, TONES_HZ, TX_M, RX_M, POINTS_M)
    np.testing.assert_allclose(found, expected, rtol=1e-11)
    with pytest.raises(ValueError):
        image_points_exact(SAMPLES[:1], TONES_HZ, TX_M, RX_M, POINTS_M)


@pytest.mark.parametrize(
    "scan", [AntennaPairs(TX_M, TX_M), AntennaPairs(TX_M[:2], RX_M), AntennaArray(TX_M, RX_M)]
)
def test_direct_sums_and_echoes_of_scans_and_arrays_are_adjoint(scan):
    samples, weight = (
        RANDOM.normal(size=(*shape, 2)) @ [1, 1j] for shape in ((2, *scan.channels), (4,))
    )
    echoes = direct_echoes(POINTS_M, weight, TONES_HZ, scan)
    image = direct_sum(samples, TONES_HZ, scan, POINTS_M)
    assert np.vdot(echoes, samples) == pytest.approx(np.vdot(weight, image), rel=1e-11)
