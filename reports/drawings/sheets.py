"""Drawings at true scale: one page as large as the drawing, as PDF.

A drawing is painted in millimetres on axes of exactly its size. A scale bar below it checks the
printer.
"""

import textwrap
from collections.abc import Callable
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.typing import RcKeyType
from numpy.typing import ArrayLike

from handbench.support.errors import HandbenchError
from handbench.support.files import atomic_path

INCH_MM = 25.4
# printers leave up to 6.4 mm white
MARGIN_MM, FOOTER_MM = (7.0, 20.0)
BAR_MM = 100.0
LARGEST_MM = 5000.0  # a PDF's page ends at 5080 mm
LEAST_WIDTH_MM = 200.0  # of a page: the bar, and lines of text
STYLE: dict[RcKeyType, object] = {
    "font.family": "DejaVu Sans",  # comes with matplotlib
    "font.size": 6.5,
    "text.usetex": False,
    "text.parse_math": False,  # a file's name is no formula
    "savefig.bbox": None,  # the page is the page
    "savefig.dpi": "figure",
    "pdf.fonttype": 42,
}
THIN = 0.25  # points


def sheet(
    size_mm: tuple[float, float], title: str, note: str, paint: Callable[[Axes], None]
) -> Figure:
    """Return the printable page of a drawing at true scale.

    Args:
        size_mm: width and height of the drawing, mm.
        title, note: two lines of text at the foot of the page.
        paint: function that draws it on axes in mm, with the origin at the lower left and y up.

    Raises:
        HandbenchError: the drawing is larger than 5 m (LARGEST_MM).
    """
    width, height = size_mm
    if max(size_mm) > LARGEST_MM:
        raise HandbenchError(
            f"drawing: is {width:.0f} × {height:.0f} mm; expected at most {LARGEST_MM:.0f} mm; "
            "check that all lengths are in metres"
        )
    page_mm = max(width + 2 * MARGIN_MM, LEAST_WIDTH_MM), height + 2 * MARGIN_MM + FOOTER_MM
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(page_mm[0] / INCH_MM, page_mm[1] / INCH_MM))
        paint(_axes(figure, page_mm, ((page_mm[0] - width) / 2, MARGIN_MM + FOOTER_MM), size_mm))
        page = _axes(figure, page_mm, (0.0, 0.0), page_mm)
        left, bottom = MARGIN_MM + 6, MARGIN_MM + 1.5
        line(page, [left, left + BAR_MM], [bottom, bottom], 0.6).set_gid("scale-bar")
        for x in (left, left + BAR_MM):
            line(page, [x, x], [bottom, bottom + 2])
        bar = f"measure me: {BAR_MM:.1f} mm; print at 100 %"
        page.text(left + BAR_MM / 2, bottom + 3, bar, ha="center", fontsize=8)
        # above the bar, which may be as wide as the page
        page.text(left, bottom + 12.4, _plain(title), weight="bold")
        page.text(left, bottom + 9, _plain(note))
    return figure


def _axes(
    figure: Figure,
    page_mm: tuple[float, float],
    corner_mm: tuple[float, float],
    size_mm: tuple[float, float],
) -> Axes:
    """Add axes in mm to a page, and return them. corner_mm: their lower left corner on the page;
    size_mm: width and height."""
    axes = figure.add_axes((*np.divide(corner_mm, page_mm), *np.divide(size_mm, page_mm)))
    axes.set(xlim=(0, size_mm[0]), ylim=(0, size_mm[1]))
    axes.set_axis_off()
    return axes


def line(
    axes: Axes,
    x_mm: ArrayLike,
    y_mm: ArrayLike,
    width: float = THIN,
    color: str = "black",
    dashed: bool = False,
) -> Line2D:
    """Draw a line on axes in mm, and return it.
    x_mm, y_mm [n]: its points; width: in printer's points."""
    style = "--" if dashed else "-"
    return axes.add_line(Line2D(x_mm, y_mm, lw=width, color=color, ls=style, solid_capstyle="butt"))


def _plain(text: str) -> str:
    """Return a text shortened to fit at the foot of a sheet. Characters that the font may not have,
    which a file name can contain, become "?"."""
    shown = "".join(
        c if c.isprintable() else "?" for c in text.encode("latin-1", "replace").decode("latin-1")
    )
    return textwrap.shorten(shown, 76, placeholder="…") if " " in shown else shown[:76]


def save(path: str | Path, figure: Figure) -> None:
    """Write a sheet to a PDF file; an existing file is replaced when the new one is complete. The
    same drawing gives the same bytes."""
    with matplotlib.rc_context(STYLE), atomic_path(path) as temporary:
        figure.savefig(temporary, format="pdf", metadata={"CreationDate": None})
