"""Bundle adjustment and the board's frame where geometry tells little: photographs from one place,
plane scenes, wrong corners, a board that is seen from places that draw together.

Five photographs of loose points before a board of five markers, with seeded noise. A pose is judged
by its own standard deviation, which has to grow where the geometry tells less: of 340 normal
numbers one is beyond 4.8 σ once in 1800 times.
"""

import numpy as np
import pytest

from handbench.groundtruth.sparse.frame import board_from_model
from handbench.support.errors import HandbenchError
from tests.groundtruth.noisy_model import board_of, noisy_model, off_in_sigmas

KNOWN, FREE = 0, 8  # parameters of the lens that are adjusted too


@pytest.mark.parametrize("free", [KNOWN, FREE], ids=["known", "free"])
@pytest.mark.parametrize(
    ("spread", "depth", "seed"),
    [(1e-2, 1, 0), (1e-8, 1, 0), (0, 1, 0), (1, 1e-5, 0), (1, 0, 0), (0, 0, 1), (0, 0, 2)],
)
def test_places_that_draw_together_and_planes_say_how_far_they_are_off(spread, depth, seed, free):
    """The board holds the poses though no point has a depth; before a plane, distance and focal
    length trade."""
    scene = noisy_model(seed, spread=spread, depth=depth, shared=True)
    assert off_in_sigmas(scene, free) < 4.8


@pytest.mark.parametrize("size_px", [0.3, 3.0, 100.0])
def test_misread_corners_of_a_marker_in_five_pull_no_further_than_their_weight(size_px):
    """With Cauchy's weights a wrong number pulls by 1.2 σ at most: 4 of them beside 16 add 0.36 to
    the variance."""
    scene, rng = noisy_model(shared=True), np.random.default_rng(7)
    for corners in scene.corners.values():
        for k in range(4):
            way = rng.standard_normal(2)
            corners[4, k] = corners[4, k] + size_px * way / np.linalg.norm(way)
    assert off_in_sigmas(scene) < 4.8 * (1 + 4 * 1.2**2 / 16) ** 0.5


@pytest.mark.parametrize("spread", [1, 0.3, 0.1, 0.03, 0.01, 1e-3, 1e-6, 0])
def test_a_board_seen_from_places_that_draw_together_has_the_right_scale_or_none(spread):
    """σ = stated residual over the root of the corners' squared extents, at most: all errors lie
    along one axis. Without a base no corner has a depth: the board is missed by over 3 %."""
    scene = noisy_model(spread=spread, off=0.0, shared=True)
    extent_m = np.concatenate(list(scene.corners_m.values()))
    lever_m = np.sqrt(((extent_m - extent_m.mean(axis=0)) ** 2).sum())
    try:
        matrix, scale = board_from_model(scene.model, scene.corners, board_of(scene.corners_m))
    except HandbenchError as error:
        assert spread < 0.1 and "board corners" in str(error)
    else:
        factor = np.cbrt(np.linalg.det(matrix[:3, :3]))
        assert spread > 1e-3 and abs(factor - 1) * lever_m / scale.residual_m < 5
