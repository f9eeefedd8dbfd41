"""What all pictures have in common: fonts, colours and markers of the methods, the references that
are drawn, charts with one legend, and image files."""

import io
import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import matplotlib
import numpy as np
import pandas as pd
from matplotlib import rcParams
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.ticker import AutoLocator, LogLocator, NullFormatter
from matplotlib.typing import MarkerType, RcKeyType

from handbench.bench.results.about import CaptureFacts
from handbench.bench.results.result_folder import Result
from handbench.reports.tables.rounding import figure as rounded
from handbench.support.errors import HandbenchError, printable
from handbench.support.files import atomic_path

Style = Mapping[RcKeyType, object]
STYLE: dict[RcKeyType, object] = {
    "font.size": 9,
    "axes.titlesize": "medium",
    "figure.titlesize": "medium",
    "figure.labelsize": "medium",
    "axes.linewidth": 0.6,
    "axes.grid": True,
    "grid.alpha": 0.25,
    "grid.linewidth": 0.4,
    "lines.markersize": 4,
    "errorbar.capsize": 3,
    "legend.frameon": False,
    "legend.fontsize": "medium",
    "legend.columnspacing": 1,
    "legend.handletextpad": 0.4,
    "image.interpolation": "nearest",
    "image.origin": "lower",
    "figure.figsize": (9, 3.2),
    "savefig.dpi": 200,
    "pdf.fonttype": 42,
    "text.parse_math": False,  # names are text, whatever dollars they hold
}
INK = "#767676"  # its contrast is 4.5 on a white page and on the report's dark one
PAGE = STYLE | {
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "axes.facecolor": "none",
    "savefig.facecolor": "none",
}
COLUMN_IN = 3.5  # of a paper in two columns (IEEEtran), whose figures have 8 pt throughout
COLUMN = STYLE | {"font.size": 8, "figure.figsize": (COLUMN_IN, 2.6)}
COLOURS = (  # Okabe and Ito's with grey for black, then Tol's muted ones; for light and dark pages
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#CC79A7",
    "#E69F00",
    "#56B4E9",
    "#7b7b7b",
    "#aa4499",
    "#44AA99",
    "#999933",
    "#8a63d2",
    "#c0565b",
)
MARKERS: tuple[MarkerType, ...] = ("o", "s", "^", "D", "v", "P", "X", "<", ">", "*", "h")
FORMATS = (".png", ".pdf", ".svg")
DRAWN = ("photogrammetry", "truth")  # references; the completed one is drawn in these two


@dataclass(frozen=True)
class Picture:
    """A figure for a report.
    stem: its file name without suffix; caption: the text below it; alt: its description for screen
    readers."""

    stem: str
    caption: str
    alt: str
    figure: Figure


@contextmanager
def styled(style: Style) -> Iterator[None]:
    """Context manager in which pictures have a style, and nothing of the user's matplotlibrc."""
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        rcParams.update(style)
        yield


def narrow() -> bool:
    """Tell whether pictures are being drawn for one column of a paper, with the style COLUMN."""
    return rcParams["figure.figsize"][0] == COLUMN_IN


@dataclass(frozen=True)
class DrawnMethod:
    """A method as the pictures of a result show it: id, title, colour and marker."""

    name: str
    title: str
    colour: str
    marker: MarkerType

    @property
    def style(self) -> dict[str, Any]:
        """The arguments of matplotlib's `plot` and `errorbar` with which the method is drawn."""
        return {"color": self.colour, "marker": self.marker, "label": self.title}


def drawn_methods(titles: Mapping[str, str]) -> list[DrawnMethod]:
    """Choose colour and marker of each method, in their order. No pair occurs twice among the first
    hundred.
    titles: method → title."""
    return [
        DrawnMethod(name, title, COLOURS[i % len(COLOURS)], MARKERS[i % len(MARKERS)])
        for i, (name, title) in enumerate(titles.items())
    ]


def methods(result: Result) -> list[DrawnMethod]:
    """Return the methods of a result as its pictures show them, in its order."""
    return drawn_methods(result.about.method_titles)


def drawn_references(captures: Iterable[CaptureFacts]) -> list[str]:
    """Return the references that pictures show and against which one of the captures is scored."""
    scored = {reference for capture in captures for reference in capture.references}
    return [reference for reference in DRAWN if reference in scored]


def charts(
    titles: Mapping[str, str], x_label: str, y_label: str, wide_in: float = 3.6
) -> tuple[Figure, dict[str, Axes]]:
    """Return a figure with an axis for each title, and these axes by the titles' keys, with room
    for a legend. The axes are in a row on an HTML page, and one below the other in a column of a
    paper.
    titles: key → title of the axis; y_label: of all axes ("": each has a scale of its own, which
    its title names); wide_in: width of one axis on a page, inches."""
    count = len(titles)
    size_in = (COLUMN_IN, 0.8 + 1.7 * count) if narrow() else (wide_in * count + 1.6, 3.2)
    figure = Figure(figsize=size_in, layout="constrained")
    shape = (count, 1) if narrow() else (1, count)
    axes = figure.subplots(*shape, sharex=True, sharey=bool(y_label), squeeze=False).ravel()
    for axis, title in zip(axes, titles.values(), strict=True):
        axis.set_title(title)
    figure.supxlabel(x_label)
    figure.supylabel(y_label)
    return figure, dict(zip(titles, axes, strict=True))


def add_legend(figure: Figure) -> None:
    """Add one legend for all axes to a figure, at their right or, in a column of a paper, above
    them, in which each name is once."""
    named: dict[str, Any] = {}
    for axis in figure.axes:
        handles, names = axis.get_legend_handles_labels()
        named |= dict(zip(names, handles, strict=True))
    place: Any = "outside upper center" if narrow() else "outside right center"
    figure.legend(named.values(), named, loc=place, ncols=2 if narrow() else 1)


def whiskers(value: pd.Series, low: pd.Series, high: pd.Series) -> np.ndarray:
    """Return the lengths of error bars below and above values, [2, n], from their intervals
    [low, high]; NaN where an end is unknown."""
    return np.clip([value - low, high - value], 0, None)


def time_text(result: Result, method: DrawnMethod) -> str:
    """Return a method's time per frame as text for a title, such as "0.52 s"; "time unknown" if
    there is none."""
    time = result.time(method.name)
    return f"{rounded(time.value)} s" if time else "time unknown"


def log_axis(axis: Axes, *sides: Literal["x", "y"]) -> None:
    """Make one or both axes of a chart with data logarithmic. Numbers are at powers of ten if it
    spans a factor of 300 or more, else at 0.1, 0.2, 0.5, 1, …, or below a factor of 5 at even
    steps."""
    for side in sides:
        axis.set(**{f"{side}scale": "log"})
        ticks = axis.xaxis if side == "x" else axis.yaxis
        low, high = ticks.get_view_interval()
        powers = LogLocator(subs=(1,) if high / low > 300 else (1, 2, 5))
        ticks.set_major_locator(powers if high / low > 5 else AutoLocator())
        ticks.set_major_formatter("{x:g}")
        ticks.set_minor_formatter(NullFormatter())


def save(figure: Figure, file: str | Path, style: Style = STYLE) -> None:
    """Write a figure to a file in the format of the file's suffix; an existing file is replaced
    when the new one is complete. Raises HandbenchError for a suffix other than .png, .pdf and .svg
    (FORMATS)."""
    suffix = Path(file).suffix.lower()
    if suffix not in FORMATS:
        raise HandbenchError(
            f"{file}: is not the name of a picture; use one that ends in {', '.join(FORMATS)}"
        )
    with atomic_path(file) as temporary:
        temporary.write_bytes(image_bytes(figure, suffix[1:], style))


def image_bytes(figure: Figure, kind: str = "png", style: Style = STYLE) -> bytes:
    """Return a figure as the bytes of an image file of a kind: png, pdf or svg. The same figure
    gives the same PNG or PDF. Characters that cannot be printed are written as in a terminal."""
    for text in figure.findobj(Text):
        text.set_text("\n".join(map(printable, text.get_text().split("\n"))))
    stream = io.BytesIO()
    undated = {"CreationDate" if kind == "pdf" else "Date": None}
    with styled(style), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph")  # of a script that the font does not have
        figure.savefig(stream, format=kind, metadata=undated)
    return stream.getvalue()
