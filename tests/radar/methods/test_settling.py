"""Decisions that a tolerance leaves open. The reference is the volume summed exactly."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from radar.data.arrays import qar50
from radar.data.capture import RadarCapture
from radar.data.grid import Axis
from radar.imaging.peaks import Peaks, strongest_voxels
from radar.methods.projection import project
from radar.methods.projection_config import BroadbandConfig, NarrowbandConfig
from radar.methods.settling import settled
from radar.simulation.forward import Scatterers, simulate

AXES = {"x": Axis(start_m=-0.02, stop_m=0.02, step_m=0.002), "y": Axis(start_m=-0.02, stop_m=0.02, step_m=0.002)}


def speckle(config, seed):
    """A capture of many scatterers at random in a slab, whose image has many voxels that are nearly alike."""
    random = np.random.default_rng(seed)
    points_m = random.uniform((-0.02, -0.02, 0.27), (0.02, 0.02, 0.3), (300, 3))
    tones_hz = config.tones_hz()
    echoes = simulate(Scatterers(points_m, np.ones(300)), tones_hz, qar50(), tolerance=None)
    return RadarCapture(echoes[None], tones_hz, qar50())


BROADBAND, NARROWBAND = BroadbandConfig(**AXES, count=24), NarrowbandConfig(**AXES)


@pytest.mark.parametrize(
    ("config", "tolerance"),
    [(BROADBAND, 1e-3), (BROADBAND, 1e-2), (NARROWBAND, 1e-4)],  # whose peaks are so flat that three voxels are alike
)
def test_a_tolerance_does_not_change_which_voxel_is_the_strongest(config, tolerance):
    for seed in range(3):
        capture = speckle(config, seed)
        exact = project(capture, config.model_copy(update={"tolerance": None}), "x")
        near = project(capture, config.model_copy(update={"tolerance": tolerance}), "x")
        assert np.array_equal(exact.z_m, near.z_m, equal_nan=True)
        assert np.isfinite(exact.z_m).sum() > 50


@given(seed=st.integers(0, 2**32 - 1), depths=st.integers(1, 6))
def test_peaks_settle_on_those_of_the_exact_volume(seed, depths):
    """Volumes of few different heights, so that ties and near ties are many; errors are as large as SURE allows for."""
    random = np.random.default_rng(seed)
    exact = random.integers(1, 6, (depths, 4, 5)) + random.uniform(-0.01, 0.01, (depths, 4, 5))
    off = exact + random.uniform(-0.02, 0.02, exact.shape)
    expected = strongest_voxels(exact.astype(np.complex64))
    floor_db = -20 * np.log10(2.5)
    before = strongest_voxels(off.astype(np.complex64))._replace(error=0.01)
    found = settled(before, floor_db, depths, lambda pixel, at: exact.reshape(depths, -1)[at, pixel])
    seen = expected.magnitude[1] >= expected.magnitude[1].max() * 10 ** (floor_db / 20)
    assert np.array_equal(found.magnitude[1] >= found.magnitude[1].max() * 10 ** (floor_db / 20), seen)
    two = (np.sort(exact, axis=0)[-3:].max(axis=0) - np.sort(exact, axis=0)[-3:].min(axis=0) > 0.1) | (depths < 3)
    assert np.array_equal(found.index[seen & two], expected.index[seen & two])


def test_an_exact_volume_is_left_alone():
    """No image is asked for."""
    peaks = strongest_voxels(np.ones((2, 2, 2), np.complex64))
    assert settled(peaks, -13.0, 2, None) is peaks
    assert isinstance(peaks, Peaks)
