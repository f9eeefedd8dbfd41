"""The oracle of balls against closed forms of its own, and its radii against what is known
exactly."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

from tests.hard_cases.scenes import TONES_HZ, cloud, plate
from tests.references import balls as b


def test_a_difference_is_never_given_too_small():
    """1/3 and √2 are no floats: the distance to the nearest one is known, and a nan is infinitely
    far."""
    third = b.balls(1.0) / 3
    assert 1.8e-17 < b.off(1 / 3, third) < 1.9e-17
    assert b.off(np.nan, third) == np.inf and b.off(1.0, b.balls(0.0) / 0) == np.inf
    wide = third.union(third + 1)
    assert 1 <= b.off(1 / 3, wide) < 1.001


def test_one_channel_s_image_is_a_phase_of_the_path():
    """3 + 5 m at a wavelength of 1 m: a whole number of turns; a quarter of a wavelength more
    is j."""
    from handbench.radar.data.arrays import AntennaArray

    one = AntennaArray(np.array([[3.0, 0, 0]]), np.array([[0, 4.0, 3.0]]))
    tone_hz = np.array([float(b.LIGHT_M_S)])
    [[found]] = b.images(np.ones((1, 1, 1, 1)), one, tone_hz, np.zeros((1, 3)))
    assert b.off(1.0 + 0j, found) < 1e-35
    [[found]] = b.images(np.ones((1, 1, 1, 1)), one, tone_hz * (1 + 1 / 32), np.zeros((1, 3)))
    assert b.off(1j, found) < 1e-35


def test_echoes_are_imaged_with_the_conjugate():
    points = cloud(1, (0, 0, 0.3))
    samples = b.echoes(np.ones(1), plate(), TONES_HZ, points)
    to, back = b.legs_m(plate(), points)
    [[found]] = b.images(b.middles(samples)[None], plate(), TONES_HZ, points)
    expected = len(TONES_HZ) * (1 / to).sum() * (1 / back).sum()
    assert abs(complex(found) / float(expected) - 1) < 1e-15


def test_the_rotation_is_that_of_least_squares():
    turn = Rotation.from_rotvec([0.3, -1.1, 2.0]).as_matrix()
    points = np.random.default_rng(0).normal(size=(5, 3))
    assert b.off(turn, b.rotation(points, points @ turn.T)).max() < 1e-15
    noisy = points @ turn.T + 0.1 * np.random.default_rng(1).normal(size=(5, 3))
    exact = b.middles(b.rotation(points, noisy))
    fitted, _ = Rotation.align_vectors(noisy - noisy.mean(axis=0), points - points.mean(axis=0))
    assert fitted.as_matrix() == pytest.approx(exact, abs=1e-12)


@pytest.mark.parametrize("t", [1e-6, 0.5, 3.0, 1e4])
def test_student_s_t(t):
    """Of one and two degrees of freedom p is 1 − 2 arctan(t)/π and 1 − t/√(2 + t²)."""
    ball = b.arb(t)
    assert b.off(0.0, b.two_sided(ball, 1) - (1 - 2 * ball.atan() / b.PI)) < 1e-25
    assert b.off(0.0, b.two_sided(ball, 2) - (1 - ball / (2 + ball * ball).sqrt())) < 1e-25
    assert float(b.two_sided(ball, 7)) == pytest.approx(2 * stats.t.sf(t, 7), rel=1e-12)
