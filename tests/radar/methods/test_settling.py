"""Decisions that a tolerance leaves open. The reference is the volume summed exactly."""

import numpy as np
import pytest

from handbench.radar.data.grid import Axis
from handbench.radar.methods.projection import project
from handbench.radar.methods.projection_config import BroadbandConfig, NarrowbandConfig
from tests.radar.simulated_points import exact_capture

AXES = {
    "x": Axis(start_m=-0.02, stop_m=0.02, step_m=0.002),
    "y": Axis(start_m=-0.02, stop_m=0.02, step_m=0.002),
}


def clusters(random):
    """A few small targets far apart, about which an image's errors gather."""
    centres_m = random.uniform((-0.018, -0.018, 0.26), (0.018, 0.018, 0.31), (4, 1, 3))
    return (centres_m + random.uniform(-0.003, 0.003, (4, 12, 3))).reshape(-1, 3)


def speckle(random):
    """Scatterers at random in a slab, whose image has many voxels that are nearly equal."""
    return random.uniform((-0.02, -0.02, 0.27), (0.02, 0.02, 0.3), (300, 3))


BROADBAND, NARROWBAND = BroadbandConfig(**AXES, count=24), NarrowbandConfig(**AXES)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("config", "tolerance"),
    [
        (BROADBAND, 1e-3),
        (BROADBAND, 1e-2),
        (NARROWBAND, 1e-4),  # whose peaks are so flat that three voxels are equal
    ],
)
def test_a_tolerance_does_not_change_which_voxel_is_the_strongest(config, tolerance):
    for seed, made in enumerate((speckle, speckle, clusters)):
        points_m = made(np.random.default_rng(seed + 1))
        capture = exact_capture(points_m, config.tones_hz())
        exact = project(capture, config.model_copy(update={"tolerance": None}), "x")
        near = project(capture, config.model_copy(update={"tolerance": tolerance}), "x")
        assert np.array_equal(exact.z_m, near.z_m, equal_nan=True)
        assert np.isfinite(exact.z_m).sum() > 20
