"""Upsampling regains every frequency of its band."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from handbench.radar.imaging.skeleton import resampler
from tests.strategies import examples


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


def test_few_nodes_suffice_for_the_paper_s_axis():
    # 301 mm at ±950 rad/m hold 91 Nyquist intervals, as many degrees of freedom and, to ε, some
    # (2/π²) ln(143) ln(1/ε) more (Slepian 1983): 98 at 1e-3, 103 at 1e-5. Nodes that crowd at the
    # ends come within 3 % of that.
    assert len(resampler(1e-3 * np.arange(301), 950.0, 1e-3).nodes_m) <= 1.03 * 98
    assert len(resampler(1e-3 * np.arange(301), 950.0, 1e-5).nodes_m) <= 1.03 * 103


def test_pieces_of_windows_cover_every_fine_sample_once():
    axis = resampler(1e-3 * np.arange(301), 950.0, 1e-3)
    pieces = [piece for piece, _, _ in axis.rows(16)]
    assert np.array_equal(
        np.concatenate([np.arange(301)[piece] for piece in pieces]), np.arange(301)
    )
    assert max(piece.stop - piece.start for piece in pieces) <= 16
