"""The predicted error of a depth against errors that are known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.radar.methods.depth_uncertainty import quadrature_step_m, spread_m
from handbench.radar.methods.fsk import depth_step_m
from tests.strategies import examples


def white_pair(seed, amplitude, noise_rad, gain=1.0):
    """Two images of the same amplitude with white noise, σ_φ = noise_rad between them where the
    amplitude is 1."""
    generator = np.random.default_rng(seed)
    shape = (2, *np.shape(amplitude))
    noise = (
        noise_rad / np.sqrt(2) * (generator.normal(size=shape) + 1j * generator.normal(size=shape))
    )
    return (amplitude + noise) * np.array([1.0, gain])[:, None, None]


@examples(30)
@given(
    seed=st.integers(0, 9999),
    noise_rad=st.floats(1e-4, 0.1),
    gain=st.floats(0.5, 2.0),
    sign=st.sampled_from([-1, 1]),
)
def test_the_amplitudes_tell_how_far_the_phases_are_off(seed, noise_rad, gain, sign):
    # 60 × 60 independent pixels tell a deviation to ±1.2 % (1σ), twice over; a gain of 2 turns ρ by
    # another 12 %.
    difference_hz = sign * 200e6
    b, a = white_pair(seed, np.ones((60, 60)), noise_rad, gain)
    actual_m = depth_step_m(b, a, difference_hz).std()
    predicted_m = spread_m(quadrature_step_m(b, a, difference_hz), np.ones((60, 60)), 61)
    assert np.median(predicted_m) == pytest.approx(actual_m, rel=0.06 + 0.13 * abs(np.log2(gain)))
    assert actual_m == pytest.approx(SPEED_OF_LIGHT_M_S / (4 * np.pi * 200e6) * noise_rad, rel=0.06)
