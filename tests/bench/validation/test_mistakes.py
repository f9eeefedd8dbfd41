"""Depth maps beside planes, whose mirror images are known: the formula of a tilted plane is the
reference."""

import numpy as np
import pytest

from handbench.bench.validation import mistakes
from handbench.groundtruth.mesh.surface import Surface
from handbench.radar.data.depthmap import DepthMap

HALF_M, MIDDLE_M, SLOPE = (
    0.043,
    0.45,
    0.048,
)  # of y: 73 % of a plate lie within 3 mm of its mirror image, 2.1 mm off


def plate(slope: float) -> Surface:
    x_m, y_m = HALF_M * np.array([(-1, 1, 1, -1), (-1, -1, 1, 1)])
    vertices_m = np.stack([x_m, y_m, MIDDLE_M + slope * y_m], axis=1)
    return Surface(vertices_m, np.array([[0, 2, 1], [0, 3, 2]]), np.zeros(4), np.ones(4, bool))


def plate_map(slope: float, off_m: float = 0.0, noise_m: float = 1e-4) -> DepthMap:
    axis_m = np.arange(-40, 41) * 1e-3
    z_m = MIDDLE_M + off_m + np.broadcast_to(slope * axis_m[:, None], (81, 81))
    random = np.random.default_rng(5)
    z_m = z_m + noise_m * random.standard_normal(z_m.shape)
    return DepthMap(axis_m, axis_m, z_m, random.uniform(-10, 0, z_m.shape), "3fsk")


def test_a_slight_tilt_shows_a_mirrored_axis_by_its_error_where_most_pixels_lie_near():
    depth = plate_map(SLOPE)
    as_is = mistakes.fit(depth, plate(-SLOPE))
    assert (
        as_is.share == pytest.approx(3e-3 / (2 * SLOPE * 0.04), abs=0.05)
        and as_is.share > 1 / mistakes.GAINED
    )
    [found] = mistakes.misplacement_warnings(depth, plate(-SLOPE))
    assert "mirrored in y" in found and "mirrored in x" not in found


@pytest.mark.parametrize(
    "depth",
    [
        plate_map(SLOPE),
        plate_map(SLOPE, off_m=1.5e-3),
        plate_map(0.02, off_m=2e-3),
        plate_map(SLOPE, noise_m=3e-3),
    ],
    ids=["right", "1.5 mm behind", "2 mm behind and flatter", "noise of 3 mm"],
)
def test_a_plate_that_is_right_but_for_its_errors_is_not_doubted(depth):
    assert mistakes.misplacement_warnings(depth, plate(SLOPE)) == []
