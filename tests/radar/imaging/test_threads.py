"""Results do not depend on the number of threads."""

import numpy as np
import pytest

from handbench.radar.data.arrays import qar50
from handbench.radar.data.grid import VoxelGrid
from handbench.radar.imaging.api import image_points, project_volume
from handbench.radar.imaging.plan import fresh_plans
from handbench.radar.simulation.forward import Scatterers, simulate

pytestmark = pytest.mark.usefixtures("planned")

TONES_HZ, ALONG_M = np.linspace(70e9, 85e9, 6), 1e-3 * np.arange(40)
GRID = VoxelGrid(ALONG_M, ALONG_M, 0.25 + ALONG_M[:20])
POINTS_M = np.random.default_rng(1).uniform([-0.05, -0.05, 0.2], [0.05, 0.05, 0.3], (1000, 3))
FACETS = Scatterers(POINTS_M, np.ones(1000), np.tile([0.0, 0.6, -0.8], (1000, 1)))


@pytest.mark.parametrize("tolerance", [None, 1e-3])
def test_threads_change_no_bit_of_echoes_tones_and_projections(tolerance, monkeypatch):
    results = []
    for workers in ("1", "2", "5"):
        monkeypatch.setenv("HANDBENCH_WORKERS", workers)
        with fresh_plans():
            echoes = simulate(FACETS, TONES_HZ, qar50(), tolerance=tolerance)
            frame = echoes, TONES_HZ, qar50()
            tones = image_points(*frame, POINTS_M, tolerance, per_tone=True)
            results.append([echoes, tones, *project_volume(*frame, GRID, tolerance)])
    np.testing.assert_equal(results[1], results[0])
    np.testing.assert_equal(results[2], results[0])
