"""Exact imaging against the float64 direct sum, and the conventions that everything stands on."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from handbench.radar.data.arrays import AntennaArray, PlanarScan, qar50
from handbench.radar.simulation.forward import Scatterers, simulate
from tests.radar.direct_sums import direct_sum
from tests.radar.exact import backproject, tone_images
from tests.radar.samples import noise, relative_error
from tests.strategies import examples

PAPER_HZ = np.linspace(72e9, 82e9, 128)


def test_broadband_at_random_points_agrees_with_the_direct_sum():
    # A float32 sum of N terms of random sign loses about √N · 6e-8 of its size; 1e-5 is the
    # project's bar.
    samples = noise((128, 94, 94))
    points_m = np.random.default_rng(1).uniform([-0.15, -0.15, 0.245], [0.15, 0.15, 0.325], (40, 3))
    reference = direct_sum(samples, PAPER_HZ, qar50(), points_m)
    assert relative_error(backproject(samples, PAPER_HZ, qar50(), points_m), reference) < 1e-5


@examples(20)
@given(
    t=st.integers(1, 5),
    r=st.integers(1, 5),
    n=st.integers(1, 300),
    offset_m=st.floats(0.05, 20.0),
    scan=st.booleans(),
    seed=st.integers(0, 2**31),
)
def test_any_array_and_scan_at_any_range_agree_with_the_direct_sum(t, r, n, offset_m, scan, seed):
    generator = np.random.default_rng(seed)
    tx_m, rx_m = (generator.uniform(-0.1, 0.1, (count, 3)) for count in (t, r))
    aperture = PlanarScan(tx_m) if scan else AntennaArray(tx_m, rx_m)
    points_m = generator.uniform(-0.05, 0.05, (n, 3)) + [0, 0, 0.2 + offset_m]
    tones_hz, samples = generator.uniform(60e9, 90e9, 3), noise((3, *aperture.channels), seed)
    # Cancellation may make single points small: compare with the size of the terms, 1e-6 of each
    # (float32).
    for f, image in enumerate(tone_images(samples, tones_hz, aperture, points_m)):
        reference = direct_sum(samples[[f]], tones_hz[[f]], aperture, points_m)
        assert np.abs(image - reference).max() < 1e-6 * np.abs(samples[f]).sum()


def test_a_point_echo_focuses_where_it_came_from_with_phase_zero():
    point_m = np.array([[0.02, -0.03, 0.29]])
    samples = simulate(Scatterers(point_m, np.ones(1)), PAPER_HZ, qar50(), spreading=False)
    focus = backproject(samples, PAPER_HZ, qar50(), point_m)[0]
    assert abs(focus) == pytest.approx(128 * 94 * 94, rel=1e-5)
    assert abs(np.angle(focus)) < 1e-5
    beside = backproject(samples, PAPER_HZ, qar50(), point_m + [[0.02, 0.0, 0.0]])[0]
    assert abs(beside) < 0.1 * abs(focus)
