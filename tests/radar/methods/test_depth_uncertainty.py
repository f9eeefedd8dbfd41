"""The predicted error of a depth against errors that are known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.radar.data.depthmap import DepthMap, load_depthmap
from handbench.radar.methods.depth_uncertainty import quadrature_step_m, spread_m
from handbench.radar.methods.fsk import depth_step_m
from handbench.support.errors import HandbenchError
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


def test_flag_and_sigma_survive_the_file_and_old_files_have_none(tmp_path):
    axes, z_m = (np.arange(3.0), np.arange(2.0)), np.array([[0.3, np.nan, 0.31], [0.3] * 3])
    wrapped, path = z_m > 0.305, tmp_path / "depth.npz"

    def again(*more):
        DepthMap(*axes, z_m, z_m, "3fsk", {}, *more).save(path)
        return load_depthmap(path)

    kept = again(z_m / 1e3, wrapped)
    assert np.array_equal(kept.sigma_m, z_m / 1e3, equal_nan=True)
    assert kept.wrapped.dtype == bool and np.array_equal(kept.wrapped, wrapped)
    assert again().sigma_m is None and again().wrapped is None
    for wrong, words in (
        ((z_m[:1],), r"sigma_m is float64 \(1, 3\); expected real numbers of shape \(2, 3\)"),
        ((z_m, z_m), r"wrapped is float64 \(2, 3\); expected bool"),
    ):
        with pytest.raises(HandbenchError, match=words):
            again(*wrong)
