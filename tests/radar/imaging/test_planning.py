"""Plans are made where they cost less than the exact sum."""

import numpy as np
import pytest

from handbench.radar.data.arrays import qar50
from handbench.radar.data.grid import VoxelGrid
from handbench.radar.imaging.api import image_points, project_volume
from tests.radar.direct_sums import direct_sum
from tests.radar.samples import noise, relative_error
from tests.refusals import refuse


@pytest.mark.parametrize("points, exact", [(200, True), (2000, False)])
def test_few_points_are_summed_exactly_and_many_planned(points, exact):
    """On 60 mm × 60 mm at two tones: the plan of the leaves costs as much as the exact sums of 40
    images of 200 points, or of 4 of 2000. The direct sum in float64 is met by float32 to 1e-5, by a
    plan to its tolerance."""
    x_m, y_m = np.random.default_rng(0).uniform(-0.03, 0.03, (2, points))
    points_m = np.stack([x_m, y_m, 0.3 + 0.2 * x_m], axis=1)
    tones_hz, samples = np.array([72e9, 82e9]), noise((2, 94, 94))
    image = image_points(samples, tones_hz, qar50(), points_m, 1e-2)
    error = relative_error(image[:50], direct_sum(samples, tones_hz, qar50(), points_m[:50]))
    assert (error < 1e-5) == exact
    assert error < 1e-2


def test_an_axis_that_takes_minutes_to_plan_is_refused():
    grid = VoxelGrid(np.zeros(1), np.linspace(-0.1, 0.1, 2001), np.array([0.3, 0.31]))
    samples, tones_hz = noise((2, 94, 94)), np.array([72e9, 82e9])
    refuse(lambda: project_volume(samples, tones_hz, qar50(), grid, 1e-3), "2001 samples along y")
