"""Drawing of the calibration target at true scale, for its manufacture: views, dimensions, parts
list and drilling template.

The front view shows the target from the radar, so that x grows to the left. The side view is from
the viewer's right, with the radar on its left (third-angle projection). The front view is also the
template for the carrier.
"""

import textwrap
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from handbench.reports.drawings.sheets import GREY, Drawing, line, sheets, usable_mm

if TYPE_CHECKING:
    from handbench.calibration.spheres.description import Target

MILLIMETRES = 1e3
EDGE_MM = 0.5  # outlines have a width
BAND_MM = 11.0  # beneath the views, and between them: the ordinates
TEXT_MM = 2.9  # distance of two lines of text
TABLE_MM, TABLE_GAP_MM = 41.0, 5.0
SAME_MM = 0.005  # ordinates closer than that are one
CLEAR = {"facecolor": "white", "edgecolor": "none", "pad": 0.6}  # behind numbers
NOTES = (
    "Front view: seen from the radar, x to the left. Side view: from the right, the radar on its "
    "left.",
    "Hole: depth from behind (+z), along z, as wide as the ball. Push the ball to its ground: "
    "its centre is then "
    "the sphere's. Close it with a plug of the same foam.",
    "Template: lay the front view on the carrier, prick the crosses, glue the spheres there. "
    "Spacer: its length, "
    "between carrier and sphere.",
    "Speckle plain foam, matt, 0.5 to 3 mm, for the photographs.",
)


def target_sheets(target: "Target", title: str, paper: str) -> list[Figure]:
    """Return the printable sheets of the calibration target (metal balls in foam spheres) at true
    scale.
    They show front and side view and the list of parts, on one sheet if they fit next to each
    other. title: printed on each sheet; paper: a name in PAPERS_MM, or "fit" for one sheet as large
    as needed. Raises HandbenchError for an unknown paper."""
    views, table = _Views(target), _parts(target)
    width, depth, height = views.high_mm - views.low_mm
    note = (
        f"{len(target.element)} elements, {width:.1f} × {height:.1f} × {depth:.1f} mm, 1:1; "
        "front view seen from the radar"
    )
    both = views.width_mm + TABLE_GAP_MM + TABLE_MM
    list_mm = TEXT_MM * (len(table) + 1)
    height_mm = max(views.height_mm, list_mm)

    def paint(axes: Axes) -> None:
        views.paint(axes)
        _write(axes, table, views.width_mm + TABLE_GAP_MM, height_mm)

    if both <= usable_mm(paper)[0]:
        return sheets([Drawing(both, height_mm, title, note, paint)], paper)
    apart = Drawing(TABLE_MM, list_mm, title, note, lambda axes: _write(axes, table, 0.0, list_mm))
    return sheets(
        [Drawing(views.width_mm, views.height_mm, title, note, views.paint), apart], paper
    )


class _Views:
    """Front and side view of the calibration target with their dimensions.
    Centres are stored as [n, 3] in mm, with columns for directions on the page: to the right in the
    front view (−x), to the right in the side view (z), and up (y)."""

    def __init__(self, target: "Target") -> None:
        self.centres_mm = MILLIMETRES * target.centres_m[:, [0, 2, 1]] * (-1, 1, 1)
        self.foam_mm = MILLIMETRES * np.array([e.sphere_radius_m for e in target.element])
        self.ball_mm = MILLIMETRES * np.array([e.ball_radius_m for e in target.element])
        self.low_mm = (self.centres_mm - self.foam_mm[:, None]).min(axis=0)
        self.high_mm = (self.centres_mm + self.foam_mm[:, None]).max(axis=0)
        width, depth, height = self.high_mm - self.low_mm
        self.side_mm = EDGE_MM + width + BAND_MM  # where the side view begins
        self.width_mm = float(self.side_mm + depth + EDGE_MM)
        self.height_mm = float(BAND_MM + height + EDGE_MM)
        # What is added to a centre: the front view's place on the drawing, and the side view's.
        self.front = np.array([EDGE_MM, BAND_MM]) - self.low_mm[[0, 2]]
        self.side = np.array([self.side_mm, BAND_MM]) - self.low_mm[[1, 2]]

    def paint(self, axes: Axes) -> None:
        """Draw both views on axes in mm: first the lines to the dimensions, so that they are in the
        background, then spheres, balls, numbers and, dashed, the drilled holes."""
        self._ordinates(axes)
        for columns, place in (([0, 2], self.front), ([1, 2], self.side)):
            points_mm = self.centres_mm[:, columns] + place
            for centre_mm, foam_mm, ball_mm in zip(
                points_mm, self.foam_mm, self.ball_mm, strict=True
            ):
                axes.add_patch(Circle(centre_mm, foam_mm, fill=False, lw=0.7))
                axes.add_patch(Circle(centre_mm, ball_mm, fc="0.88", ec="black", lw=0.5))
                for along in np.eye(2):
                    line(
                        axes,
                        *np.transpose(
                            [centre_mm - (ball_mm + 1) * along, centre_mm + (ball_mm + 1) * along]
                        ),
                    )
            self._numbers(axes, points_mm)
        for (_, z, y), foam_mm, ball_mm in zip(
            self.centres_mm, self.foam_mm, self.ball_mm, strict=True
        ):
            # The drilled hole, from the ball's far end to the sphere's back.
            ground, back = z - ball_mm + self.side[0], z + foam_mm + self.side[0]
            sides = y + self.side[1] + ball_mm * np.array([-1, -1, 1, 1])
            line(axes, [back, ground, ground, back], sides, 0.4, dashed=True)

    def _numbers(self, axes: Axes, points_mm: np.ndarray) -> None:
        """Write the number of each element (a ball with its foam sphere) next to its ball, on the
        target's outer side if there is room.
        points_mm [n, 2]: the centres in this view."""
        # half sizes
        taken = [
            (point, np.full(2, ball)) for point, ball in zip(points_mm, self.ball_mm, strict=True)
        ]
        for members in _coincident(points_mm):
            i, text = members[0], ", ".join(str(member + 1) for member in members)
            outward = np.arctan2(*(points_mm[i] - points_mm.mean(axis=0))[::-1])
            angles = outward + np.pi / 6 * np.array([0, 1, -1, 2, -2, 3, -3, 4, -4, 5, -5, 6])
            half = np.array([1.1 * len(text), 1.7])
            ring = [
                points_mm[i] + (self.ball_mm[i] + far) * np.array([np.cos(angle), np.sin(angle)])
                for far in (4, 8, 12, 16)
                for angle in angles
            ]
            place = next(
                (p for p in ring if all((np.abs(p - q) > half + r).any() for q, r in taken)),
                ring[0],
            )
            taken.append((place, half))
            axes.text(*place, text, ha="center", va="center", fontsize=9, weight="bold", bbox=CLEAR)

    def _ordinates(self, axes: Axes) -> None:
        """Draw the dimensions: the distance in mm of each centre from the planes x = 0, y = 0 and z
        = 0, with a thin line from the centre to its number at the edge of the view."""
        ends = (
            (0, self.front[0], "← x", self.low_mm[0]),
            (1, self.side[0], "z →", self.high_mm[1]),
        )
        for column, place, name, end in ends:
            for value, shown in self._spread(column):
                top = self._members(column, value)[:, 2].max() + self.front[1]
                line(axes, [value + place] * 2, [BAND_MM - 1.5, top], color=GREY)
                line(axes, [value + place, shown + place], [BAND_MM - 1.5, BAND_MM - 3], color=GREY)
                text = _mm(value if column else -value)
                axes.text(shown + place, BAND_MM - 3.4, text, rotation=90, ha="center", va="top")
            axes.text(end + place, 0.5, name, ha="right" if column else "left")
        right = self.side_mm - 0.5
        left = right - BAND_MM + 2.5
        for value, shown in self._spread(2):
            members, y = self._members(2, value), value + self.front[1]
            line(axes, [members[:, 0].min() + self.front[0], left - 1], [y, y], color=GREY)
            line(axes, [left - 1, left], [y, shown + self.front[1]], color=GREY)
            line(axes, [right, members[:, 1].max() + self.side[0]], [y, y], color=GREY)
            axes.text(left + 0.4, shown + self.front[1], _mm(value), ha="left", va="center")
        axes.text(left + 3, self.height_mm - 3, "y ↑", ha="center")

    def _members(self, column: int, value: float) -> np.ndarray:
        """Return the centres [n, 3] in mm that have a given value in one column. If there are none,
        return the point of the drawn area that is nearest to the origin of the frame, [1, 3]."""
        members = self.centres_mm[np.abs(self.centres_mm[:, column] - value) < SAME_MM]
        return members if len(members) else np.clip(np.zeros((1, 3)), self.low_mm, self.high_mm)

    def _spread(self, column: int) -> Iterator[tuple[float, float]]:
        """Yield each different coordinate in one column of the centres, mm, with the position of
        its number on the page.
        Zero is included if it is inside the view. Positions are at least one line of text apart
        (TEXT_MM), so that numbers do not overlap."""
        zero = [0.0] if self.low_mm[column] < 0 < self.high_mm[column] else []
        values = np.sort([*self.centres_mm[:, column], *zero])
        values = values[np.diff(values, prepend=-np.inf) > SAME_MM]
        shown = values.copy()
        for i in range(1, len(shown)):
            shown[i] = max(shown[i], shown[i - 1] + TEXT_MM)
        yield from zip(values, shown, strict=True)


def _parts(target: "Target") -> list[Sequence[str]]:
    """Return the list of parts, each line as its cells or as one text: coordinates, diameters,
    lengths of holes and spacers in mm, materials, and notes for building the target."""
    e = target.element
    back_m = max(one.centre_m[2] + one.sphere_radius_m for one in e)
    radii_m = [(one.centre_m[2], one.sphere_radius_m, one.ball_radius_m) for one in e]
    sizes_m = [(2 * R, 2 * r, R + r, back_m - z - R) for z, R, r in radii_m]
    return [
        ("Coordinates of the centres, mm",),
        ("no", "x", "y", "z"),
        *_rows([one.centre_m for one in e]),
        ("",),
        ("Diameters, hole, spacer, mm",),
        ("no", "foam", "ball", "hole", "spacer"),
        *_rows(sizes_m),
        ("",),
        (f"Foam: relative permittivity {target.foam_permittivity:g}",),
        ("Balls: steel",),
        *((text,) for note in NOTES for text in ("", *textwrap.wrap(note, 37))),
    ]


def _rows(lengths_m: Sequence[Sequence[float]]) -> list[Sequence[str]]:
    """Return rows of text: a number from 1 on, followed by the given lengths, converted from metres
    to mm."""
    return [
        (str(i), *(_mm(MILLIMETRES * length_m) for length_m in row))
        for i, row in enumerate(lengths_m, 1)
    ]


def _write(axes: Axes, table: Sequence[Sequence[str]], left_mm: float, top_mm: float) -> None:
    """Write the list of parts on axes in mm, from the top downwards, with cells aligned right and
    headings bold.
    left_mm, top_mm: upper left corner of the list."""
    for i, cells in enumerate(table):
        y = top_mm - TEXT_MM * (i + 1)
        if len(cells) == 1:
            axes.text(
                left_mm, y, cells[0], weight="bold" if cells[0].endswith(", mm") else "normal"
            )
            continue
        for k, cell in enumerate(cells):
            axes.text(left_mm + 4 + k * (TABLE_MM - 4) / (len(cells) - 1), y, cell, ha="right")


def _coincident(points_mm: np.ndarray) -> list[list[int]]:
    """Group the points [n, 2] in mm of one view by position.
    Returns lists of indices; points that are closer than 0.005 mm (SAME_MM) in both directions are
    in one list."""
    groups: list[list[int]] = []
    for i, point in enumerate(points_mm):
        same = next((g for g in groups if np.abs(points_mm[g[0]] - point).max() < SAME_MM), None)
        groups.append([i]) if same is None else same.append(i)
    return groups


def _mm(value: float) -> str:
    """Format a length in mm with two decimals, or with one if the second decimal is 0."""
    text = f"{round(value, 2) + 0.0:.2f}"
    return (text[:-1] if text.endswith("0") else text).replace("-", "−")
