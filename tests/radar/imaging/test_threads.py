"""Images do not depend on the number of threads."""

import numpy as np
import pytest

from handbench.radar.data.arrays import qar50
from handbench.radar.data.grid import VoxelGrid
from handbench.radar.imaging.api import image_points, project_volume
from handbench.radar.imaging.plan import fresh_plans
from tests.radar.samples import noise

pytestmark = pytest.mark.usefixtures("planned")


@pytest.mark.parametrize("tolerance", [None, 1e-3])
def test_threads_change_no_bit_of_tones_and_projections(tolerance, monkeypatch):
    along_m, results = 1e-3 * np.arange(40), []
    grid = VoxelGrid(along_m, along_m, 0.25 + along_m[:20])
    frame = noise((6, 94, 94)), np.linspace(70e9, 85e9, 6), qar50()
    points_m = np.random.default_rng(1).uniform([-0.05, -0.05, 0.2], [0.05, 0.05, 0.3], (1000, 3))
    for workers in ("1", "2", "5"):
        monkeypatch.setenv("HANDBENCH_WORKERS", workers)
        with fresh_plans():
            tones = image_points(*frame, points_m, tolerance, per_tone=True)
            results.append([tones, *project_volume(*frame, grid, tolerance)])
    np.testing.assert_equal(results[1], results[0])
    np.testing.assert_equal(results[2], results[0])
