"""What single precision costs steering and the depths of FSK, against double precision.

u = 2⁻²⁴ is the rounding of float32. A sum of n products in it errs by at most n·u of the sum of
their magnitudes, in any order (Higham 2002, sec. 3.1). Images and echoes have their bounds in the
hard cases of geometry.
"""

from __future__ import annotations

import numpy as np
import pytest

from handbench.radar.imaging.cpu.steering import cis_turns
from handbench.radar.methods.fsk import depth_step_m
from tests.hard_cases.cases import U_SINGLE as U
from tests.hard_cases.scenes import LADDER_HZ, POINT_M, C, capture, depth_map, echoes, small_array
from tests.radar.direct_sums import direct_sum as direct
from tests.radar.exact import tone_images

STEER = 4 * U  # a steering phase, radians: its remainder rounds to π/2·u, cosine and sine by 2u
ANTENNAS = 2 * sum(small_array().channels)
TONES_HZ, SAMPLES = np.array(LADDER_HZ), echoes(POINT_M, frequencies_hz=LADDER_HZ)


@pytest.mark.parametrize("range_m", [0.3, 2.0, 20.0])
def test_steering_is_good_to_four_roundings_at_any_range(range_m):
    turns = np.random.default_rng(0).uniform(0.5, 1.0, 4000) * 2 * range_m * 82e9 / C
    phase = 2 * np.pi * np.mod(turns, 1.0)  # exact: the remainder of a float64 is one
    found = np.array([cis_turns(t) for t in turns])
    assert np.abs(found - np.stack([np.cos(phase), np.sin(phase)], axis=1)).max() <= STEER


@pytest.mark.parametrize("other", [1, 3, 4])
def test_a_depth_step_errs_by_what_sums_and_steering_round(other):
    """Steering twice, and sums over both legs, of the pixels within 10 dB of the strongest."""
    along_m = np.linspace(-0.004, 0.004, 9)
    x, y = np.meshgrid(along_m, along_m)
    points_m = np.stack([x, y, np.full_like(x, POINT_M[2] + 0.002)], axis=-1).reshape(-1, 3)
    array, samples = small_array(), SAMPLES.astype(np.complex64)
    single = tone_images(samples, TONES_HZ, array, points_m)
    double = np.array([direct(samples[[f]], TONES_HZ[[f]], array, points_m) for f in range(5)])
    seen = np.abs(double[0]) > np.abs(double[0]).max() * 10 ** (-10 / 20)
    apart_hz = TONES_HZ[0] - TONES_HZ[other]
    steps_m = [
        depth_step_m(images[0, seen], images[other, seen], apart_hz) for images in (single, double)
    ]
    share = np.abs(samples[0]).sum() / np.abs(double[:, seen]).min()
    bound_m = C / (4 * np.pi * apart_hz) * 2 * (2 * STEER + ANTENNAS * U) * share
    assert np.abs(steps_m[0] - steps_m[1]).max() <= bound_m


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
