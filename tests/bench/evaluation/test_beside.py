"""What lies beside a surface, and how far the nearest point is: against scipy, which shares no code with either."""

import numpy as np
import pytest
from scipy.ndimage import binary_dilation, binary_fill_holes
from scipy.spatial import KDTree

from bench.evaluation.depth_errors import beside
from radar.support.rays import nearest_m


@pytest.mark.parametrize("share", [0.0, 0.3, 0.5, 0.62, 0.9, 1.0])
def test_pixels_beside_a_mask_are_those_of_scipy(share):
    rng = np.random.default_rng(7)
    for shape in ((1, 1), (2, 9), (40, 31), (60, 60)):
        covered = rng.random(shape) < share
        assert (beside(covered) == ~binary_dilation(binary_fill_holes(covered), np.ones((3, 3)))).all()


def test_a_spiral_s_inside_is_beside_it_and_a_ring_s_is_not():
    ring = np.zeros((9, 9), bool)
    ring[2:7, 2:7] = True
    ring[3:6, 3:6] = False
    assert not beside(ring)[4, 4] and beside(ring)[0, 0]
    opened = np.kron(ring, np.ones((5, 5), bool))
    opened[22, 25:] = False  # a gap in the ring's wall
    assert beside(opened)[22, 22]


def test_nearest_distances_are_those_of_scipy():
    rng = np.random.default_rng(3)
    points_m, among_m = rng.random((300, 3)), rng.random((200, 3)) + 1e3  # double precision: 1e-13 of 1 km
    assert np.abs(nearest_m(points_m, among_m) - KDTree(among_m).query(points_m)[0]).max() < 1e-9
    assert (nearest_m(points_m, among_m[:0]) == np.inf).all() and nearest_m(points_m[:0], among_m).shape == (0,)
