"""Depth maps and error maps, as seen from the array: x grows to the left, so that they look like the photograph."""

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colorbar import Colorbar
from matplotlib.colors import Normalize, SymLogNorm
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.ticker import MaxNLocator
from PIL import Image

from bench.results import HEADLINE, CaptureFacts, ErrorMap, Result, Surface
from reports.figures.style import Picture, methods, time_text
from reports.tables.blocks import AGAINST, DRAWN, floor_note

DEPTH_COLOURS, ERROR_COLOURS, EMPTY = "viridis_r", "RdBu_r", "#d9d9d9"
ERROR_TICKS_MM = (-30, -10, -3, -1, 0, 1, 3, 10, 30)
X_LABEL = "x in mm, growing to the left (as seen from the array)"
ABREAST = 6  # depth maps in a row, at most
PANEL, GAP, LEFT, RIGHT, TOP, BOTTOM = 1.9, 0.14, 0.8, 0.75, 0.45, 0.55  # inches

Box = tuple[float, float, float, float]  # left, right, bottom, top in mm; left > right


def panels(result: Result, capture: CaptureFacts) -> Iterator[Picture]:
    """One capture's pictures."""
    if result.about.methods:
        yield depth_maps(result, capture)
        for reference in DRAWN:
            if reference in capture.references:
                yield error_maps(result, capture, reference)


def depth_maps(result: Result, capture: CaptureFacts) -> Picture:
    """Like the paper's Fig. 3: photograph | ground truth | methods, one colour scale."""
    panels = [
        (f"{m.title}\n{time_text(result, m)} per frame", result.surface(capture.name, m.name)) for m in methods(result)
    ]
    truth = next((r for r in DRAWN if r in capture.references), None)
    if truth:
        name = {"truth": "true surface", "photogrammetry": "photogrammetry"}[truth]
        panels.insert(0, (f"ground truth\n({name})", result.surface(capture.name, truth)))
    photo = result.photo(capture.name)
    box = box_of([surface for _, surface in panels])
    figure, _, _ = sheet(panels, DEPTH_COLOURS, depth_scale(panels[0][1]), "z in mm", box, photo)
    names = ", ".join(title.replace("\n", " ") for title, _ in panels)
    return Picture(
        f"depth_{capture.name}",
        f"Capture {capture.name}: depth maps on one colour scale; grey: not observed.",
        f"Depth maps of capture {capture.name}, side by side: {'photograph, ' if photo else ''}{names}.",
        figure,
    )


def error_maps(result: Result, capture: CaptureFacts, reference: str) -> Picture:
    """Like the paper's Fig. 4: signed errors of every method, on one diverging scale for every capture."""
    maps = [(method, result.errors(capture.name, method.name, reference)) for method in methods(result)]
    box = box_of([Surface(e.x_m, e.y_m, e.reference_z_m) for _, e in maps])
    told = [(method, mean_text(result, errors.error_m)) for method, errors in maps]
    titles = [f"{method.title}\n{mean}, {time_text(result, method)}" for method, mean in told]
    shown = [(title, Surface(e.x_m, e.y_m, e.error_m)) for title, (_, e) in zip(titles, maps, strict=True)]
    figure = error_sheet(shown, [errors for _, errors in maps], box)
    first = next(r for r in DRAWN if r in capture.references)
    return Picture(
        f"error_{capture.name}" + ("" if reference == first else f"__{reference}"),
        f"Capture {capture.name}: signed errors {AGAINST[reference]}; red lies behind the reference, blue before it, "
        "grey was not observed; the line is the reference's outline. The scale, the same for every capture, is linear "
        f"within ±1 mm and logarithmic beyond.{floor_note(result)}",
        f"Error maps of capture {capture.name} {AGAINST[reference]}. "
        + "; ".join(f"{method.title}: {mean}" for method, mean in told)
        + ".",
        figure,
    )


def error_sheet(shown: list[tuple[str, Surface]], maps: list[ErrorMap], box: Box) -> Figure:
    """A figure of titled errors in metres, each with its reference's outline: where a sparse map lies on the hand."""
    figure, axes, bar = sheet(shown, ERROR_COLOURS, error_scale(), "z − z_ref in mm", box)
    for axis, errors in zip(axes, maps, strict=False):
        covered = np.isfinite(errors.reference_z_m)
        if covered.any() and not covered.all():
            x_mm, y_mm = 1e3 * errors.x_m, 1e3 * errors.y_m
            axis.contour(x_mm, y_mm, covered, levels=[0.5], colors="0.35", linewidths=0.4)
    bar.set_ticks(ERROR_TICKS_MM, labels=[f"{tick:+d}".replace("-", "−").replace("+0", "0") for tick in ERROR_TICKS_MM])
    bar.minorticks_off()
    return figure


def error_scale() -> SymLogNorm:
    """The scale of signed errors in mm, the same everywhere: linear within ±1 mm, logarithmic to ±50 mm."""
    return SymLogNorm(linthresh=1, linscale=0.6, vmin=-50, vmax=50)


def mean_text(result: Result, error_m: np.ndarray) -> str:
    """Mean absolute error of one map, in words."""
    seen = error_m[np.isfinite(error_m)]
    return f"{result.title(HEADLINE)} {1e3 * np.abs(seen).mean():.2f} mm" if len(seen) else "nothing observed"


def sheet(
    maps: list[tuple[str, Surface]], colours: str, norm: Normalize, label: str, box: Box, photo: Path | None = None
) -> tuple[Figure, list[Axes], Colorbar]:
    """A figure with a panel for each titled map in rows, a photograph at their left and the colour bar at their right;
    numbers and names stand on the outer axes only, and nothing where no panel is."""
    rows = math.ceil(len(maps) / ABREAST)
    columns = math.ceil(len(maps) / rows)
    shape = min(max((box[3] - box[2]) / (box[0] - box[1]), 0.5), 2.2)
    wide, high = PANEL, PANEL * shape
    picture = np.asarray(Image.open(photo).convert("RGB")) if photo else np.zeros((1, 0, 3))
    photo_wide = min(high * picture.shape[1] / picture.shape[0], 1.4 * wide)
    left = photo_wide + LEFT
    width, height = left + columns * (wide + GAP) + RIGHT, BOTTOM + rows * (high + TOP)
    figure = Figure(figsize=(width, height))

    def place(x: float, y: float, w: float, h: float) -> Axes:
        return figure.add_axes((x / width, y / height, w / width, h / height))

    if photo:
        axis = place(0.1, BOTTOM + (rows - 1) * (high + TOP), photo_wide, high)
        axis.imshow(picture)
        axis.set(title="photograph", anchor="N")
        axis.set_axis_off()
    bottoms = [BOTTOM + (rows - 1 - row) * (high + TOP) for row in range(rows)]
    axes = [place(left + column * (wide + GAP), y, wide, high) for y in bottoms for column in range(columns)]
    bar_axis = place(width - RIGHT, BOTTOM, 0.14, bottoms[0] + high - BOTTOM)
    figure.text(left / width + columns * (wide + GAP) / 2 / width, 0.08 / height, X_LABEL, ha="center", va="bottom")
    for axis, (title, surface) in zip(axes, maps, strict=False):
        image = _draw(axis, surface, colours, norm, box)
        axis.set_title(title)
    for axis in axes[-columns:]:
        axis.tick_params(labelbottom=True)
    for axis in axes[::columns]:
        axis.tick_params(labelleft=True)
        axis.set_ylabel("y in mm")
    for axis in axes[len(maps) :]:
        axis.set_axis_off()
    return figure, axes, figure.colorbar(image, cax=bar_axis, label=label, extend="both")


def box_of(surfaces: list[Surface], margin_mm: float = 8) -> Box:
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


def _draw(axis: Axes, surface: Surface, colours: str, norm: Normalize, box: Box) -> AxesImage:
    """One map in mm, pixel for pixel on its even grid, cut to `box`."""
    axis.set_facecolor(EMPTY)
    colour_map = colormaps[colours].with_extremes(bad=EMPTY)
    values_mm = np.ma.masked_invalid(1e3 * surface.z_m)
    extent = (*_edges_mm(surface.x_m), *_edges_mm(surface.y_m))
    image = axis.imshow(values_mm, colour_map, norm, interpolation="nearest", origin="lower", extent=extent)
    axis.set(xlim=box[:2], ylim=box[2:], aspect="equal")
    axis.yaxis.set_major_locator(MaxNLocator(5))
    axis.xaxis.set_major_locator(MaxNLocator(4, prune="both"))  # numbers at the edges would meet the next panel's
    axis.tick_params(labelbottom=False, labelleft=False, length=2.5, width=0.6)
    return image


def _edges_mm(centres_m: np.ndarray) -> tuple[float, float]:
    """Outer edges of the first and the last pixel."""
    half_m = (centres_m[-1] - centres_m[0]) / (len(centres_m) - 1) / 2
    return 1e3 * (centres_m[0] - half_m), 1e3 * (centres_m[-1] + half_m)
