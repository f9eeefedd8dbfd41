"""Hard cases of the frame that a board's corners give: corners on a line, wrong ones, a board that is mirrored."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from bench.studies.stability.cases import Refused, Worst, case, refused_throughout, worst
from groundtruth.sparse.frame import trimmed_similarity

SIGMA_M = 1e-4  # of a corner, per axis
GRID = np.array([[x, y, 0] for x in np.linspace(-0.1, 0.1, 5) for y in np.linspace(-0.07, 0.07, 4)])


@case(
    "registration",
    "board corners on a line",
    quantity="answer",
    reference="a refusal",
    unit="",
    bound=0.0,
    reason="below a second extent of 2 % of the first the turn about the line stays open",
)
def board_line() -> Refused | Worst:
    boards = {f"{width:g} of its width": GRID * [1, width, 1] for width in (0.019, 1e-6, 1e-15, 0.0)}
    return refused_throughout(
        {name: lambda p=p: trimmed_similarity(p, p, "board corners") for name, p in boards.items()}, "not on a line"
    )


@case(
    "registration",
    "one board corner in five wrong",
    quantity="root mean square of the others' error",
    reference="the similarity that made the corners",
    unit="σ",
    bound=13.0,
    reason="corners lie within 4 medians of the fit, the median within 2 of the majority's own, 1.54 σ: 12.3 σ",
)
def wrong_corners() -> Worst:
    def seen() -> Iterable[tuple[str, float]]:
        for size_m in np.logspace(-5, 4, 28):
            for apart in (True, False):
                rng = np.random.default_rng(3)
                chosen = 5 * np.arange(4) if apart else np.arange(4)
                way = rng.standard_normal((4, 3)) if apart else np.array([[0.0, 0.0, 1.0]] * 4)
                source = GRID + SIGMA_M * rng.standard_normal(GRID.shape)
                source[chosen] += size_m * way / np.linalg.norm(way, axis=1, keepdims=True)
                matrix = trimmed_similarity(source, GRID, "board corners")[0]
                off_m = np.delete(GRID @ matrix[:3, :3].T + matrix[:3, 3] - GRID, chosen, axis=0)
                place = f"{'each its own way' if apart else 'a whole side'}, {size_m:.2g} m off"
                yield place, float(np.sqrt((off_m**2).sum(axis=1).mean()) / SIGMA_M)

    return worst(seen())


@case(
    "registration",
    "a board that is mirrored",
    quantity="answer",
    reference="a refusal that names it",
    unit="",
    bound=0.0,
    reason="no rotation carries a solid to its mirror image, though most of its corners lie in a plane",
)
def mirrored_board() -> Refused | Worst:
    heights_m = (0.004, 0.02, 0.05, 0.2)  # twice as far off as that: 3 % of the extent and more are refused
    solids = {h: GRID + np.outer(np.arange(20) % 3 == 0, [0, 0, h]) for h in heights_m}
    return refused_throughout(
        {f"{h} m high": lambda p=p: trimmed_similarity(p * [1, 1, -1], p, "board corners") for h, p in solids.items()},
        "mirror image",
    )
