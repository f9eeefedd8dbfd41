"""Hard cases of the frame that a board's corners give: corners on a line, wrong ones, a board that is mirrored."""

from __future__ import annotations

from functools import partial
from itertools import product

import numpy as np

from bench.studies.stability.cases import Seen, Works, case, refusal
from groundtruth.sparse.frame import trimmed_similarity

SIGMA_M = 1e-4  # of a corner, per axis
GRID = np.array([[x, y, 0] for x in np.linspace(-0.1, 0.1, 5) for y in np.linspace(-0.07, 0.07, 4)])


@refusal("registration", "board corners on a line", "not on a line", unit="")
def board_line() -> Works:
    """Answer. Against: a refusal. Because: below a second extent of 2 % of the first the turn about the line stays
    open."""
    for width in (0.019, 1e-6, 1e-15, 0.0):
        points_m = GRID * [1, width, 1]
        yield f"{width:g} of its width", partial(trimmed_similarity, points_m, points_m, "board corners")


@case("registration", "one board corner in five wrong", "σ", 13.0)
def wrong_corners() -> Seen:
    """Root mean square of the others' error. Against: the similarity that made the corners. Because: corners lie within
    4 medians of the fit, the median within 2 of the majority's own, 1.54 σ: 12.3 σ."""
    for size_m, apart in product(np.logspace(-5, 4, 28), (True, False)):
        rng = np.random.default_rng(3)
        chosen = 5 * np.arange(4) if apart else np.arange(4)
        way = rng.standard_normal((4, 3)) if apart else np.array([[0.0, 0.0, 1.0]] * 4)
        source = GRID + SIGMA_M * rng.standard_normal(GRID.shape)
        source[chosen] += size_m * way / np.linalg.norm(way, axis=1, keepdims=True)
        matrix = trimmed_similarity(source, GRID, "board corners")[0]
        off_m = np.delete(GRID @ matrix[:3, :3].T + matrix[:3, 3] - GRID, chosen, axis=0)
        place = f"{'each its own way' if apart else 'a whole side'}, {size_m:.2g} m off"
        yield place, float(np.sqrt((off_m**2).sum(axis=1).mean()) / SIGMA_M)


@refusal("registration", "a board that is mirrored", "mirror image", unit="")
def mirrored_board() -> Works:
    """Answer. Against: a refusal that names it. Because: no rotation carries a solid to its mirror image, though most
    of its corners lie in a plane."""
    for height_m in (0.004, 0.02, 0.05, 0.2):  # twice as far off as that: 3 % of the extent and more are refused
        points_m = GRID + np.outer(np.arange(20) % 3 == 0, [0, 0, height_m])
        yield f"{height_m} m high", partial(trimmed_similarity, points_m * [1, 1, -1], points_m, "board corners")
