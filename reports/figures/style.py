"""The common style of all pictures: fonts, colours and markers of the methods, formats of times,
and image files."""

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import matplotlib
import numpy as np
from matplotlib import rcParams
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import Locator, LogLocator, MaxNLocator, NullFormatter
from matplotlib.typing import MarkerType, RcKeyType
from numpy.typing import ArrayLike

from handbench.bench.results.result_folder import Result
from handbench.reports.tables.rounding import is_known
from handbench.support.errors import HandbenchError
from handbench.support.files import atomic_path

STYLE: dict[RcKeyType, object] = {
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.linewidth": 0.6,
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
COLUMN = STYLE | {
    "font.size": 8,
    "axes.titlesize": 8,
    "figure.figsize": (COLUMN_IN, 2.6),
    "savefig.dpi": 300,
}
ORDER = (  # as the paper's Fig. 3, then ours; each has its colour and marker everywhere
    "broadband",
    "2fsk",
    "3fsk",
    "narrowband",
    "3fsk-offaxis",
    "3fsk-weighted",
    "3fsk-plus",
    "nfsk-plus",
    "broadband-subvoxel",
    "broadband-aligned",
    "joint",
    "2fsk-doppler",
    "3fsk-doppler",
    "nfsk-doppler",
)
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
)
FEWEST_TICKS = 3  # of a logarithmic axis
FORMATS = (".png", ".pdf", ".svg")
MARKERS: tuple[MarkerType, ...] = ("o", "s", "^", "D", "v", "P", "X", "<", ">", "*")


@dataclass(frozen=True)
class Picture:
    """A figure for a report.
    stem: its file name without suffix; caption: the text below it; alt: its description for screen
    readers."""

    stem: str
    caption: str
    alt: str
    figure: Figure


Bounded = tuple[Any, float | None, float | None]  # a value, and the ends of its interval


def narrow() -> bool:
    """Tell whether pictures are being drawn for one column of a paper, with the style COLUMN."""
    return rcParams["figure.figsize"][0] == COLUMN_IN


def width_in(page_in: float, columns: int = 1) -> float:
    """Return the width of a figure in inches: `page_in` on an HTML page, and the width of `columns`
    columns in a paper."""
    return columns * COLUMN_IN if narrow() else page_in


@dataclass(frozen=True)
class DrawnMethod:
    """A method as pictures show it: id, title, and its colour and marker, the same everywhere."""

    name: str
    title: str
    colour: str
    marker: MarkerType

    def draw(self, axis: Axes, x: ArrayLike, y: ArrayLike, **style: Any) -> None:
        """Draw a line through points x, y [n] on an axis, and add a grid.
        style: further arguments of matplotlib's `plot`."""
        axis.plot(x, y, **self._style | style)
        axis.grid(alpha=0.25, linewidth=0.4)

    def draw_point(self, axis: Axes, x: Bounded, y: Bounded, **style: Any) -> None:
        """Draw a point with its intervals on an axis.
        style: further arguments of matplotlib's `errorbar`."""
        axis.errorbar(x[0], y[0], whiskers(*y), whiskers(*x), **self._style | style)

    @property
    def _style(self) -> dict[str, Any]:
        looks = {"color": self.colour, "marker": self.marker, "markersize": 4}
        return looks | {"label": self.title}


def drawn_methods(titles: Mapping[str, str]) -> dict[str, DrawnMethod]:
    """Choose colour and marker of each method: method → how it is drawn.
    They are the same in all pictures for the methods that handbench knows (ORDER); other methods
    get the next free ones, in order of appearance. titles: method → title."""
    places = list(dict.fromkeys((*ORDER, *titles)))
    return {
        name: DrawnMethod(name, title, *nth_style(places.index(name)))
        for name, title in titles.items()
    }


def methods(result: Result) -> list[DrawnMethod]:
    """Return the methods of a result in the order in which pictures show them: first the known ones
    in a fixed order (ORDER), then the others."""
    drawn = drawn_methods(result.about.method_titles)
    known = [drawn[name] for name in ORDER if name in drawn]
    return [*known, *(method for name, method in drawn.items() if name not in ORDER)]


def nth_style(i: int) -> tuple[str, MarkerType]:
    """Return colour and marker number i, from 0. No pair occurs twice among the first hundred."""
    return COLOURS[i % len(COLOURS)], MARKERS[(i + i // len(COLOURS)) % len(MARKERS)]


def side_by_side(titles: Mapping[str, str], wide_in: float = 3.6) -> tuple[Figure, dict[str, Axes]]:
    """Return a figure with an axis for each title, and these axes by the titles' keys, with room
    for a legend. The axes are in a row on an HTML page, and one below the other in a column of a
    paper.
    titles: key → title of the axis; wide_in: width of one axis on a page, inches."""
    count = len(titles)
    size_in = (COLUMN_IN, 0.8 + 1.7 * count) if narrow() else (wide_in * count + 1.6, 3.2)
    figure = Figure(figsize=size_in, layout="constrained")
    shape = (count, 1) if narrow() else (1, count)
    axes = figure.subplots(*shape, sharex=True, sharey=True, squeeze=False).ravel()
    for axis, title in zip(axes, titles.values(), strict=True):
        axis.set_title(title)
    return figure, dict(zip(titles, axes, strict=True))


def name_all(figure: Figure, **more: Artist) -> None:
    """Add one legend for all axes to a figure, at their right or, in a column of a paper, below
    them, in which each name is once. Only outer axes keep their labels.
    more: further entries, name → what has it."""
    named: dict[str, Any] = {}
    for axis in figure.axes:
        for handle, name in zip(*axis.get_legend_handles_labels(), strict=True):
            named.setdefault(name, handle)
    named |= more
    place: dict[str, Any] = {"loc": "outside right center"}
    if narrow():
        place = {
            "loc": "outside lower center",
            "ncols": 2,
            "columnspacing": 1,
            "handletextpad": 0.4,
        }
    figure.legend(named.values(), named, frameon=False, fontsize="medium", **place)
    for axis in figure.axes:
        axis.label_outer()


def time_text(result: Result, method: DrawnMethod) -> str:
    """Return a method's time per frame as text for a title, such as "0.52 s"; "time unknown" if
    there is none."""
    time = result.time(method.name)
    if time is None:
        return "time unknown"
    return f"{time.value:.2g} s" if time.value < 10 else f"{time.value:.0f} s"


def whiskers(value: float, low: float | None, high: float | None) -> list[list[float]] | None:
    """Return the lengths of an error bar below and above a value, for matplotlib, from the interval
    [low, high]; None if an end is unknown."""
    return (
        [[max(value - low, 0)], [max(high - value, 0)]]
        if is_known(low) and is_known(high)
        else None
    )


class FewTicks(Locator):
    """Ticks of a logarithmic axis: at powers of ten if it spans a factor of 300 or more, else at
    0.1, 0.2, 0.5, 1, …, or where fewer than three of these fit, at even steps."""

    def __call__(self) -> list[float]:
        low, high = sorted(self.axis.get_view_interval()) if self.axis else (1.0, 10.0)
        for subs in ((1,), (1, 2, 5))[int(high / low < 300) :]:
            ticks = np.asarray(LogLocator(subs=subs).tick_values(low, high))
            inside = ticks[(ticks >= low) & (ticks <= high)]
            if len(inside) >= FEWEST_TICKS:
                return inside.tolist()
        return list(MaxNLocator(4).tick_values(low, high))


def log_axis(axis: Axes, *sides: Literal["x", "y"]) -> None:
    """Make one or both axes of a chart logarithmic, with at least three numbers (FewTicks)."""
    for side in sides:
        axis.set(**{f"{side}scale": "log"})
        ticks = axis.xaxis if side == "x" else axis.yaxis
        ticks.set_major_locator(FewTicks())
        ticks.set_major_formatter("{x:g}")
        ticks.set_minor_formatter(NullFormatter())
        axis.grid(axis=side, alpha=0.25, linewidth=0.4)


def name_ticks(axis: Axes, names: Sequence[str]) -> None:
    """Put a slanted name at each whole number of a chart's x axis, from 0 on."""
    axis.set_xticks(range(len(names)), names, rotation=45, ha="right", rotation_mode="anchor")


def save(figure: Figure, file: str | Path) -> None:
    """Write a figure to a file in the format of the file's suffix; an existing file is replaced
    when the new one is complete. Raises HandbenchError for a suffix other than .png, .pdf and .svg
    (FORMATS)."""
    if Path(file).suffix.lower() not in FORMATS:
        raise HandbenchError(
            f"{file}: is not the name of a picture; use one that ends in {', '.join(FORMATS)}"
        )
    style = COLUMN if figure.get_figwidth() == COLUMN_IN else STYLE
    with matplotlib.rc_context(style), atomic_path(file) as temporary:
        figure.savefig(temporary, format=Path(file).suffix[1:].lower())


def png(figure: Figure) -> bytes:
    """Return a figure as the bytes of a PNG file."""
    stream = io.BytesIO()
    with matplotlib.rc_context(STYLE):
        figure.savefig(stream, format="png")
    return stream.getvalue()
