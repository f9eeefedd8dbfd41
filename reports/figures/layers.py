"""Panels that show a map over x and y in millimetres, as seen from the array, their colour scales,
and figures made of several panels."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, Normalize, SymLogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from handbench.bench.evaluation.depth_errors import ErrorMap
from handbench.bench.results.maps import SurfaceMap
from handbench.reports.figures.style import STYLE, narrow, styled
from handbench.reports.tables.rounding import figure as rounded

DEPTH_COLOURS, ERROR_COLOURS, EMPTY = "viridis_r", "RdBu_r", "#d9d9d9"
SIGNED = (  # what the colours of an error map mean
    "red is behind the reference, blue in front; the scale is linear within ±1 mm, and logarithmic "
    "from there to ±50 mm"
)
ERROR_TICKS_MM = (-30, -10, -3, -1, 0, 1, 3, 10, 30)
SKIN = (0.93, 0.77, 0.67)
# of the eye's axes: from the upper left, a little before the surface
LIGHT = np.array([-0.45, 0.55, 0.70])
MARGIN_MM = 8  # of a picture around its surfaces
ABREAST = 6  # panels in a row at most
PAPER_IN = 7.16  # of two columns of a paper
WIDE_IN = 1.9  # of a panel at most
GAP_IN = 0.12  # between panels
LEFT_IN, BOTTOM_IN = 0.7, 0.55  # of the numbers and labels of the axes
RIGHT_IN = 0.85  # of a colour bar and its numbers
LINE_IN = 0.16  # of a line of a title
LETTERS_PER_IN = 13  # of a title

Box = tuple[float, float, float, float]  # left, right, bottom, top in mm; left > right


@dataclass(frozen=True)
class Scale:
    """How a map is coloured: name of a colour map, colour scale, label of the colour bar, and its
    numbers (empty: chosen)."""

    colours: str
    norm: Normalize
    label: str
    ticks: tuple[float, ...] = ()

    def draw(self, axis: Axes) -> None:
        """Draw the colour bar at the right of an axis. Numbers of signed values have signs."""
        figure: Any = axis.figure
        image = ScalarMappable(self.norm, self.colours)
        bar = figure.colorbar(image, cax=axis.inset_axes((1.04, 0, 0.07, 1)), extend="both")
        bar.set_label(self.label, labelpad=1)
        bar.ax.grid(False)
        if self.ticks:
            form = "{:+g}" if self.ticks[0] < 0 else "{:g}"
            texts = [form.format(tick).replace("-", "−").replace("+0", "0") for tick in self.ticks]
            bar.set_ticks(self.ticks, labels=texts)
            bar.minorticks_off()


SIGMAS = Scale("cividis", LogNorm(0.01, 10), "σ in mm", (0.01, 0.1, 1, 10))
ERRORS = Scale(
    ERROR_COLOURS,
    SymLogNorm(linthresh=1, linscale=0.6, vmin=-50, vmax=50),
    "z − z_ref in mm",
    ERROR_TICKS_MM,
)
KNOWN = {  # maps besides the depth: title, factor to the scale's unit, scale
    "amplitude_db": ("amplitude", 1, Scale("magma", Normalize(-40, 0), "dB below the maximum")),
    "sigma_m": ("predicted error", 1e3, SIGMAS),
    "p_gross": ("gross error (> 5 mm)", 1, Scale("plasma", Normalize(0, 1), "probability")),
}


@dataclass(frozen=True)
class Layer:
    """One panel of a figure: a map of values [ny, nx], NaN where unknown, at evenly spaced pixel
    centres x_mm [nx], y_mm [ny].
    outline [ny, nx]: True for the pixels around which a line is drawn."""

    title: str
    x_mm: np.ndarray
    y_mm: np.ndarray
    values: np.ndarray
    scale: Scale
    outline: np.ndarray | bool = False

    def draw(self, axis: Axes, box: Box) -> None:
        """Draw the map on an axis, pixel by pixel, with the outline if there is one.
        box: the visible part."""
        extent = (*edges(self.x_mm), *edges(self.y_mm))
        axis.imshow(self.values, self.scale.colours, self.scale.norm, extent=extent)
        if np.any(self.outline) and not np.all(self.outline):
            x_mm, y_mm = self.x_mm, self.y_mm
            axis.contour(x_mm, y_mm, self.outline, levels=[0.5], colors="0.35", linewidths=0.4)
        axis.set(xlim=box[:2], ylim=box[2:], facecolor=EMPTY)
        low_mm, high_mm = np.interp([0.05, 0.95], [0, 1], box[1::-1])
        ticks_mm = np.asarray(MaxNLocator(4).tick_values(low_mm, high_mm))
        # none at the ends, where its number would touch that of the next panel
        axis.set_xticks(ticks_mm[(ticks_mm > low_mm) & (ticks_mm < high_mm)])


# maps, photographs' pixels [ny, nx, 3], or empty places
Row = Sequence[Layer | np.ndarray | None]


def sheet(rows: Sequence[Row], title: str = "") -> Figure:
    """Draw rows of panels as one figure, with a colour bar at the right of neighbours of one scale.
    A row that is too long is broken into several. Only outer axes have numbers and labels,
    and all show the box around what any of them knows. In a paper, the figure spans two columns."""
    layers = [panel for row in rows for panel in row if isinstance(panel, Layer)]
    box = box_of(layers)
    count = max(map(len, rows))
    columns = math.ceil(count / math.ceil(count / ABREAST))
    starts = range(0, count, columns)
    turns = [row[i : i + columns] for i in starts for row in rows]
    turns = [turn for turn in turns if any(panel is not None for panel in turn)]
    bars = [_bars(turn, columns) for turn in turns]
    gap = RIGHT_IN if max(map(len, bars)) > 1 else GAP_IN
    most_in = (PAPER_IN - LEFT_IN - RIGHT_IN) / columns - gap if narrow() else WIDE_IN
    wide_in = min(WIDE_IN, most_in)
    high_in = wide_in * min(max((box[3] - box[2]) / (box[0] - box[1]), 0.5), 2.2)
    titles = [[_title(panel, wide_in) for panel in turn] for turn in turns]
    title_in = LINE_IN * (1.5 + max(text.count("\n") for turn in titles for text in turn))
    width = LEFT_IN + columns * (wide_in + gap) - gap + RIGHT_IN
    top_in = 2 * LINE_IN if title else 0
    height = BOTTOM_IN + len(turns) * (high_in + title_in) + top_in
    figure = Figure(figsize=(width, height))
    axes = figure.subplots(len(turns), columns, squeeze=False)
    figure.subplots_adjust(
        left=LEFT_IN / width,
        right=1 - RIGHT_IN / width,
        bottom=BOTTOM_IN / height,
        top=1 - (top_in + title_in) / height,
        wspace=gap / wide_in,
        hspace=title_in / high_in,
    )
    for turn, texts, scales, row_axes in zip(turns, titles, bars, axes, strict=True):
        for axis, panel, text in zip_longest(row_axes, turn, texts):
            axis.set_title(text, y=1.0)  # given, because finding y takes as long as drawing
            _draw(axis, panel, box)
        for scale, last in scales.items():
            scale.draw(row_axes[last])
    figure.supxlabel("x in mm, as seen from the array")
    figure.supylabel("y in mm")
    figure.suptitle(title)
    return figure


def _bars(turn: Row, columns: int) -> dict[Scale, int]:
    """Return the scales of a row of panels, each with the column at whose right its bar is."""
    scales = [(panel.scale, i) for i, panel in enumerate(turn) if isinstance(panel, Layer)]
    if scales:
        scales.append((scales[-1][0], columns - 1))
    return dict(scales)


def _title(panel: Layer | np.ndarray | None, wide_in: float) -> str:
    title = panel.title if isinstance(panel, Layer) else "" if panel is None else "photograph"
    letters = round(LETTERS_PER_IN * wide_in)
    return "\n".join(fill(line, letters) for line in title.split("\n"))


def _draw(axis: Axes, panel: Layer | np.ndarray | None, box: Box) -> None:
    axis.grid(False)
    if isinstance(panel, Layer):
        panel.draw(axis, box)
        axis.label_outer()
        return
    axis.set_axis_off()
    if panel is not None:
        axis.imshow(panel, origin="upper")
        axis.set_anchor("N")


def layers_figure(layers: Sequence[Layer], title: str = "") -> Figure:
    """Draw panels in a row under one title."""
    with styled(STYLE):
        return sheet([layers], title)


def edges(centres: np.ndarray) -> tuple[float, float]:
    """Return the outer edges of the first and the last of evenly spaced pixels, in the unit of
    their centres [n]. A single one is one unit wide."""
    half = (centres[-1] - centres[0]) / (len(centres) - 1) / 2 if len(centres) > 1 else 0.5
    return centres[0] - half, centres[-1] + half


def box_of(layers: Sequence[Layer]) -> Box:
    """Return the box around all pixels in which any of the maps has a value or an outline, widened
    by 8 mm (MARGIN_MM). If there are none, the box is around all pixels of the first map."""
    shown = [(layer, np.isfinite(layer.values) | layer.outline) for layer in layers]
    x_mm = np.concatenate([layer.x_mm[seen.any(axis=0)] for layer, seen in shown])
    y_mm = np.concatenate([layer.y_mm[seen.any(axis=1)] for layer, seen in shown])
    if not len(x_mm):
        x_mm, y_mm = layers[0].x_mm, layers[0].y_mm
    left, right = x_mm.max() + MARGIN_MM, x_mm.min() - MARGIN_MM
    return left, right, y_mm.min() - MARGIN_MM, y_mm.max() + MARGIN_MM


def depth_scale(surface: SurfaceMap) -> Scale:
    """Return the colours for the depths of a surface, mm: their range, extended by 2.5 mm at both
    ends and rounded outwards to 5 mm."""
    z_mm = 1e3 * surface.z_m[np.isfinite(surface.z_m)]
    low, high = (z_mm.min(), z_mm.max()) if len(z_mm) else (0, 0)
    norm = Normalize(5 * math.floor(low / 5 - 0.5), 5 * math.ceil(high / 5 + 0.5))
    return Scale(DEPTH_COLOURS, norm, "z in mm")


def velocity_scale(velocity_m_s: np.ndarray) -> Scale:
    """Return the colours for radial velocities of any shape, m/s, red away from the array, blue
    towards it: as wide on both sides of 0 as the fastest pixel but one of two hundred, rounded up
    to two digits."""
    seen = np.abs(velocity_m_s[np.isfinite(velocity_m_s)])
    fastest = max(np.percentile(seen, 99.5), 1e-3) if len(seen) else 1e-3
    digit = 10.0 ** math.floor(math.log10(fastest) - 1)
    limit = digit * math.ceil(fastest / digit)
    return Scale(ERROR_COLOURS, Normalize(-limit, limit), "radial velocity in m/s")


def depth_layer(title: str, surface: SurfaceMap, scale: Scale) -> Layer:
    """Return a panel of a surface's depths in mm."""
    return Layer(title, 1e3 * surface.x_m, 1e3 * surface.y_m, 1e3 * surface.z_m, scale)


def depth_layers(surface: SurfaceMap, others: Mapping[str, np.ndarray]) -> list[Layer]:
    """Return a panel of a surface's depths, and one for each of radial velocity, amplitude,
    predicted σ and probability of a gross error that `others` contains.
    others: name of a map (velocity_m_s, amplitude_db, sigma_m or p_gross; others are ignored) → its
    values [ny, nx]."""
    depth = depth_layer("depth", surface, depth_scale(surface))
    layers = [depth]
    if "velocity_m_s" in others:
        velocity_m_s = others["velocity_m_s"]
        scale = velocity_scale(velocity_m_s)
        layers.append(replace(depth, title="velocity", values=velocity_m_s, scale=scale))
    for name, (title, factor, scale) in KNOWN.items():
        if name in others:
            layers.append(replace(depth, title=title, values=factor * others[name], scale=scale))
    return layers


def error_layer(errors: ErrorMap, name: str) -> Layer:
    """Return a panel of a method's signed errors z − z_ref with the outline of the reference: red
    is behind the reference surface, blue in front of it."""
    outline = np.isfinite(errors.reference_z_m)
    map_mm = 1e3 * errors.x_m, 1e3 * errors.y_m, 1e3 * errors.error_m
    return Layer(f"{name}\n{mean_text(errors.error_m)}", *map_mm, ERRORS, outline)


def mean_text(error_m: np.ndarray) -> str:
    """Return the mean of |error| over the observed pixels as text, such as "MAE 1.2 mm".
    error_m [ny, nx]: signed errors in metres, NaN where unobserved."""
    seen = error_m[np.isfinite(error_m)]
    mean_mm = 1e3 * np.abs(seen).mean() if len(seen) else None
    return f"MAE {rounded(mean_mm, unit='mm')} mm" if len(seen) else "nothing observed"


def shade(surface: SurfaceMap) -> np.ndarray:
    """Return the brightness [ny, nx, 1], 0 to 1, of a surface that is lit from the upper left and
    seen from the array, with x to the left."""
    slope_y, slope_x = (
        np.gradient(surface.z_m, axis_m, axis=n) if len(axis_m) > 1 else 0 * surface.z_m
        for n, axis_m in enumerate((surface.y_m, surface.x_m))
    )
    # in the eye's axes: x and z are turned
    normal = np.stack([-slope_x, slope_y, np.ones_like(surface.z_m)], axis=-1)
    light = normal @ (LIGHT / np.linalg.norm(LIGHT)) / np.linalg.norm(normal, axis=-1)
    return np.nan_to_num(0.35 + 0.65 * np.clip(light, 0, 1), nan=0.6)[..., None]
