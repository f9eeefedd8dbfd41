"""Exact imaging against the float64 direct sum, and the conventions that everything stands on."""

import numpy as np
import pytest

from handbench.radar.data.arrays import qar50
from handbench.radar.simulation.forward import Scatterers, simulate
from tests.radar.direct_sums import direct_sum
from tests.radar.exact import backproject
from tests.radar.samples import noise, relative_error

PAPER_HZ = np.linspace(72e9, 82e9, 128)


def test_broadband_at_random_points_agrees_with_the_direct_sum():
    # A float32 sum of N terms of random sign loses about √N · 6e-8 of its size; 1e-5 is the
    # project's bar.
    samples = noise((128, 94, 94))
    points_m = np.random.default_rng(1).uniform([-0.15, -0.15, 0.245], [0.15, 0.15, 0.325], (40, 3))
    reference = direct_sum(samples, PAPER_HZ, qar50(), points_m)
    assert relative_error(backproject(samples, PAPER_HZ, qar50(), points_m), reference) < 1e-5


def test_a_point_echo_focuses_where_it_came_from_with_phase_zero():
    point_m = np.array([[0.02, -0.03, 0.29]])
    samples = simulate(Scatterers(point_m, np.ones(1)), PAPER_HZ, qar50(), spreading=False)
    focus = backproject(samples, PAPER_HZ, qar50(), point_m)[0]
    assert abs(focus) == pytest.approx(128 * 94 * 94, rel=1e-5)
    assert abs(np.angle(focus)) < 1e-5
    beside = backproject(samples, PAPER_HZ, qar50(), point_m + [[0.02, 0.0, 0.0]])[0]
    assert abs(beside) < 0.1 * abs(focus)
