"""The whole calibration: a cloud and echoes of one target to `radar_from_photo`."""

from __future__ import annotations

import numpy as np
from test_balls import capture, centres
from test_spheres import scene

from calibration.echoes import common_covariance
from calibration.registration import calibrate


def test_a_cloud_and_echoes_give_the_transform(rng, target):
    """0.1 mm at every element: spheres are good for 0.02 mm, balls for 0.03 mm each."""
    points_m, normals, photo_m = scene(rng, target, 0.35)
    radar_m = centres(rng, target)
    found = calibrate(points_m, normals, capture(rng, target, radar_m, (0, 1, 2, 3, 4), None), target)
    miss_m = found.points(photo_m) - radar_m
    assert np.linalg.norm(miss_m, axis=1).max() < 1e-4
    assert len(found.residuals_m) == 5
    assert found.residuals_m.max() < 1e-4
    predicted_m = np.sqrt(np.diagonal(found.point_covariance(radar_m), axis1=1, axis2=2))
    assert (np.abs(miss_m) < 4 * predicted_m).all()
    shared_m = np.sqrt(common_covariance(target, np.array([77e9]))[2, 2])
    assert (predicted_m[:, 2] > shared_m).all()  # what creeps round the balls shows in no residual, yet is counted
    assert (predicted_m[:, :2] < 1e-4).all()
