"""Numbers next to the points of a chart, placed so that they cover no point and no other number,
and no line if there is room."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes

SIZE_PT, DIGIT_PT = 8.0, 5.5  # of the font, and a digit's width
MARKER_PT, LEADER_PT = 4.0, 10  # half a marker; from where on a line leads to the point
CROSSED_PT = 6.0  # of distance that a crossed line is worth
RADII_PT, ANGLES_RAD = (
    (9, 13, 18, 24, 31, 39, 48, 58, 70, 84, 100),
    np.pi / 4 + np.arange(0, 2 * np.pi, np.pi / 12),
)
OFFSETS_PT = np.vstack(
    [radius * np.stack([np.cos(ANGLES_RAD), np.sin(ANGLES_RAD)], axis=1) for radius in RADII_PT]
)


def number_points(
    axis: Axes, points: np.ndarray, others: np.ndarray, lines: Sequence[np.ndarray]
) -> None:
    """Write 1, 2, … next to the points of a chart, where each number covers no point and no other
    number, if there is room, and crosses few lines.

    Args:
        axis: axes whose layout is final.
        points: [n, 2] in data coordinates.
        others: [m, 2], further points to keep free.
        lines: corners [k, 2] of each line that numbers avoid.
    """

    def places_pt(data: np.ndarray) -> np.ndarray:
        return axis.transData.transform(data) * 72 / axis.figure.dpi

    marks, crossed = (
        places_pt(np.vstack([points, others])),
        np.vstack([_along(places_pt(line)) for line in lines]),
    )
    low, high = axis.bbox.get_points() * 72 / axis.figure.dpi
    taken = np.zeros((0, 2, 2))  # the numbers' lower left and upper right corners
    for i, (at, value) in enumerate(zip(places_pt(points), points, strict=True), 1):
        half = np.array([DIGIT_PT * len(str(i)), SIZE_PT]) / 2
        cost = np.hypot(*OFFSETS_PT.T)
        for k, centre in enumerate(at + OFFSETS_PT):
            meets = (
                (np.abs(taken.mean(axis=1) - centre) < half + np.diff(taken, axis=1)[:, 0] / 2)
                .all(axis=1)
                .any()
            )
            outside = (centre - half < low).any() or (centre + half > high).any()
            blocked = (
                meets or outside or (np.abs(marks - centre) < half + MARKER_PT).all(axis=1).any()
            )
            cost[k] += (
                np.inf
                if blocked
                else CROSSED_PT * min((np.abs(crossed - centre) < half).all(axis=1).sum(), 3)
            )
        offset = OFFSETS_PT[cost.argmin()]
        taken = np.concatenate([taken, [[at + offset - half, at + offset + half]]])
        leader = {"arrowstyle": "-", "color": "0.5", "linewidth": 0.5, "shrinkA": 0, "shrinkB": 2}
        style: dict[str, Any] = {
            "arrowprops": leader if np.hypot(*offset) > LEADER_PT else None,
            "ha": "center",
            "va": "center",
        }
        text = axis.annotate(
            str(i), value, offset, textcoords="offset points", fontsize=SIZE_PT, zorder=5, **style
        )
        text.set_in_layout(False)


def _along(corners: np.ndarray) -> np.ndarray:
    """Return points [m, 2], at most 3 printer's points apart, along the lines that join the corners
    [k, 2]."""
    steps = [np.linspace(a, b, 2 + int(np.hypot(*(b - a)) / 3)) for a, b in pairwise(corners)]
    return np.vstack([corners, *steps])
