"""Panels that show a map over x and y in millimetres, their colour scales, and figures made of
several panels."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import matplotlib
import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, Normalize, SymLogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from handbench.bench.evaluation.depth_errors import ErrorMap
from handbench.bench.results.maps import SurfaceMap
from handbench.reports.figures.style import STYLE, narrow

DEPTH_COLOURS, ERROR_COLOURS, EMPTY = "viridis_r", "RdBu_r", "#d9d9d9"
SIGNED = (  # what the colours of an error map mean
    "red is behind the reference, blue in front; the scale is linear within ±1 mm, and logarithmic "
    "from there to ±50 mm"
)
ERROR_TICKS_MM = (-30, -10, -3, -1, 0, 1, 3, 10, 30)
SKIN, INVENTED = (0.93, 0.77, 0.67), (0.72, 0.72, 0.76)
# of the eye's axes: from the upper left, a little before the surface
LIGHT = np.array([-0.45, 0.55, 0.70])
HIGH_IN, LEFT_IN, RIGHT_IN = 2.6, 0.7, 0.8  # of a panel, and next to it: names, and a colour bar
MARGIN_MM = 8  # of a picture around its surfaces
DECIBELS: dict[str, Any] = {
    "colours": "magma",
    "norm": Normalize(-40, 0),
    "label": "dB below the maximum",
}
SIGMAS: dict[str, Any] = {
    "colours": "cividis",
    "norm": LogNorm(0.01, 10),
    "ticks": (0.01, 0.1, 1, 10),
}
KNOWN: dict[str, tuple[float, dict[str, Any]]] = {  # maps besides the depth: units, style
    "amplitude_db": (1, DECIBELS | {"title": "amplitude"}),
    "sigma_m": (1e3, SIGMAS | {"title": "predicted error", "label": "σ in mm"}),
    "p_gross": (
        1,
        {
            "title": "probability to be off by > 5 mm",
            "colours": "plasma",
            "norm": Normalize(0, 1),
            "label": " ",
        },
    ),
}

Box = tuple[float, float, float, float]  # left, right, bottom, top in mm; left > right


@dataclass(frozen=True)
class Layer:
    """One panel of a figure: a map of values [ny, nx] or of RGB colours [ny, nx, 3], at evenly
    spaced pixel centres x_mm [nx], y_mm [ny].

    For values: colours is the name of a colour map, norm the colour scale, label the label of the
    colour bar ("": no colour bar) and ticks its numbers. outline [ny, nx]: True for the
    pixels around which a line is drawn; box: the visible part (None: all).
    """

    title: str
    x_mm: np.ndarray
    y_mm: np.ndarray
    values: np.ndarray
    colours: str = ""
    norm: Normalize | None = None
    label: str = ""
    outline: np.ndarray | None = None
    box: Box | None = None
    ticks: tuple[float, ...] = ()

    @property
    def shown_mm(self) -> Box:
        """The visible part as left, right, bottom, top in mm: the panel's box or, without one, the
        outer edges of its pixels. Left is larger than right, because x grows to the left."""
        (low, high), (bottom, top) = edges(self.x_mm), edges(self.y_mm)
        return self.box or (high, low, bottom, top)

    def draw(self, axis: Axes) -> None:
        """Draw the map on an axis, pixel by pixel, with the outline if there is one."""
        axis.set_facecolor(EMPTY)
        colours = colormaps[self.colours].with_extremes(bad=EMPTY) if self.colours else None
        shown = np.ma.masked_invalid(self.values) if colours else self.values
        extent = (*edges(self.x_mm), *edges(self.y_mm))
        axis.imshow(
            shown, colours, self.norm, interpolation="nearest", origin="lower", extent=extent
        )
        if self.outline is not None and self.outline.any() and not self.outline.all():
            axis.contour(
                self.x_mm, self.y_mm, self.outline, levels=[0.5], colors="0.35", linewidths=0.4
            )

    def draw_bar(self, axis: Axes) -> None:
        """Draw the colour scale on an axis. Ticks of a scale of signed values have signs."""
        scale = ScalarMappable(self.norm, self.colours)
        bar = axis.figure.colorbar(scale, cax=axis, extend="both")
        bar.set_label(self.label, labelpad=1)
        if self.ticks:
            ticks = self.ticks[:: 2 if narrow() else 1]
            form = "{:+g}" if ticks[0] < 0 else "{:g}"
            labels = [form.format(tick).replace("-", "−").replace("+0", "0") for tick in ticks]
            bar.set_ticks(ticks, labels=labels)
            bar.minorticks_off()


def layers_figure(layers: Sequence[Layer], title: str) -> Figure:
    """Draw panels in a row under one title, with the same scale in all panels.
    The horizontal axis (x, or z in a view from the side) grows to the left, unless its values are
    descending."""
    spans_mm = np.abs(
        [(box[0] - box[1], box[3] - box[2]) for box in (layer.shown_mm for layer in layers)]
    )
    sizes_in = np.maximum(HIGH_IN * spans_mm / spans_mm[:, 1].max(), 0.3)
    rights_in = [RIGHT_IN if layer.label else 0.1 for layer in layers]
    width, height, x = (
        sizes_in[:, 0].sum() + len(layers) * LEFT_IN + sum(rights_in),
        HIGH_IN + 1.05,
        LEFT_IN,
    )
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(width, height))
        figure.suptitle(title, fontsize=9, y=1 - 0.06 / height)
        for layer, (wide, high), right in zip(layers, sizes_in, rights_in, strict=True):
            y, box = 0.5 + (HIGH_IN - high) / 2, layer.shown_mm
            axis = figure.add_axes((x / width, y / height, wide / width, high / height))
            layer.draw(axis)
            axis.set(
                xlabel="x in mm", ylabel="y in mm", title=layer.title, xlim=box[:2], ylim=box[2:]
            )
            axis.xaxis.set_major_locator(MaxNLocator(2 if wide < 1.6 else 4))
            if layer.label:
                place = ((x + wide + 0.07) / width, y / height, 0.11 / width, high / height)
                layer.draw_bar(figure.add_axes(place))
            x += wide + right + LEFT_IN
    return figure


def edges(centres: np.ndarray) -> tuple[float, float]:
    """Return the outer edges of the first and the last of evenly spaced pixels, in the unit of
    their centres [n]."""
    half = (centres[-1] - centres[0]) / (len(centres) - 1) / 2
    return centres[0] - half, centres[-1] + half


def box_of(surfaces: Sequence[SurfaceMap]) -> Box:
    """Return the box around all pixels in which any of the surfaces has a depth, widened by
    8 mm (MARGIN_MM): left, right, bottom, top in mm. If none has a depth, the box is around all
    pixels."""
    x_mm = 1e3 * np.concatenate([s.x_m[np.isfinite(s.z_m).any(axis=0)] for s in surfaces])
    y_mm = 1e3 * np.concatenate([s.y_m[np.isfinite(s.z_m).any(axis=1)] for s in surfaces])
    if not len(x_mm):
        x_mm, y_mm = 1e3 * surfaces[0].x_m, 1e3 * surfaces[0].y_m
    return (
        x_mm.max() + MARGIN_MM,
        x_mm.min() - MARGIN_MM,
        y_mm.min() - MARGIN_MM,
        y_mm.max() + MARGIN_MM,
    )


def depth_scale(surface: SurfaceMap) -> Normalize:
    """Return the colour scale for the depths of a surface, mm: their range, extended by 2.5 mm at
    both ends and rounded outwards to 5 mm."""
    z_mm = 1e3 * surface.z_m[np.isfinite(surface.z_m)]
    if not len(z_mm):
        return Normalize(0, 1)
    return Normalize(5 * math.floor(z_mm.min() / 5 - 0.5), 5 * math.ceil(z_mm.max() / 5 + 0.5))


def velocity_scale(velocity_m_s: np.ndarray) -> Normalize:
    """Return the colour scale for radial velocities of any shape, m/s: as wide on both sides of 0
    as the fastest pixel but one of two hundred, rounded up to two digits."""
    seen = np.abs(velocity_m_s[np.isfinite(velocity_m_s)])
    fastest = float(np.percentile(seen, 99.5)) if len(seen) else 0.0
    digit = 10.0 ** math.floor(math.log10(max(fastest, 1e-3)) - 1)
    limit = digit * math.ceil(max(fastest, 1e-3) / digit)
    return Normalize(-limit, limit)


def error_scale() -> SymLogNorm:
    """Return the colour scale of signed errors, mm, the same in all pictures: linear within ±1 mm,
    and logarithmic from there to ±50 mm."""
    return SymLogNorm(linthresh=1, linscale=0.6, vmin=-50, vmax=50)


def depth_layer(title: str, surface: SurfaceMap, norm: Normalize) -> Layer:
    """Return a panel of a surface's depths in mm on the colour scale `norm`, cut to the box around
    the pixels that have a depth."""
    x_mm, y_mm, z_mm = 1e3 * surface.x_m, 1e3 * surface.y_m, 1e3 * surface.z_m
    return Layer(title, x_mm, y_mm, z_mm, DEPTH_COLOURS, norm, "z in mm", box=box_of([surface]))


def velocity_layer(surface: SurfaceMap, velocity_m_s: np.ndarray, norm: Normalize) -> Layer:
    """Return a panel of a surface's radial velocities [ny, nx] on the colour scale `norm`: red away
    from the array, blue towards it."""
    depth = depth_layer("radial velocity in m/s", surface, norm)
    return replace(depth, values=velocity_m_s, colours=ERROR_COLOURS, label=" ")


def depth_layers(surface: SurfaceMap, others: dict[str, np.ndarray]) -> list[Layer]:
    """Return a panel of a surface's depths, and one for each of radial velocity, amplitude,
    predicted σ and probability of a gross error that `others` contains.
    others: name of a map (velocity_m_s, amplitude_db, sigma_m or p_gross; others are ignored) → its
    values [ny, nx]."""
    layers = [depth := depth_layer("depth", surface, depth_scale(surface))]
    if (velocity_m_s := others.get("velocity_m_s")) is not None:
        layers.append(velocity_layer(surface, velocity_m_s, velocity_scale(velocity_m_s)))
    known = [(unit * others[name], look) for name, (unit, look) in KNOWN.items() if name in others]
    return layers + [replace(depth, values=values, **look) for values, look in known]


def error_layer(errors: ErrorMap, title: str | None = None) -> Layer:
    """Return a panel of signed errors z − z_ref with the outline of the reference: red is behind
    the reference surface, blue in front of it. If `title` is None, the title is the mean absolute
    error."""
    return Layer(
        mean_text(errors.error_m) if title is None else title,
        1e3 * errors.x_m,
        1e3 * errors.y_m,
        1e3 * errors.error_m,
        ERROR_COLOURS,
        error_scale(),
        "z − z_ref in mm",
        outline=np.isfinite(errors.reference_z_m),
        box=box_of([SurfaceMap(errors.x_m, errors.y_m, errors.reference_z_m)]),
        ticks=ERROR_TICKS_MM,
    )


def mean_text(error_m: np.ndarray) -> str:
    """Return the mean of |error| over the observed pixels as text, such as "MAE 1.23 mm".
    error_m [ny, nx]: signed errors in metres, NaN where unobserved."""
    seen = error_m[np.isfinite(error_m)]
    return f"MAE {1e3 * np.abs(seen).mean():.2f} mm" if len(seen) else "nothing observed"


def shade(surface: SurfaceMap) -> np.ndarray:
    """Return the brightness [ny, nx, 1], 0 to 1, of a surface that is lit from the upper left and
    seen from the array, with x to the left."""
    slope_y, slope_x = np.gradient(surface.z_m, surface.y_m, surface.x_m)
    # in the eye's axes: x and z are turned
    normal = np.stack([-slope_x, slope_y, np.ones_like(surface.z_m)], axis=-1)
    light = normal @ (LIGHT / np.linalg.norm(LIGHT)) / np.linalg.norm(normal, axis=-1)
    return np.nan_to_num(0.35 + 0.65 * np.clip(light, 0, 1), nan=0.6)[..., None]


def shaded_colours(surface: SurfaceMap, seen: np.ndarray) -> np.ndarray:
    """Return RGB colours [ny, nx, 3], 0 to 1, of a shaded surface: skin colour where `seen` [ny,
    nx] is True, grey where the surface was interpolated, white where there is none."""
    colours = np.where(seen[..., None], SKIN, INVENTED) * shade(surface)
    return np.where(np.isfinite(surface.z_m)[..., None], colours, 1.0)
