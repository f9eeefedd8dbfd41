"""Alignment of tones: one scatterer in closed form, noise against the Cramér–Rao bound, two
scatterers in one pixel."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.imaging.cpu.steering import phasor
from handbench.radar.methods.alignment import align
from handbench.radar.methods.registry import method
from handbench.support.errors import HandbenchError

TONES_HZ = np.linspace(72e9, 82e9, 8)


def images(offs_m, tones_hz=TONES_HZ, rise=2.0, amplitude=1.0):
    """Images [f, n] of scatterers so far behind the points that were imaged."""
    return amplitude * np.exp(
        -2j * np.pi * tones_hz[:, None] / SPEED_OF_LIGHT_M_S * rise * np.asarray(offs_m)
    )


@given(st.floats(-0.014, 0.014), st.floats(1.2, 2.0), st.floats(-np.pi, np.pi), st.integers(3, 20))
def test_one_scatterer_is_found_wherever_it_is(off_m, rise, phase_rad, count):
    """Within a range cell, of any common phase: to rounding, with coherence 1."""
    tones_hz = np.linspace(72e9, 82e9, count)
    found = align(
        np.exp(1j * phase_rad) * images([off_m], tones_hz, rise), tones_hz, np.array([rise])
    )
    assert found.shift_m[0] == pytest.approx(off_m, abs=1e-9)
    assert found.coherence[0] == pytest.approx(1, abs=1e-9) and found.sigma_m[0] < 1e-6


def test_noise_moves_it_as_the_cramer_rao_bound_says():
    """At an SNR of 20 dB: the error's deviation is the bound's to 5 %, which 4000 draws know to 1
    %, and σ tells it."""
    draws, sigma = np.random.default_rng(3), 0.1
    offs_m = draws.uniform(-0.01, 0.01, 4000)
    noise = sigma / 2**0.5 * (draws.standard_normal((2, 8, 4000)) * [[[1.0]], [[1j]]]).sum(axis=0)
    found = align(images(offs_m) + noise, TONES_HZ, np.full(4000, 2.0))
    k = 4 * np.pi * TONES_HZ / SPEED_OF_LIGHT_M_S
    bound_m = sigma / 2**0.5 / np.sqrt(((k - k.mean()) ** 2).sum())
    assert (found.shift_m - offs_m).std() == pytest.approx(bound_m, rel=0.05)
    assert np.sqrt(np.mean(found.sigma_m**2)) == pytest.approx(bound_m, rel=0.05)


def test_two_depths_in_one_pixel_are_incoherent():
    """A second scatterer as strong, a range cell behind: no shift aligns both, and half of the
    power is left."""
    both = images([0.0]) + images([0.015])
    assert align(both, TONES_HZ, np.array([2.0])).coherence[0] == pytest.approx(0.5, abs=0.15)


def test_an_image_of_zeros_says_that_nothing_is_there():
    found = align(np.zeros((8, 2), np.complex64), TONES_HZ, np.full(2, 2.0))
    assert (
        (found.coherence == 0).all()
        and np.isinf(found.sigma_m).all()
        and (found.shift_m == 0).all()
    )


def test_the_method_finds_a_scatterer_between_voxels():
    """The whole way from echoes that are a float64 sum of their own: to 0.02 mm, where whole voxels
    are 0.4 mm off."""
    array, tones_hz, at_m = qar50(), np.linspace(72e9, 82e9, 16), np.array([0.011, -0.007, 0.2874])
    tx_m, rx_m = (
        np.linalg.norm(at_m - antennas_m, axis=1) for antennas_m in (array.tx_m, array.rx_m)
    )
    samples = np.stack([phasor(tx_m[:, None] + rx_m, f, -1) for f in tones_hz])
    capture = RadarCapture(samples[None].astype(np.complex64), tones_hz, array)
    small = {
        "count": 16,
        "x": {"start_m": 0.005, "stop_m": 0.017, "step_m": 0.001},
        "tolerance": 1e-4,
    }
    small |= {"y": {"start_m": -0.012, "stop_m": -0.002, "step_m": 0.001}}
    chosen = method("broadband-aligned")
    depth = chosen.run(capture, chosen.configure(small, "test"), 0).depth
    row, column = np.unravel_index(np.argmax(depth.amplitude_db), depth.z_m.shape)
    assert depth.z_m[row, column] == pytest.approx(at_m[2], abs=2e-5)
    assert not depth.wrapped[row, column] and depth.sigma_m[row, column] < 2e-5


def test_two_tones_are_refused():
    with pytest.raises(HandbenchError, match="aligned needs 3 tones or more"):
        method("broadband-aligned").configure({"count": 2}, "config")
