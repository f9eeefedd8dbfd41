"""Exact imaging against the float64 direct sum, and the conventions that everything stands on."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from handbench.radar.data.arrays import AntennaArray, PlanarScan, qar50
from handbench.radar.simulation.forward import Scatterers, simulate
from handbench.support.errors import HandbenchError
from tests.radar.direct_sums import direct_sum
from tests.radar.exact import backproject, tone_images
from tests.radar.samples import noise, relative_error
from tests.strategies import examples

PAPER_HZ = np.linspace(72e9, 82e9, 128)
# A float32 sum of N terms of random sign loses about √N · 6e-8 of its size; 1e-5 is the project's
# bar.
RELATIVE = 1e-5


def paper_points(count: int, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).uniform(
        [-0.15, -0.15, 0.245], [0.15, 0.15, 0.325], (count, 3)
    )


def test_broadband_at_random_points_agrees_with_the_direct_sum():
    samples, points = noise((128, 94, 94)), paper_points(40)
    reference = direct_sum(samples, PAPER_HZ, qar50(), points)
    assert relative_error(backproject(samples, PAPER_HZ, qar50(), points), reference) < RELATIVE


def test_each_fsk_tone_at_random_points_agrees_with_the_direct_sum():
    tones_hz, points = np.array([82e9, 81.8e9, 79.5e9]), paper_points(200)
    samples = noise((3, 94, 94))
    images = tone_images(samples, tones_hz, qar50(), points)
    for i in range(3):
        reference = direct_sum(samples[i : i + 1], tones_hz[i : i + 1], qar50(), points)
        assert relative_error(images[i], reference) < RELATIVE


def test_planar_scan_agrees_with_the_direct_sum():
    generator = np.random.default_rng(3)
    scan = PlanarScan(np.c_[generator.uniform(-0.2, 0.2, (300, 2)), np.zeros(300)])
    tones_hz, samples = np.linspace(22.2e9, 26.2e9, 11), noise((11, 300))
    points = generator.uniform([-0.2, -0.2, 0.07], [0.2, 0.2, 0.13], (50, 3))
    reference = direct_sum(samples, tones_hz, scan, points)
    assert relative_error(backproject(samples, tones_hz, scan, points), reference) < RELATIVE


@examples(20)
@given(
    t=st.integers(1, 5),
    r=st.integers(1, 5),
    n=st.integers(1, 300),
    offset_m=st.floats(0.05, 20.0),
    seed=st.integers(0, 2**31),
)
def test_any_array_at_any_range_agrees_with_the_direct_sum(t, r, n, offset_m, seed):
    generator = np.random.default_rng(seed)
    array = AntennaArray(generator.uniform(-0.1, 0.1, (t, 3)), generator.uniform(-0.1, 0.1, (r, 3)))
    points = generator.uniform(-0.05, 0.05, (n, 3)) + [0, 0, 0.2 + offset_m]
    tones_hz, samples = generator.uniform(60e9, 90e9, 3), noise((3, t, r), seed)
    reference = direct_sum(samples, tones_hz, array, points)
    # Cancellation may make single points small: compare with the size of the terms, 1e-6 of each
    # (float32).
    error = np.abs(backproject(samples, tones_hz, array, points) - reference)
    assert error.max() < 1e-6 * np.abs(samples).sum()


def test_a_point_echo_focuses_where_it_came_from_with_phase_zero():
    point = np.array([[0.02, -0.03, 0.29]])
    samples = simulate(Scatterers(point, np.ones(1)), PAPER_HZ, qar50(), spreading=False)
    focus = backproject(samples, PAPER_HZ, qar50(), point)[0]
    assert abs(focus) == pytest.approx(128 * 94 * 94, rel=1e-5)
    assert abs(np.angle(focus)) < 1e-5
    beside = backproject(samples, PAPER_HZ, qar50(), point + [[0.02, 0.0, 0.0]])[0]
    assert abs(beside) < 0.1 * abs(focus)


def test_results_do_not_depend_on_the_number_of_workers(monkeypatch):
    samples, points = noise((4, 94, 94)), paper_points(1000)
    images = []
    for workers in ("1", "3"):
        monkeypatch.setenv("HANDBENCH_WORKERS", workers)
        images.append(backproject(samples, PAPER_HZ[:4], qar50(), points))
    assert np.array_equal(*images)


def test_wrong_sizes_are_named():
    with pytest.raises(HandbenchError, match=r"\(3, 94, 93\).*expected \(3, 94, 94\)"):
        backproject(noise((3, 94, 93)), PAPER_HZ[:3], qar50(), paper_points(1))
