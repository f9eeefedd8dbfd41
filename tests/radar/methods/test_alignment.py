"""Alignment of tones: one scatterer in closed form, noise against the Cramér–Rao bound, two
scatterers in one pixel, odds of the second maximum."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.radar.methods.alignment import Aligned, align, behind_outline
from tests.radar.simulated_points import around, depth_by, exact_capture

TONES_HZ, MANY_HZ = np.linspace(72e9, 82e9, 8), np.linspace(72e9, 82e9, 16)
UNEVEN_HZ = np.array([82.0e9, 81.8e9, 80.5e9, 77.0e9, 72.0e9])


def images(offs_m, tones_hz=TONES_HZ, rise=2.0, sigma=0.0):
    """Images [f, n] of unit scatterers so far behind the points that were imaged, with white noise
    of the rms sigma."""
    turns = rise * np.asarray(offs_m) * tones_hz[:, None] / SPEED_OF_LIGHT_M_S
    white = np.random.default_rng(3).standard_normal((*turns.shape, 2)) @ [1, 1j]
    return np.exp(-2j * np.pi * turns) + sigma / 2**0.5 * white


@given(st.floats(-0.014, 0.014), st.floats(1.2, 2.0), st.floats(-np.pi, np.pi), st.integers(3, 20))
def test_one_scatterer_is_found_wherever_it_is(off_m, rise, phase_rad, count):
    """Within a range cell, of any common phase: to rounding, with coherence 1."""
    tones_hz = np.linspace(72e9, 82e9, count)
    turned = np.exp(1j * phase_rad) * images([off_m], tones_hz, rise)
    found = align(turned, tones_hz, np.array([rise]))
    assert found.shift_m[0] == pytest.approx(off_m, abs=1e-9)
    assert found.coherence[0] == pytest.approx(1, abs=1e-9) and found.sigma_m[0] < 1e-6


@pytest.mark.parametrize(("tones_hz", "reach_m"), [(TONES_HZ, None), (UNEVEN_HZ, 0.03)])
def test_noise_moves_it_as_the_cramer_rao_bound_says(tones_hz, reach_m):
    """At an SNR of 20 dB: the error's deviation is the bound's to 5 %, which 4000 draws know to 1
    %, and σ says so."""
    offs_m = np.random.default_rng(3).uniform(-0.01, 0.01, 4000)
    found = align(images(offs_m, tones_hz, sigma=0.1), tones_hz, np.full(4000, 2.0), reach_m)
    k = 4 * np.pi * tones_hz / SPEED_OF_LIGHT_M_S
    bound_m = 0.1 / 2**0.5 / np.sqrt(((k - k.mean()) ** 2).sum())
    assert (found.shift_m - offs_m).std() == pytest.approx(bound_m, rel=0.05)
    assert np.sqrt(np.mean(found.sigma_m**2)) == pytest.approx(bound_m, rel=0.05)


def test_two_depths_in_one_pixel_are_incoherent():
    """A second scatterer as strong, a range cell behind: no shift aligns both, and half of the
    power is left. Zeros say nothing."""
    both = np.concatenate([images([0.0]) + images([0.015]), np.zeros((8, 1))], axis=1)
    found = align(both, TONES_HZ, np.full(2, 2.0))
    assert found.coherence == pytest.approx([0.5, 0], abs=0.15) and found.coherence[1] == 0
    assert np.isinf(found.sigma_m[1]) and found.shift_m[1] == 0


def test_the_second_maximum_is_as_likely_as_it_says():
    """At noise that puts some a period off: most wrong ones are among the pixels that are more than
    10 % likely to be wrong, and hardly any is below 1 %."""
    offs_m = np.random.default_rng(2).uniform(-0.02, 0.02, 6000)
    found = align(images(offs_m, UNEVEN_HZ, sigma=0.5), UNEVEN_HZ, np.full(6000, 2.0), 0.03)
    wrong = np.abs(found.shift_m - offs_m) > 0.005
    assert wrong.mean() > 0.01
    assert wrong[found.other > 0.1].sum() > 0.7 * wrong.sum()
    assert wrong[found.other < 0.01].mean() < 0.01


PLACES_M = ((0.011, -0.007, 0.2874), (-0.12, 0.1, 0.31), (0.14, 0.14, 0.28))


@pytest.mark.parametrize(
    ("id", "tones_hz", "values"),
    [
        ("joint", UNEVEN_HZ, {"first_depth_m": 0.3, "filter_px": 1}),
        ("broadband-aligned", MANY_HZ, {"tones_hz": {"count": 16}}),
    ],
)
def test_the_methods_find_a_scatterer_anywhere_in_the_volume(id, tones_hz, values):
    """In its own pixel, up to the corners of the image, and without doubt: to 0.02 mm, where whole
    voxels are 0.4 mm off. Joint depth unfiltered: a lobe off the axis is tilted, and its outline in
    the first plane is not even."""
    for at_m in PLACES_M:
        pixels = around(at_m, half_m=0.006) | {"tolerance": 1e-4}
        depth = depth_by(id, exact_capture(at_m, tones_hz), pixels | values)
        assert depth.z_m[6, 6] == pytest.approx(at_m[2], abs=2e-5) and not depth.wrapped[6, 6]
        assert depth.sigma_m[6, 6] < 3e-4  # the lobe of a point at the corner is tilted


def test_pixels_behind_an_outline_are_marked():
    """A step of 30 mm: the far pixels within the reach of the near ones, no others, and none across
    a small step."""
    z_m = np.full((5, 20), 0.26)
    z_m[:, 10:] = 0.29
    z_m[0, 0] = np.nan
    x, y = ({"start_m": 0.0, "stop_m": 0.05, "step_m": step_m} for step_m in (2e-3, 3e-3))
    config = Aligned(x=x, y=y, edge_m=6e-3)
    hidden = behind_outline(z_m, config, 0.0075)
    assert hidden[:, 10:13].all() and not hidden[:, :10].any() and not hidden[:, 13:].any()
    assert not behind_outline(np.where(z_m > 0.28, 0.265, z_m), config, 0.0075).any()
