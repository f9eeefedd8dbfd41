"""Maximum intensity projection of points whose depth is known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.grid import Axis
from handbench.radar.imaging.api import project_volume
from handbench.radar.imaging.peaks import strongest_voxels
from handbench.radar.methods.projection import (
    cached_peaks,
    maximum_projection,
    peak_offset,
    project,
    volume,
)
from handbench.radar.methods.projection_config import AlignedConfig, BroadbandConfig
from tests.radar.simulated_points import around, point_capture, strongest_z_m
from tests.strategies import examples


def anywhere(edge_m=0.15):
    lateral = st.integers(-round(1000 * edge_m), round(1000 * edge_m)).map(lambda mm: mm / 1000)
    return st.tuples(lateral, lateral, st.floats(0.25, 0.32))


def test_kept_peaks_are_those_of_the_same_echoes_and_voxels(monkeypatch):
    """The reference is the same code with nothing kept; a volume imaged again is counted."""
    imaged = []

    def counted(*given):
        imaged.append(given)
        return project_volume(*given)

    monkeypatch.setattr("handbench.radar.methods.projection.project_volume", counted)
    config = AlignedConfig(**around((0, 0), half_m=0.003), fine_filter_px=1)
    others = [
        (config.model_copy(update={"fine_filter_px": 5, "threshold_db": -20.0}), 0, 0),
        (config.model_copy(update={"z": Axis(start_m=0.25, stop_m=0.3, step_m=0.001)}), 0, 1),
        (config, 1, 1),
    ]
    first = point_capture((0.0, 0.0, 0.28), config.tones_hz())
    capture = RadarCapture(
        np.concatenate([first.samples, 2j * first.samples]), first.frequencies_hz, first.aperture
    )
    kept = {}
    with cached_peaks(kept):
        for _ in range(2):  # a time is that of imaging, so nothing is taken from there
            project(capture, config, "x")
    assert len(imaged) == 2
    for other, frame, volumes in others:
        imaged.clear()
        with cached_peaks(kept, reuse=True):
            depth = project(capture, other, "x", frame)
        assert len(imaged) == volumes
        assert np.array_equal(depth.z_m, project(capture, other, "x", frame).z_m, equal_nan=True)


@examples(6)
@given(point_m=anywhere())
def test_subvoxel_finds_a_point_anywhere_within_five_micrometres(point_m):
    # What is left of a voxel of 1 mm is the lobe's quartic term: 0.5 µm near the axis, 1.6 µm at
    # the corner (measured).
    config = BroadbandConfig(**around(point_m, half_m=0.004), subvoxel=True)
    capture = point_capture(point_m, config.tones_hz())
    depth = maximum_projection(strongest_voxels(volume(capture, config)), config, "broadband")
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
