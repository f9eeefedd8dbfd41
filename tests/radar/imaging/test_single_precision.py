"""What single precision costs steering; images and echoes have their bounds in the hard cases of
geometry."""

import numpy as np
import pytest

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.radar.imaging.cpu.steering import cis_turns
from tests.references.balls import U_SINGLE


@pytest.mark.parametrize("range_m", [0.3, 2.0, 20.0])
def test_steering_is_good_to_four_roundings_at_any_range(range_m):
    """A phase's remainder rounds to π/2·u, and its cosine and sine by 2u."""
    wavelengths = 2 * range_m * 82e9 / SPEED_OF_LIGHT_M_S
    turns = np.random.default_rng(0).uniform(0.5, 1.0, 4000) * wavelengths
    phase = 2 * np.pi * np.mod(turns, 1.0)  # exact: the remainder of a float64 is one
    steered = np.array([cis_turns(t) for t in turns])
    expected = np.stack([np.cos(phase), np.sin(phase)], axis=1)
    assert np.abs(steered - expected).max() <= 4 * U_SINGLE
