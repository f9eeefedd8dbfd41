"""Maximum intensity projection of points whose depth is known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from handbench.radar.data.arrays import qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.grid import Axis
from handbench.radar.imaging.api import project_volume
from handbench.radar.imaging.peaks import strongest_voxels
from handbench.radar.methods.projection import (
    Peaks,
    cached_peaks,
    maximum_projection,
    peak_offset,
    project,
    volume,
)
from handbench.radar.methods.projection_config import (
    AlignedConfig,
    BroadbandConfig,
    NarrowbandConfig,
)
from tests.radar.simulated_points import (
    around,
    bumpy,
    point_capture,
    points_capture,
    strongest_z_m,
    surface_points,
)
from tests.strategies import examples


def anywhere(edge_m=0.15):
    lateral = st.integers(-round(1000 * edge_m), round(1000 * edge_m)).map(lambda mm: mm / 1000)
    return st.tuples(lateral, lateral, st.floats(0.25, 0.32))


@examples(4)
@given(point_m=anywhere())
def test_broadband_finds_a_point_anywhere_within_half_a_voxel(point_m):
    config = BroadbandConfig(**around(point_m, half_m=0.004))
    capture = point_capture(point_m, config.tones_hz())
    depth = maximum_projection(strongest_voxels(volume(capture, config)), config, "broadband")
    assert abs(strongest_z_m(depth) - point_m[2]) <= 0.5e-3 + 1e-9


@pytest.mark.parametrize("z_m", [0.2, 0.235, 0.246, 0.28, 0.324, 0.335, 0.345, 0.4])
def test_a_point_is_flagged_where_it_lies_outside_the_volume(z_m):
    config = BroadbandConfig(**around((0, 0), half_m=0.003))
    point = point_capture((0.0, 0.0, z_m), config.tones_hz())
    depth = project(point, config, "broadband")
    assert depth.wrapped[3, 3] == (not 0.245 < z_m < 0.325)
    assert np.array_equal(
        depth.z_m,
        maximum_projection(strongest_voxels(volume(point, config)), config, "broadband").z_m,
        equal_nan=True,
    )


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


def test_noise_is_flagged_by_broadband_and_cannot_be_by_three_tones():
    generator = np.random.default_rng(2)
    for kind, flagged in ((BroadbandConfig, True), (NarrowbandConfig, False)):
        config = kind(
            **around((0, 0), half_m=0.015, step_m=0.003),
            z=Axis(start_m=0.27, stop_m=0.3, step_m=0.001),
        )
        noise = generator.normal(size=(2, 1, len(config.tones_hz()), 94, 94))
        samples = (noise[0] + 1j * noise[1]).astype(np.complex64)
        depth = project(RadarCapture(samples, config.tones_hz(), qar50()), config, "noise")
        inside = np.isfinite(depth.z_m) & (depth.z_m > 0.2705) & (depth.z_m < 0.2995)
        assert inside.sum() > 40
        assert depth.wrapped[inside].mean() > 0.9 if flagged else not depth.wrapped[inside].any()


def test_narrowband_repeats_at_the_ambiguity_of_its_tones():
    # The three tones can hardly tell depths apart that differ by c/2/2.4 GHz ≈ 62 mm: out of focus
    # as it is, the second lobe stays far above the method's threshold of −13 dB (0.22).
    point_m = (0.0, 0.0, 0.29)
    config = NarrowbandConfig(
        **around(point_m, half_m=0.0), z=Axis(start_m=0.2, stop_m=0.38, step_m=0.001)
    )
    magnitude = np.abs(volume(point_capture(point_m), config))[:, 0, 0]
    near = magnitude[np.abs(config.z.values_m() - 0.29) < 0.01].max()
    lobe = magnitude[np.abs(config.z.values_m() - 0.352) < 0.01].max()
    assert 0.4 * near < lobe < near


@examples(6)
@given(point_m=anywhere())
def test_subvoxel_finds_a_point_anywhere_within_five_micrometres(point_m):
    # What is left of a voxel of 1 mm is the lobe's quartic term: 0.5 µm near the axis, 1.6 µm at
    # the corner (measured).
    config = BroadbandConfig(**around(point_m, half_m=0.004), subvoxel=True)
    capture = point_capture(point_m, config.tones_hz())
    depth = maximum_projection(strongest_voxels(volume(capture, config)), config, "broadband")
    assert abs(strongest_z_m(depth) - point_m[2]) < 5e-6


def test_subvoxel_moves_a_surface_by_less_than_half_a_voxel_and_towards_a_finer_grid():
    half_m = 0.01
    lateral = {axis: Axis(start_m=-half_m, stop_m=half_m, step_m=0.002) for axis in "xy"}
    fine = BroadbandConfig(**lateral, z=Axis(start_m=0.27, stop_m=0.29, step_m=0.0001))
    coarse = BroadbandConfig(**lateral, z=Axis(start_m=0.27, stop_m=0.29, step_m=0.002))
    between = coarse.model_copy(update={"subvoxel": True})
    capture = points_capture(surface_points(bumpy, half_m + 0.005, 0.0005), fine.tones_hz())
    whole = maximum_projection(strongest_voxels(volume(capture, coarse)), coarse, "broadband").z_m
    parabola = maximum_projection(
        strongest_voxels(volume(capture, between)), between, "broadband"
    ).z_m
    reference = maximum_projection(strongest_voxels(volume(capture, fine)), fine, "broadband").z_m
    assert np.nanmax(np.abs(parabola - whole)) <= 0.001
    # Whole voxels are off by 2 mm/√12 = 0.58 mm (measured: 0.50), the finer grid itself by 0.1
    # mm/√12 = 0.03 mm.
    assert np.sqrt(np.nanmean((whole - reference) ** 2)) > 0.4e-3
    assert np.sqrt(np.nanmean((parabola - reference) ** 2)) < 0.08e-3


@examples(50)
@given(offset=st.floats(-0.499, 0.499), width=st.floats(2, 100), scale=st.floats(1e-9, 1e9))
def test_offset_of_a_gaussian_lobe_is_exact(offset, width, scale):
    # In decibels a Gaussian is a parabola; what is left is rounding, amplified by the curvature
    # 1/width².
    voxels = np.array([-1.0, 0.0, 1.0])
    magnitude = scale * np.exp(-(((voxels - offset) / width) ** 2))
    assert peak_offset(magnitude) == pytest.approx(offset, abs=1e-13 * width**2 + 1e-12)


@examples(50)
@given(offset=st.floats(-0.5, 0.5), lobe_voxels=st.floats(3, 40))
def test_decibels_are_closer_than_amplitudes_on_a_band_limited_lobe(offset, lobe_voxels):
    magnitude = np.sinc((np.array([-1.0, 0.0, 1.0]) - offset) / lobe_voxels)
    before, middle, behind = magnitude
    by_amplitude = 0.5 * (before - behind) / (before - 2 * middle + behind)
    assert abs(peak_offset(magnitude) - offset) <= abs(by_amplitude - offset) + 1e-9


@examples(50)
@given(seed=st.integers(0, 9999), nz=st.integers(1, 6))
def test_peaks_say_all_that_a_projection_needs(seed, nz):
    generator = np.random.default_rng(seed)
    image = generator.normal(size=(nz, 4, 3)) + 1j * generator.normal(size=(nz, 4, 3))
    peaks = strongest_voxels(image.astype(np.complex64))
    z = Axis(start_m=0.3, stop_m=0.3 + 0.001 * (nz - 1), step_m=0.001)
    lateral = {
        "x": Axis(start_m=0, stop_m=0.002, step_m=0.001),
        "y": Axis(start_m=0, stop_m=0.003, step_m=0.001),
    }
    for subvoxel in (False, True):
        config = BroadbandConfig(**lateral, z=z, threshold_db=-200, subvoxel=subvoxel)
        depth = maximum_projection(peaks, config, "broadband")
        ends = (peaks.index == 0) | (peaks.index == nz - 1)
        assert np.array_equal(depth.wrapped, ends)
        assert np.array_equal(depth.z_m[ends], z.values_m()[peaks.index][ends])
        assert np.abs(depth.z_m - z.values_m()[peaks.index]).max() <= 0.0005 + 1e-12


def test_flat_and_empty_peaks_stay_on_their_voxels():
    magnitude = np.array([[1.0, 0.0, np.nan], [1.0, 0.0, 2.0], [1.0, 0.0, 1.0]])
    assert peak_offset(magnitude).tolist() == [0, 0, 0]
    config = BroadbandConfig(**around((0, 0), 0), subvoxel=True)
    depth = maximum_projection(Peaks(np.zeros((1, 1), int), np.ones((3, 1, 1))), config, "x")
    assert depth.z_m.tolist() == [[0.245]]
