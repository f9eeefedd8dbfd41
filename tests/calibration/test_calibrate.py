"""The whole calibration: a cloud and echoes of one target to `radar_from_photo`."""

from __future__ import annotations

import numpy as np
import pytest

from handbench.calibration.registration.register import common_covariance, measure, solve
from tests.calibration.seen_target import search_coarsely
from tests.calibration.spheres.test_balls import capture, centres
from tests.calibration.spheres.test_spheres import scene


@pytest.mark.slow
def test_a_cloud_and_echoes_give_the_transform(rng, target, monkeypatch):
    """0.1 mm at every element: spheres are good for 0.02 mm, balls for 0.03 mm each."""
    search_coarsely(monkeypatch)
    points_m, normals, photo_m = scene(rng, target, 0.35)
    radar_m = centres(rng, target)
    echoes = capture(rng, target, radar_m, (0, 1, 2, 3, 4), None)
    pairs, common_m2 = measure(points_m, normals, echoes, target)
    found = solve(pairs, common_m2=common_m2)
    miss_m = found.points(photo_m) - radar_m
    assert np.linalg.norm(miss_m, axis=1).max() < 1e-4
    assert len(found.residuals_m) == 5
    assert found.residuals_m.max() < 1e-4
    predicted_m = np.sqrt(np.diagonal(found.point_covariance(radar_m), axis1=1, axis2=2))
    assert (np.abs(miss_m) < 4 * predicted_m).all()
    shared_m = np.sqrt(common_covariance(target)[2, 2])
    assert (
        predicted_m[:, 2] > shared_m
    ).all()  # what the foam may differ by shows in no residual, yet is counted
    assert (predicted_m[:, :2] < 1e-4).all()


def test_what_all_centres_share_lies_along_z(target):
    """∂/∂ε of (√ε − 1)·(R − a) for the deepest ball: 0.003 of 20 mm over 2√1.03 is 0.0296 mm; and
    0.062 pixel."""
    foam_m, seen_m = 0.003 * 0.020 / (2 * np.sqrt(1.03)), 0.062 * 6e-4
    np.testing.assert_allclose(common_covariance(target), np.diag([0, 0, foam_m**2]), atol=1e-18)
    np.testing.assert_allclose(
        common_covariance(target, 6e-4), np.diag([0, 0, foam_m**2 + seen_m**2]), atol=1e-18
    )
