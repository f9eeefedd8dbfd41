"""Drawing of the calibration target at true scale, for its manufacture: views, parts list and
drilling template.

The front view shows the target from the radar, so that x grows to the left. The side view is from
the viewer's right, with the radar on its left (third-angle projection). The front view is also the
template for the carrier.
"""

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from handbench.reports.drawings.sheets import line, sheet

if TYPE_CHECKING:
    from handbench.calibration.spheres.description import Target

MILLIMETRES = 1e3
EDGE_MM, GAP_MM = 0.5, 5.0  # outlines have a width; between views and list
TEXT_MM = 2.9  # distance of two lines of text
TABLE_MM = 41.0
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


def target_sheet(target: "Target", title: str) -> Figure:
    """Return the printable page of the calibration target (metal balls in foam spheres) at true
    scale: front view, side view and list of parts. title: printed at its foot."""
    # to the right in the front view (−x), to the right in the side view (z), and up (y)
    centres_mm = MILLIMETRES * target.centres_m[:, [0, 2, 1]] * (-1, 1, 1)
    foam_mm = MILLIMETRES * np.array([e.sphere_radius_m for e in target.element])
    ball_mm = MILLIMETRES * np.array([e.ball_radius_m for e in target.element])
    low_mm = (centres_mm - foam_mm[:, None]).min(axis=0)
    width, depth, height = (centres_mm + foam_mm[:, None]).max(axis=0) - low_mm
    side_mm = EDGE_MM + width + GAP_MM  # where the side view begins
    table_mm = side_mm + depth + GAP_MM
    table = _parts(target)
    high_mm = max(height + 2 * EDGE_MM, TEXT_MM * (len(table) + 1))

    def paint(axes: Axes) -> None:
        front_mm = centres_mm[:, [0, 2]] - low_mm[[0, 2]] + EDGE_MM
        side_view_mm = centres_mm[:, [1, 2]] - low_mm[[1, 2]] + (side_mm, EDGE_MM)
        for points_mm in (front_mm, side_view_mm):
            for centre_mm, foam, ball in zip(points_mm, foam_mm, ball_mm, strict=True):
                axes.add_patch(Circle(centre_mm, foam, fill=False, lw=0.7))
                axes.add_patch(Circle(centre_mm, ball, fc="0.88", ec="black", lw=0.5))
                for along in (ball + 1) * np.eye(2):
                    line(axes, *np.transpose([centre_mm - along, centre_mm + along]))
        for number, (x, y) in enumerate(front_mm + ball_mm[:, None] + 1, 1):
            axes.text(x, y, str(number), fontsize=9, weight="bold")
        for (z, y), foam, ball in zip(side_view_mm, foam_mm, ball_mm, strict=True):
            # the drilled hole, from the ball's far end to the sphere's back
            sides_mm = y + ball * np.array([-1, -1, 1, 1])
            line(axes, [z + foam, z - ball, z - ball, z + foam], sides_mm, 0.4, dashed=True)
        _write(axes, table, table_mm, high_mm)

    note = (
        f"{len(target.element)} elements, {width:.1f} × {height:.1f} × {depth:.1f} mm, 1:1; "
        "front view seen from the radar"
    )
    return sheet((float(table_mm + TABLE_MM), float(high_mm)), title, note, paint)


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


def _mm(value: float) -> str:
    """Format a length in mm with two decimals, or with one if the second decimal is 0."""
    text = f"{round(value, 2) + 0.0:.2f}"
    return (text[:-1] if text.endswith("0") else text).replace("-", "−")
