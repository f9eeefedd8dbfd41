"""Skeletons and nodes: a few members carry all the others."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from handbench.radar.imaging.skeleton import band_kernel, resampler, skeleton
from tests.strategies import examples

TONES_HZ = np.linspace(72e9, 82e9, 32)


@examples(30)
@given(n=st.integers(1, 40), rank=st.integers(1, 10), seed=st.integers(0, 2**31))
def test_a_skeleton_carries_every_member_of_a_low_rank_family(n, rank, seed):
    family = np.random.default_rng(seed).standard_normal((rank, n))
    family /= np.linalg.norm(family, axis=0)
    index, weights = skeleton(family.T @ family, 1e-6)
    assert len(index) <= min(n, rank)
    # The Gram matrix squares the condition: 1e-16 there is 1e-8 here, times what the weights
    # amplify.
    assert np.abs(family[:, index] @ weights - family).max() < 1e-5 * (1 + np.abs(weights).max())


@examples(20)
@given(half_band=st.floats(0.0, 0.4), exponent=st.floats(-5.0, -2.0), place=st.floats(-1.0, 1.0))
def test_a_band_skeleton_carries_every_wave_of_its_band(half_band, exponent, place):
    tolerance, wavenumber = 10.0**exponent, 2 * np.pi * TONES_HZ[:, None] / 299_792_458.0
    index, weights = skeleton(band_kernel(wavenumber, wavenumber, np.array([half_band])), tolerance)
    wave = np.exp(1j * place * half_band * wavenumber[:, 0])
    error = np.abs(wave[index] @ weights - wave)
    # J₀ bounds the mean over the band; a single wave at its edge may err five times more (measured:
    # two to three).
    assert np.sqrt(np.mean(error**2)) < 5 * tolerance


@examples(60)
@given(
    count=st.integers(2, 900),
    step_m=st.floats(1e-5, 2e-3),
    half_band=st.floats(1.0, 2000.0),
    exponent=st.floats(-6.0, -1.0),
    place=st.floats(-1.0, 1.0),
    uneven=st.booleans(),
)
def test_every_frequency_of_the_band_is_regained(count, step_m, half_band, exponent, place, uneven):
    tolerance = 10.0**exponent
    generator = np.random.default_rng(count)
    fine_m = np.cumsum(step_m * (generator.uniform(0.5, 1.5, count) if uneven else np.ones(count)))
    axis = resampler(fine_m, half_band, tolerance)
    wave = np.exp(1j * place * half_band * fine_m)
    nodes = np.exp(1j * place * half_band * axis.nodes_m).astype(np.complex64)
    parts = [
        axis.along_first(np.ascontiguousarray(part[:, None])) for part in (nodes.real, nodes.imag)
    ]
    regained = (parts[0] + 1j * parts[1])[:, 0]
    # The search weighs 49 frequencies of the band; this one lies anywhere between them. Float32
    # adds 5e-7.
    assert np.sqrt(np.mean(np.abs(regained - wave) ** 2)) < tolerance + 5e-7
    assert len(axis.nodes_m) <= count
