"""Depths between the voxels of a maximum intensity projection."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from handbench.radar.methods.backprojection import Backprojection, backprojection, peak_offset
from tests.radar.simulated_points import around, point_capture, strongest_z_m
from tests.strategies import examples

MM = st.integers(-150, 150).map(lambda mm: mm / 1000)


@examples(6)
@given(point_m=st.tuples(MM, MM, st.floats(0.25, 0.32)))
def test_subvoxel_finds_a_point_anywhere_within_five_micrometres(point_m):
    """What is left of a voxel of 1 mm is the lobe's quartic term: 0.5 µm near the axis, 1.6 µm at
    the corner (measured)."""
    config = Backprojection(**around(point_m, half_m=0.001), subvoxel=True, tolerance=None)
    depth = backprojection(point_capture(point_m, config.frequencies_hz), config)
    assert abs(strongest_z_m(depth) - point_m[2]) < 5e-6


@examples(50)
@given(offset=st.floats(-0.499, 0.499), width=st.floats(2, 100), scale=st.floats(1e-9, 1e9))
def test_offset_of_a_gaussian_lobe_is_exact(offset, width, scale):
    # In decibels a Gaussian is a parabola; what is left is rounding, amplified by the curvature
    # 1/width².
    voxels = np.array([-1.0, 0.0, 1.0])
    magnitude = scale * np.exp(-(((voxels - offset) / width) ** 2))
    assert peak_offset(magnitude) == pytest.approx(offset, abs=1e-13 * width**2 + 1e-12)


def test_flat_and_empty_peaks_stay_on_their_voxels():
    magnitude = np.array([[1.0, 0.0, np.nan], [1.0, 0.0, 2.0], [1.0, 0.0, 1.0]])
    assert peak_offset(magnitude).tolist() == [0, 0, 0]
