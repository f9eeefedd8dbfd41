"""Decisions that a tolerance leaves open. The reference is the volume summed exactly."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from handbench.radar.data.arrays import qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.grid import Axis
from handbench.radar.imaging.peaks import Peaks, strongest_voxels
from handbench.radar.methods.projection import project, settle_peaks
from handbench.radar.methods.projection_config import BroadbandConfig, NarrowbandConfig
from handbench.radar.simulation.forward import Scatterers, simulate

AXES = {
    "x": Axis(start_m=-0.02, stop_m=0.02, step_m=0.002),
    "y": Axis(start_m=-0.02, stop_m=0.02, step_m=0.002),
}


def clusters(config, seed):
    """A capture of a few small targets far apart, about which an image's errors gather."""
    random = np.random.default_rng(seed)
    centres_m = random.uniform((-0.018, -0.018, 0.26), (0.018, 0.018, 0.31), (4, 1, 3))
    points_m = (centres_m + random.uniform(-0.003, 0.003, (4, 12, 3))).reshape(-1, 3)
    tones_hz = config.tones_hz()
    echoes = simulate(
        Scatterers(points_m, np.ones(len(points_m))), tones_hz, qar50(), tolerance=None
    )
    return RadarCapture(echoes[None], tones_hz, qar50())


def speckle(config, seed):
    """A capture of many scatterers at random in a slab, whose image has many voxels that are nearly
    alike."""
    random = np.random.default_rng(seed)
    points_m = random.uniform((-0.02, -0.02, 0.27), (0.02, 0.02, 0.3), (300, 3))
    tones_hz = config.tones_hz()
    echoes = simulate(Scatterers(points_m, np.ones(300)), tones_hz, qar50(), tolerance=None)
    return RadarCapture(echoes[None], tones_hz, qar50())


BROADBAND, NARROWBAND = BroadbandConfig(**AXES, count=24), NarrowbandConfig(**AXES)


@pytest.mark.parametrize(
    ("config", "tolerance"),
    [
        (BROADBAND, 1e-3),
        (BROADBAND, 1e-2),
        (NARROWBAND, 1e-4),
    ],  # whose peaks are so flat that three voxels are alike
)
def test_a_tolerance_does_not_change_which_voxel_is_the_strongest(config, tolerance):
    for capture in (*(speckle(config, seed) for seed in range(3)), clusters(config, 3)):
        exact = project(capture, config.model_copy(update={"tolerance": None}), "x")
        near = project(capture, config.model_copy(update={"tolerance": tolerance}), "x")
        assert np.array_equal(exact.z_m, near.z_m, equal_nan=True)
        assert np.isfinite(exact.z_m).sum() > 20


@given(seed=st.integers(0, 2**32 - 1), depths=st.integers(1, 6), error=st.sampled_from([0.01, 2.0]))
def test_peaks_settle_on_those_of_the_exact_volume(seed, depths, error):
    """Two voxels of each pixel, and pixels among each other, are nearly alike; errors are as large
    as SURE allows."""
    random = np.random.default_rng(seed)
    heights = random.permuted(
        np.broadcast_to(np.arange(1, depths + 1)[:, None], (depths, 20)), axis=0
    )
    twins = random.integers(0, depths, (2, 20))
    heights[twins[0], np.arange(20)] = heights[twins[1], np.arange(20)]
    exact = (heights + random.uniform(-0.01, 0.01, heights.shape)).reshape(depths, 4, 5)
    off = exact + random.uniform(-0.02, 0.02, exact.shape)
    floor_db = 20 * np.log10(0.5)
    before = replace(strongest_voxels(off.astype(np.complex64)), error=error)
    found = settle_peaks(
        before, floor_db, lambda pixel, at: exact.reshape(depths, -1)[at, pixel], depths
    )
    expected = strongest_voxels(exact.astype(np.complex64))
    seen, of_found = (
        peaks.magnitude[1] >= peaks.magnitude[1].max() * 0.5 for peaks in (expected, found)
    )
    assert np.array_equal(of_found, seen)
    assert np.array_equal(found.index[seen], expected.index[seen])
    moved = found.index != before.index
    np.testing.assert_allclose(found.magnitude[:, moved], expected.magnitude[:, moved], rtol=1e-6)


def test_an_exact_volume_is_left_alone():
    """No image is asked for."""
    peaks = strongest_voxels(np.ones((2, 2, 2), np.complex64))
    assert settle_peaks(peaks, -13.0, None) is peaks
    assert isinstance(peaks, Peaks)
