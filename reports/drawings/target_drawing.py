"""Drawing of the calibration target at true scale, for its manufacture: front view, side view with
the holes, and list of parts.

The front view shows the target from the radar, so that x grows to the left; it is the template for
the carrier. The side view is from the viewer's right, with the radar on its left.
"""

from typing import TYPE_CHECKING

import pandas as pd
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle

from handbench.reports.drawings.sheets import STYLE, sheet
from handbench.reports.figures.style import styled

if TYPE_CHECKING:
    from handbench.calibration.target import Target

MILLIMETRES = 1e3
GAP_MM = 5.0  # between the views


@styled(STYLE)
def target_sheet(target: "Target", title: str) -> Figure:
    """Return the printable page of the calibration target (metal balls in foam spheres) at true
    scale. title: printed at its foot."""
    centres_mm = pd.DataFrame(MILLIMETRES * target.centres_m, columns=["x", "y", "z"])
    foam_mm = MILLIMETRES * pd.Series([e.sphere_radius_m for e in target.element])
    ball_mm = MILLIMETRES * pd.Series([e.ball_radius_m for e in target.element])
    low_mm = centres_mm.sub(foam_mm, axis=0).min()
    high_mm = centres_mm.add(foam_mm, axis=0).max()
    parts_mm = centres_mm.assign(foam=2 * foam_mm, ball=2 * ball_mm, hole=foam_mm + ball_mm)
    parts_mm["spacer"] = high_mm.z - centres_mm.z - foam_mm
    parts_mm.index += 1
    side_mm = high_mm.x - low_mm.x + GAP_MM  # where the side view begins
    figure, axes = sheet(
        side_mm + high_mm.z - low_mm.z,
        high_mm.y - low_mm.y,
        title,
        "left: from the radar, the template of the carrier; right: the holes, drilled from behind",
        f"mm; foam (permittivity {target.foam_permittivity:g}), steel ball: diameters; hole: depth",
        parts_mm.to_string(float_format="{:.2f}".format),
    )
    rows = parts_mm.to_numpy()
    for number, (x_mm, y_mm, z_mm, foam, ball, hole, _) in enumerate(rows, 1):
        front, side, y = high_mm.x - x_mm, side_mm + z_mm - low_mm.z, y_mm - low_mm.y
        for x in (front, side):
            axes.add_patch(Circle((x, y), foam / 2, fill=False))
            axes.add_patch(Circle((x, y), ball / 2, fc="0.88", ec="black"))
            axes.plot(x, y, "k+", ms=40, mew=0.25)
        axes.text(front + ball / 2, y + ball / 2, str(number), size=9, weight="bold")
        # from the ball's far end to the sphere's back
        corner = side - ball / 2, y - ball / 2
        axes.add_patch(Rectangle(corner, hole, ball, fill=False, ls="--"))
    return figure
