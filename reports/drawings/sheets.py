"""One page at true scale, as large as its drawing, as PDF.

Below the drawing are lines of text, and a scale bar that checks the printer.
"""

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.typing import RcKeyType

INCH_MM = 25.4
MARGIN_MM = 10.0  # white around the drawing; printers leave up to 6.4 mm
LINE_MM = 2.8  # height of a line of text
BAR_MM = 100.0
LEAST_WIDTH_MM = 180.0  # of the lines of text
STYLE: dict[RcKeyType, object] = {
    "font.family": "DejaVu Sans Mono",  # comes with matplotlib
    "font.size": 6.5,
    "lines.linewidth": 0.5,
    "patch.linewidth": 0.5,
    "text.parse_math": False,  # a file's name is no formula
}


def sheet(width_mm: float, height_mm: float, *footer: str) -> tuple[Figure, Axes]:
    """Return a page for a drawing, and axes in mm on it, with the origin at the drawing's lower
    left corner and y up. footer: lines of text below the drawing."""
    text = "\n".join([*footer, f"measure me: {BAR_MM:.0f} mm; print at 100 %"])
    bar_mm = -MARGIN_MM - LINE_MM * (text.count("\n") + 2)
    right_mm = max(width_mm, LEAST_WIDTH_MM) + MARGIN_MM
    low_mm, high_mm = bar_mm - MARGIN_MM, height_mm + MARGIN_MM
    figure = Figure(((right_mm + MARGIN_MM) / INCH_MM, (high_mm - low_mm) / INCH_MM))
    axes = figure.add_axes((0, 0, 1, 1), xlim=(-MARGIN_MM, right_mm), ylim=(low_mm, high_mm))
    axes.set_axis_off()
    axes.plot([0, BAR_MM], [bar_mm, bar_mm], "k|-", gid="scale-bar")
    axes.text(0, bar_mm + LINE_MM, text)
    return figure, axes
