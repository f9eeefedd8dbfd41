"""Depth maps and error maps, as seen from the array: x grows to the left, so that they look like the photograph."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from textwrap import fill
from typing import Any, Literal

import numpy as np
from matplotlib import colormaps, rcParams
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Colormap, Normalize, SymLogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.markers import TICKDOWN, TICKLEFT
from matplotlib.ticker import MaxNLocator
from PIL import Image

from handbench.bench.results import HEADLINE, CaptureFacts, ErrorMap, MethodFacts, Result, Surface
from handbench.reports.figures.style import COLUMN_IN, Layout, Picture, methods, narrow, time_text
from handbench.reports.tables.blocks import AGAINST, DRAWN, floor_note

DEPTH_COLOURS, ERROR_COLOURS, EMPTY = "viridis_r", "RdBu_r", "#d9d9d9"
ERROR_TICKS_MM = (-30, -10, -3, -1, 0, 1, 3, 10, 30)
X_LABEL, X_SHORT = "x in mm, growing to the left (as seen from the array)", "x in mm (as seen from the array)"
# Of a page and of a paper's column: panels in a row at most; in inches the width of one (0: what the column leaves),
# the gap, the margins at the left and the right, the width of a colour bar.
PAGE, COLUMN = (6, 1.9, 0.14, 0.8, 0.75, 0.14), (4, 0.0, 0.05, 0.48, 0.74, 0.08)
LINE_IN, BOTTOM_IN = 0.155, 0.45  # of a title's line, and below the lowest panels
SIGNED = (
    "red lies behind the reference, blue before it, grey was not observed; the line is the reference's outline. The "
    "scale, the same for every capture, is linear within ±1 mm and logarithmic beyond."
)

Box = tuple[float, float, float, float]  # left, right, bottom, top in mm; left > right


@dataclass(frozen=True)
class Panel:
    """A titled map, in metres, with the outline of the reference of `errors`, if they are given; or a photograph's
    pixels; or nothing."""

    title: str = ""
    surface: Surface | None = None
    errors: ErrorMap | None = None
    photo: np.ndarray | None = None


@dataclass(frozen=True)
class Strip:
    """Panels of one colour scale, in mm."""

    panels: Sequence[Panel]
    colours: Colormap
    norm: Normalize
    label: str

    def ticks(self) -> dict[float, str]:
        """The values that its bar of colours tells, and how they are written."""
        if not isinstance(self.norm, SymLogNorm):
            low, high = self.norm.inverse(np.array([0.0, 1.0])).tolist()
            ticks = MaxNLocator(9, steps=(1, 2, 2.5, 5, 10)).tick_values(low, high)
            return {t: f"{t:g}".replace("-", "−") for t in ticks if low <= t <= high}
        ticks = ERROR_TICKS_MM[:: 2 if narrow() else 1]
        return {t: f"{t:+d}".replace("-", "−").replace("+0", "0") for t in ticks}


@dataclass(frozen=True)
class Maps:
    """The maps of one picture, not drawn yet: strips of panels cut to a box, with the name of its files, its caption
    and a description for those who cannot see it."""

    stem: str
    caption: str
    alt: str
    strips: Sequence[Strip]
    box: Box


def depth_strip(panels: Sequence[Panel], first: Surface) -> Strip:
    """Depths on the scale of one of them."""
    return Strip(panels, colormaps[DEPTH_COLOURS].with_extremes(bad=EMPTY), depth_scale(first), "z in mm")


def error_strip(panels: Sequence[Panel]) -> Strip:
    """Signed errors."""
    return Strip(panels, colormaps[ERROR_COLOURS].with_extremes(bad=EMPTY), error_scale(), "z − z_ref in mm")


def error_panel(title: str, errors: ErrorMap) -> Panel:
    """Signed errors and their reference's outline: where a sparse map lies on the hand."""
    return Panel(title, Surface(errors.x_m, errors.y_m, errors.error_m), errors)


def error_scale() -> SymLogNorm:
    """The scale of signed errors in mm, the same everywhere: linear within ±1 mm, logarithmic to ±50 mm."""
    return SymLogNorm(linthresh=1, linscale=0.6, vmin=-50, vmax=50)


def panels(result: Result, capture: CaptureFacts) -> Iterator[Picture]:
    """One capture's pictures, drawn."""
    for maps in maps_of(result, capture):
        yield Picture(maps.stem, maps.caption, maps.alt, sheet(maps.strips, maps.box))


def maps_of(result: Result, capture: CaptureFacts) -> Iterator[Maps]:
    """One capture's pictures."""
    if result.about.methods:
        references = [reference for reference in DRAWN if reference in capture.references]
        yield depth_maps(result, capture, *references[:1])
        for reference in references[1:]:
            yield error_maps(result, capture, reference)


def depth_maps(result: Result, capture: CaptureFacts, reference: str = "") -> Maps:
    """Like the paper's Fig. 3 and 4: ground truth and methods on one colour scale, and below each its errors against
    the reference, beside the photograph."""
    maps = [Panel(_title(result, m), result.surface(capture.name, m.name)) for m in methods(result)]
    surfaces, photo = [panel.surface for panel in maps if panel.surface], result.photo(capture.name)
    before = [Panel("photograph", photo=np.asarray(Image.open(photo).convert("RGB")))] if photo else []
    said, alt, errors = "; grey: not observed.", "", []
    if reference:
        name = {"truth": "true surface", "photogrammetry": "photogrammetry"}[reference]
        surfaces.insert(0, result.surface(capture.name, reference))
        below, alt = _errors(result, capture, reference, timed=False)
        errors = [error_strip([*(before or [Panel()]), *below])]
        before = [Panel("ground\ntruth" if narrow() else f"ground truth\n({name})", surfaces[0])]
        said = f", and below them their errors {AGAINST[reference]}; {SIGNED}{floor_note(result)}"
    names = ", ".join(panel.title.replace("\n", " ") for panel in (*before, *maps))
    return Maps(
        f"depth_{capture.name}",
        f"Capture {capture.name}: depth maps on one colour scale{said}",
        f"Depth maps of capture {capture.name}, side by side: {names}{', and the photograph' * bool(photo)}. {alt}",
        [depth_strip([*before, *maps], surfaces[0]), *errors],
        box_of(surfaces),
    )


def error_maps(result: Result, capture: CaptureFacts, reference: str) -> Maps:
    """Like the paper's Fig. 4: signed errors of every method, on one diverging scale for every capture."""
    shown, alt = _errors(result, capture, reference, timed=True)
    return Maps(
        f"error_{capture.name}__{reference}",
        f"Capture {capture.name}: signed errors {AGAINST[reference]}; {SIGNED}{floor_note(result)}",
        alt,
        [error_strip(shown)],
        box_of([result.surface(capture.name, reference)]),
    )


def _errors(result: Result, capture: CaptureFacts, reference: str, timed: bool) -> tuple[list[Panel], str]:
    """The methods' errors, titled by their means and, if timed, by names and times too; and all in words."""
    shown, words = [], []
    for m in methods(result):
        errors = result.errors(capture.name, m.name, reference)
        mean = mean_text(result, errors.error_m)
        words.append(f"{m.title}: {mean}")
        mean = mean.removeprefix(f"{result.title(HEADLINE)} ") if narrow() else mean
        shown.append(error_panel(_title(result, m, mean) if timed else mean, errors))
    return shown, f"Error maps of capture {capture.name} {AGAINST[reference]}. {'; '.join(words)}."


def _title(result: Result, method: MethodFacts, mean: str = "") -> str:
    """A method's name, its mean error, if it is told, and its time."""
    time = time_text(result, method)
    if narrow():
        return "\n".join(filter(None, (fill(method.title, 11), mean, time)))
    return f"{method.title}\n{mean}, {time}" if mean else f"{method.title}\n{time} per frame"


def mean_text(result: Result, error_m: np.ndarray) -> str:
    """Mean absolute error of one map, in words."""
    seen = error_m[np.isfinite(error_m)]
    return f"{result.title(HEADLINE)} {1e3 * np.abs(seen).mean():.2f} mm" if len(seen) else "nothing observed"


def layout(strips: Sequence[Strip], box: Box) -> Layout:
    """Strips one below the other, in as many turns as a row has too few places, with a colour bar at the right of each
    row."""
    count = max(len(strip.panels) for strip in strips)
    abreast, wide, gap, left, right, bar_wide = COLUMN if narrow() else PAGE
    columns = math.ceil(count / math.ceil(count / abreast))
    wide = wide or (COLUMN_IN - left - right) / columns - gap
    high = wide * min(max((box[3] - box[2]) / (box[0] - box[1]), 0.5), 2.2)
    parts = [(s, s.panels[i : i + columns]) for i in range(0, count, columns) for s in strips]
    rows = [replace(strip, panels=part) for strip, part in parts if part]
    tops = [0.1 + LINE_IN * (1 + max(panel.title.count("\n") for panel in row.panels)) for row in rows]
    width, height = left + columns * (wide + gap) + right, BOTTOM_IN + sum(tops) + len(rows) * high
    lowers = height - np.cumsum(np.array(tops) + high)
    lefts = [left + column * (wide + gap) for column in range(columns)]
    placed = list(zip(rows, lowers.tolist(), strict=True))
    return Layout(width, height, wide, high, lefts, (width - right, bar_wide), placed)


def sheet(strips: Sequence[Strip], box: Box) -> Figure:
    """A figure of strips by their layout; numbers and names stand on the outer axes only, and nothing where no panel
    is."""
    at = layout(strips, box)
    figure, axes = Figure(figsize=(at.width, at.height)), []

    def place(x: float, y: float, wide: float) -> Axes:
        return figure.add_axes((x / at.width, y / at.height, wide / at.width, at.high / at.height))

    for row, y in at.rows:
        axes.append([place(x, y, at.wide) for x in at.lefts[: len(row.panels)]])
        for axis, panel in zip(axes[-1], row.panels, strict=True):
            _draw(axis, panel, row, box)
        _number(axes[-1][0], "y", box)
        axes[-1][0].set_ylabel("y in mm", labelpad=1)
        _bar(figure, row, place(at.bar[0], y, at.bar[1]))
    for below in zip_longest(*axes):  # a photograph has no numbers
        _number(next(axis for axis in reversed(below) if axis), "x", box)
    middle = (at.lefts[0] + at.lefts[-1] + at.wide) / 2 / at.width
    figure.text(middle, 0.06 / at.height, X_SHORT if narrow() else X_LABEL, ha="center")
    return figure


def _bar(figure: Figure, strip: Strip, axis: Axes) -> None:
    """The strip's colour bar, that of signed errors with their ticks."""
    bar = figure.colorbar(ScalarMappable(strip.norm, strip.colours), cax=axis, extend="both")
    bar.set_label(strip.label, labelpad=1)
    if isinstance(strip.norm, SymLogNorm):
        ticks = strip.ticks()
        bar.set_ticks(list(ticks), labels=list(ticks.values()))
        bar.minorticks_off()


def box_of(surfaces: Sequence[Surface], margin_mm: float = 8) -> Box:
    """The box around every pixel that any surface has."""
    x_mm = 1e3 * np.concatenate([s.x_m[np.isfinite(s.z_m).any(axis=0)] for s in surfaces])
    y_mm = 1e3 * np.concatenate([s.y_m[np.isfinite(s.z_m).any(axis=1)] for s in surfaces])
    if not len(x_mm):
        x_mm, y_mm = 1e3 * surfaces[0].x_m, 1e3 * surfaces[0].y_m
    return x_mm.max() + margin_mm, x_mm.min() - margin_mm, y_mm.min() - margin_mm, y_mm.max() + margin_mm


def depth_scale(surface: Surface) -> Normalize:
    """The scale of depths in mm: the surface's range and 2.5 mm more, rounded outwards to 5 mm."""
    z_mm = 1e3 * surface.z_m[np.isfinite(surface.z_m)]
    if not len(z_mm):
        return Normalize(0, 1)
    return Normalize(5 * math.floor(z_mm.min() / 5 - 0.5), 5 * math.ceil(z_mm.max() / 5 + 0.5))


def _draw(axis: Axes, panel: Panel, strip: Strip, box: Box) -> None:
    """One map in mm, pixel for pixel on its even grid, cut to `box`; or a photograph."""
    axis.set_title(panel.title, y=1.0)  # told, for to find it takes as long as to draw the axes
    if panel.surface is None:
        axis.set_axis_off()
        if panel.photo is not None:
            axis.set_anchor("N")
            axis.imshow(panel.photo)
        return
    axis.set_facecolor(EMPTY)
    values_mm = np.ma.masked_invalid(1e3 * panel.surface.z_m)
    extent = (*edges_mm(panel.surface.x_m), *edges_mm(panel.surface.y_m))
    axis.imshow(values_mm, strip.colours, strip.norm, interpolation="nearest", origin="lower", extent=extent)
    if panel.errors:
        covered = np.isfinite(panel.errors.reference_z_m)
        if covered.any() and not covered.all():
            x_mm, y_mm = 1e3 * panel.errors.x_m, 1e3 * panel.errors.y_m
            axis.contour(x_mm, y_mm, covered, levels=[0.5], colors="0.35", linewidths=0.4)
    axis.set(xlim=box[:2], ylim=box[2:], xticks=(), yticks=(), aspect="equal")
    style: dict[str, Any] = {
        "ls": "none",
        "markeredgecolor": rcParams["xtick.color"],
        "markersize": 2.5,
        "markeredgewidth": 0.6,
    }
    for side, marker in (("x", TICKDOWN), ("y", TICKLEFT)):  # as one line each: ticks of their own are five a tick
        at_mm = ticks_mm(side, box)
        places = (at_mm, 0 * at_mm) if side == "x" else (0 * at_mm, at_mm)
        along = axis.get_xaxis_transform() if side == "x" else axis.get_yaxis_transform()
        axis.add_artist(Line2D(*places, transform=along, clip_on=False, **style | {"marker": marker}))


def ticks_mm(side: str, box: Box) -> np.ndarray:
    """The places of ticks along one side of a box; numbers at the edges of x would meet the next panel's."""
    low, high = sorted(box[:2] if side == "x" else box[2:])
    most, pruned = {"x": 2 if narrow() else 4, "y": 4 if narrow() else 5}[side], side == "x" and not narrow()
    ticks_mm = np.asarray(MaxNLocator(most, prune="both" if pruned else None).tick_values(low, high))
    return ticks_mm[(ticks_mm >= low) & (ticks_mm <= high)]


def _number(axis: Axes, side: Literal["x", "y"], box: Box) -> None:
    """Write numbers at the ticks of an outer axis; of a photograph none."""
    if axis.axison:
        axis.set(**{f"{side}ticks": ticks_mm(side, box)})
        axis.tick_params(length=2.5, width=0.6)


def edges_mm(centres_m: np.ndarray) -> tuple[float, float]:
    """Outer edges of the first and the last pixel."""
    half_m = (centres_m[-1] - centres_m[0]) / (len(centres_m) - 1) / 2
    return 1e3 * (centres_m[0] - half_m), 1e3 * (centres_m[-1] + half_m)
