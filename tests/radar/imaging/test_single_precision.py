"""What single precision costs steering and the depths of FSK, against double precision.

u = 2⁻²⁴ is the rounding of float32. A sum of n products in it errs by at most n·u of the sum of
their magnitudes, in any order (Higham 2002, sec. 3.1). Images and echoes have their bounds in the
hard cases of geometry.
"""

from __future__ import annotations

import numpy as np
import pytest

from handbench.radar.imaging.cpu.steering import cis_turns
from tests.hard_cases.scenes import LADDER_HZ, POINT_M, C, capture, depth_map, echoes, small_array
from tests.references.balls import U_SINGLE as U

STEER = 4 * U  # a steering phase, radians: its remainder rounds to π/2·u, cosine and sine by 2u
ANTENNAS = 2 * sum(small_array().channels)
TONES_HZ, SAMPLES = np.array(LADDER_HZ), echoes(POINT_M, frequencies_hz=LADDER_HZ)


@pytest.mark.parametrize("range_m", [0.3, 2.0, 20.0])
def test_steering_is_good_to_four_roundings_at_any_range(range_m):
    turns = np.random.default_rng(0).uniform(0.5, 1.0, 4000) * 2 * range_m * 82e9 / C
    phase = 2 * np.pi * np.mod(turns, 1.0)  # exact: the remainder of a float64 is one
    found = np.array([cis_turns(t) for t in turns])
    assert np.abs(found - np.stack([np.cos(phase), np.sin(phase)], axis=1)).max() <= STEER


@pytest.mark.parametrize("id", ["2fsk", "3fsk", "nfsk"])
def test_a_map_s_depths_err_by_the_tolerance_and_the_roundings(id):
    """The tolerance bounds the image's error as a whole, which at worst lies in one pixel, here one
    at the threshold. The fast chain has three levels, each a steering and products of three sums
    whose roundings are independent, so that they grow with the root of their terms."""
    taken = capture(SAMPLES, LADDER_HZ)
    fast, exact = (depth_map(id, taken, tolerance=t, first_depth_m=0.28) for t in (1e-5, None))
    rounded = 3 * (2 * STEER + np.sqrt(ANTENNAS + len(TONES_HZ)) * U)
    power = 10 ** (exact.amplitude_db.astype(np.float64) / 10)
    spill = np.sqrt(power.sum()) / 10 ** (-10 / 20)
    error_m = np.nanmax(np.abs(fast.z_m - exact.z_m))
    assert error_m <= C / (4 * np.pi * 0.2e9) * 2 * (1e-5 + rounded) * spill
