"""Results do not depend on the number of threads."""

import numpy as np
import pytest

from handbench.radar.data.arrays import qar50
from handbench.radar.data.grid import VoxelGrid
from handbench.radar.imaging.api import project_volume
from handbench.radar.imaging.plan import fresh_plans
from handbench.radar.simulation.forward import Scatterers, simulate
from tests.radar.exact import tone_images

pytestmark = pytest.mark.usefixtures("planned")

TONES_HZ, ALONG_M = np.linspace(70e9, 85e9, 6), 1e-3 * np.arange(40)
POINTS_M = np.random.default_rng(1).uniform([-0.05, -0.05, 0.2], [0.05, 0.05, 0.3], (3000, 3))


@pytest.mark.parametrize("tolerance", [None, 1e-3])
def test_threads_change_no_bit_of_echoes_tones_and_projections(tolerance, monkeypatch):
    grid, found = VoxelGrid(ALONG_M, ALONG_M, 0.25 + ALONG_M[:20]), []
    facets = Scatterers(POINTS_M, np.ones(3000), np.tile([0.0, 0.6, -0.8], (3000, 1)))
    for workers in ("1", "2", "5"):
        monkeypatch.setenv("HANDBENCH_WORKERS", workers)
        with fresh_plans():
            echoes = simulate(facets, TONES_HZ, qar50(), tolerance=tolerance)
            tones = tone_images(echoes, TONES_HZ, qar50(), POINTS_M)
            peaks = project_volume(echoes, TONES_HZ, qar50(), grid, tolerance)
        found.append((echoes, tones, *peaks))
    for others in found[1:]:
        for a, b in zip(found[0], others, strict=True):
            np.testing.assert_array_equal(a, b)
