"""Drawings at true scale on sheets of paper: paper sizes, tiles with crop marks, PDF and SVG files.

A drawing is painted in millimetres. Each sheet shows a window of the drawing on axes of exactly the
window's size, and below it a scale bar to check the printer.
"""

import re
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.typing import RcKeyType
from numpy.typing import ArrayLike

from handbench.support.errors import HandbenchError
from handbench.support.files import atomic_path

INCH_MM = 25.4
PAPERS_MM = {"A4": (297.0, 210.0), "A3": (420.0, 297.0), "letter": (279.4, 215.9)}
FIT = "fit"  # one sheet as large as the drawing needs, for a print shop or a plotter
# printers leave up to 6.4 mm white; crop marks are in the margin
MARGIN_MM, FOOTER_MM = (7.0, 14.0)
OVERLAP_MM = 10.0  # neighbouring sheets show this much of each other, at least
BAR_MM = 100.0
LARGEST_MM = 5000.0  # a PDF's page ends at 5080 mm
LEAST_WIDTH_MM = 200.0  # of a fitted sheet: the bar, and the title next to it
STYLE: dict[RcKeyType, object] = {
    "font.family": "DejaVu Sans",  # comes with matplotlib
    "font.size": 6.5,
    "text.usetex": False,
    "text.parse_math": False,  # a file's name is no formula
    "savefig.bbox": None,  # the page is the page
    "savefig.dpi": "figure",
    "svg.fonttype": "path",  # looks the same without the font
    "svg.hashsalt": "handbench",  # same drawing, same bytes
    "pdf.fonttype": 42,
}
THIN, GREY = 0.25, "0.55"  # points; colour of what is no edge


@dataclass(frozen=True)
class Drawing:
    """A drawing to print at true scale.
    width_mm, height_mm: its size; title, note: two lines of text at the foot of each sheet; paint:
    function that draws it on axes in mm, with the origin at the lower left and y up."""

    width_mm: float
    height_mm: float
    title: str
    note: str
    paint: Callable[[Axes], None]


def sheets(drawings: Sequence[Drawing], paper: str = FIT) -> list[Figure]:
    """Return the printable sheets of several drawings, each as a figure of the paper's size.
    A drawing that does not fit on one sheet is cut into overlapping tiles with crop marks. Raises
    HandbenchError for an unknown paper and for a drawing larger than 5 m (LARGEST_MM)."""
    for drawing in drawings:
        if max(drawing.width_mm, drawing.height_mm) > LARGEST_MM:
            size = f"{drawing.width_mm:.0f} × {drawing.height_mm:.0f} mm"
            raise HandbenchError(
                f"drawing: is {size}; expected at most {LARGEST_MM:.0f} mm; check that all "
                "lengths are in metres"
            )
    plan = [(drawing, *tiles(drawing, paper)) for drawing in drawings]
    total = sum(len(windows) for _, _, windows in plan)
    figures: list[Figure] = []
    with matplotlib.rc_context(STYLE):
        for drawing, page_mm, windows in plan:
            for window in windows:
                figures.append(
                    _sheet(drawing, page_mm, window, f"sheet {len(figures) + 1} of {total}")
                )
    return figures


def usable_mm(paper: str) -> tuple[float, float]:
    """Return width and height, mm, of the printable area of a sheet in landscape; infinite for the
    paper "fit". Raises HandbenchError for an unknown paper."""
    if paper == FIT:
        return np.inf, np.inf
    if paper not in PAPERS_MM:
        raise HandbenchError(f"paper: is '{paper}'; expected one of {', '.join([*PAPERS_MM, FIT])}")
    width, height = PAPERS_MM[paper]
    return width - 2 * MARGIN_MM, height - 2 * MARGIN_MM - FOOTER_MM


def tiles(drawing: Drawing, paper: str) -> tuple[tuple[float, float], list[np.ndarray]]:
    """Decide how a drawing is cut into sheets.
    Returns the page's width and height in mm, and for each sheet the window of the drawing that it
    shows, [left, bottom, width, height] in mm, row by row from the top. The page is in portrait or
    landscape, whichever needs fewer sheets."""
    usable_mm(paper)  # refuses an unknown one
    if paper == FIT:
        width = max(drawing.width_mm + 2 * MARGIN_MM, LEAST_WIDTH_MM)
        page = (width, drawing.height_mm + 2 * MARGIN_MM + FOOTER_MM)
        return page, [np.array([0.0, 0.0, drawing.width_mm, drawing.height_mm])]
    choices = []
    for page in (PAPERS_MM[paper], PAPERS_MM[paper][::-1]):
        width, height = page[0] - 2 * MARGIN_MM, page[1] - 2 * MARGIN_MM - FOOTER_MM
        lefts, bottoms = _starts(drawing.width_mm, width), _starts(drawing.height_mm, height)
        size = min(width, drawing.width_mm), min(height, drawing.height_mm)
        choices.append(
            (page, [np.array([left, bottom, *size]) for bottom in bottoms[::-1] for left in lefts])
        )
    return min(choices, key=lambda choice: len(choice[1]))


def _starts(length_mm: float, window: float) -> np.ndarray:
    """Return where windows start, mm, of which as few as possible cover a length and overlap by at
    least 10 mm (OVERLAP_MM); [0] if one window is enough.
    window: length of each window, mm."""
    if length_mm <= window + 1e-9:
        return np.zeros(1)
    count = int(np.ceil((length_mm - OVERLAP_MM) / (window - OVERLAP_MM) - 1e-9))
    return np.linspace(0, length_mm - window, count)


def _sheet(
    drawing: Drawing, page_mm: tuple[float, float], window: np.ndarray, number: str
) -> Figure:
    figure = Figure(figsize=(page_mm[0] / INCH_MM, page_mm[1] / INCH_MM))
    page = _axes(figure, page_mm, np.array([0, 0, *page_mm]), np.array([0, 0, *page_mm]))
    corner = (np.array(page_mm) - window[2:] + (0, FOOTER_MM)) / 2  # centred, above the foot
    drawing.paint(_axes(figure, page_mm, np.array([*corner, *window[2:]]), window))
    if (window[2:] < (drawing.width_mm, drawing.height_mm)).any():
        _marks(page, corner, window, drawing)
        number += ": trim left and upper edge, lay on the neighbours' ticks"
    bar_x, bar_y, right = MARGIN_MM + 6, MARGIN_MM + 1.5, page_mm[0] - MARGIN_MM - 6
    bar = line(page, [bar_x, bar_x + BAR_MM], [bar_y, bar_y], 0.6)
    bar.set_gid("scale-bar")
    for x in np.linspace(bar_x, bar_x + BAR_MM, 11):
        line(page, [x, x], [bar_y, bar_y + (2 if x in (bar_x, bar_x + BAR_MM) else 1)])
    page.text(
        bar_x + BAR_MM / 2,
        bar_y + 3,
        f"measure me: {BAR_MM:.1f} mm; print at 100 %",
        ha="center",
        fontsize=8,
    )
    for height, text, weight in (
        (7.2, drawing.title, "bold"),
        (3.8, drawing.note, "normal"),
        (0.4, number, "normal"),
    ):
        page.text(right, MARGIN_MM + height, _plain(text), ha="right", weight=weight)
    return figure


def _axes(
    figure: Figure, page_mm: tuple[float, float], place: np.ndarray, window: np.ndarray
) -> Axes:
    """Add axes to a page that show a part of a drawing at true scale, and return them.
    place: position on the page; window: the part of the drawing; both are [left, bottom, width,
    height] in mm."""
    axes = figure.add_axes(tuple(place / (*page_mm, *page_mm)))
    axes.set(xlim=(window[0], window[0] + window[2]), ylim=(window[1], window[1] + window[3]))
    axes.set_axis_off()
    return axes


def _marks(page: Axes, corner: np.ndarray, window: np.ndarray, drawing: Drawing) -> None:
    """Draw crop marks outside the corners of a tile, and ticks where the edges of the neighbouring
    tiles at its right and below it will be.
    corner: lower left corner of the tile on the page, mm; window: the part of the drawing that it
    shows, [left, bottom, width, height] in mm."""
    (left, bottom), (right, top) = corner, corner + window[2:]
    for x, outward in ((left, -1), (right, 1)):
        for y, upward in ((bottom, -1), (top, 1)):
            line(page, [x + outward, x + 4 * outward], [y, y])
            line(page, [x, x], [y + upward, y + 3 * upward])
    lefts, bottoms = _starts(drawing.width_mm, window[2]), _starts(drawing.height_mm, window[3])
    for start in lefts[lefts > window[0]][:1]:
        x = left + start - window[0]
        for y in (bottom - 2, top + 2):
            line(page, [x, x], [y - 1, y + 1], 0.8)
    for start in bottoms[bottoms < window[1]][-1:]:
        y = top + start - window[1]
        for x in (left - 2, right + 2):
            line(page, [x - 1, x + 1], [y, y], 0.8)


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


def save(path: str | Path, figures: Sequence[Figure]) -> None:
    """Write sheets to a PDF file, or a single sheet to an SVG file; an existing file is replaced
    when the new one is complete.
    The same drawing gives the same bytes. Raises HandbenchError for another suffix and for an SVG
    of several sheets."""
    path = Path(path)
    check_suffix(path, (".pdf", ".svg"))
    svg = path.suffix.lower() == ".svg"
    if svg and len(figures) > 1:
        raise HandbenchError(
            f"{path}: an SVG file has only one page, but the drawing has {len(figures)} sheets; "
            "write a PDF, or choose a larger --paper"
        )
    with matplotlib.rc_context(STYLE), atomic_path(path) as temporary:
        if svg:
            figures[0].savefig(temporary, format="svg", metadata={"Date": None})
            width, height = figures[0].get_size_inches() * INCH_MM
            # some programs take matplotlib's points for pixels
            size = f'width="{width:.6g}mm" height="{height:.6g}mm"'
            svg_text = re.sub(
                r'width="[\d.]+pt" height="[\d.]+pt"', size, temporary.read_text("utf-8"), count=1
            )
            temporary.write_text(svg_text, encoding="utf-8")
            return
        with PdfPages(temporary, metadata={"CreationDate": None}) as pages:
            for figure in figures:
                pages.savefig(figure)


def check_suffix(path: Path, known: Sequence[str]) -> None:
    """Raise a HandbenchError if the suffix of a file is not one of the `known` formats."""
    if path.suffix.lower() not in known:
        raise HandbenchError(f"{path}: ends in '{path.suffix}'; expected {', '.join(known)}")
