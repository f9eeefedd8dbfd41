"""Capon's spectrum and the coherence factor: one scatterer in closed form, two that a sum cannot
part."""

import numpy as np
import pytest

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.radar.methods.alignment import CAPON_STEP_M, IMAGED_STEP_M, capon, coherence_factor
from handbench.radar.methods.registry import method
from tests.radar.methods.test_joint import around, point_capture

TONES_HZ = np.linspace(72e9, 82e9, 16)


def images(offs_m):
    return np.exp(-4j * np.pi * TONES_HZ[:, None] / SPEED_OF_LIGHT_M_S * np.asarray(offs_m))


def test_one_scatterer_is_found_to_half_a_step():
    offs_m = np.random.default_rng(0).uniform(-0.014, 0.014, 200)
    found_m = capon(images(offs_m), TONES_HZ, np.full(200, 2.0), 0.015)
    assert np.abs(found_m - offs_m).max() <= CAPON_STEP_M / 2 * 1.001
    found_m = coherence_factor(lambda shift_m: images(offs_m - shift_m), 0.015)
    assert np.abs(found_m - offs_m).max() <= IMAGED_STEP_M / 2 * 1.001


def test_capon_parts_what_a_sum_does_not():
    """Two scatterers 10 mm apart, less than the range cell of 15 mm, the nearer one stronger: the
    sum's maximum is drawn towards the other by 0.5 mm and more in some phases, Capon's stays."""
    phases = np.exp(2j * np.pi * np.arange(12) / 12)
    both = images([0.0] * 12) + 0.7 * phases * images([0.010] * 12)
    found_m = capon(both, TONES_HZ, np.full(12, 2.0), 0.012)
    tried_m = np.arange(-0.012, 0.012, CAPON_STEP_M)
    sums = [np.abs((both * np.conj(images([there_m]))).sum(axis=0)) for there_m in tried_m]
    summed_m = tried_m[np.argmax(sums, axis=0)]
    assert np.abs(found_m).max() < np.abs(summed_m).max() and np.abs(summed_m).max() > 0.5e-3


@pytest.mark.parametrize("id", ["broadband-capon", "broadband-coherence"])
def test_the_methods_find_a_scatterer(id):
    """Echoes that are a float64 sum of their own: to half of the estimators' steps."""
    at_m, chosen = (0.011, -0.007, 0.2874), method(id)
    config = chosen.configure(around(at_m, count=16, fine_filter_px=1), "test")
    depth = chosen.run(point_capture(at_m, TONES_HZ), config, 0).depth
    assert depth.z_m[6, 6] == pytest.approx(at_m[2], abs=IMAGED_STEP_M / 2)
