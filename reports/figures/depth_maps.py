"""Figures of depth maps and error maps, as seen from the array, so that x grows to the left; and
films of a sequence of frames: depth and radial velocity side by side, as GIF."""

import io
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from handbench.bench.evaluation.depth_errors import ErrorMap
from handbench.bench.results.about import CaptureFacts
from handbench.bench.results.maps import Frames, SurfaceMap
from handbench.bench.results.result_folder import Result
from handbench.reports.figures.layers import (
    SIGNED,
    Layer,
    depth_layer,
    depth_layers,
    depth_scale,
    error_layer,
    layers_figure,
    sheet,
)
from handbench.reports.figures.style import (
    STYLE,
    Picture,
    drawn_references,
    image_bytes,
    methods,
    styled,
    time_text,
)
from handbench.reports.tables.table import against

COLOURS = f"{SIGNED}. Line: outline of the reference."
MOST_FRAMES = 48  # of a film; a longer sequence is shown at evenly spaced frames
PAUSE_MS = 100  # per frame: slow enough to read its number
DPI = 130


def panels(result: Result, capture: CaptureFacts) -> Iterator[Picture]:
    """Yield the pictures of one capture: the depth maps of all methods with their errors against
    the first reference surface, and a picture of the errors for each further reference."""
    if result.about.methods:
        references = drawn_references([capture])
        yield depth_maps(result, capture, *references[:1])
        for reference in references[1:]:
            yield error_maps(result, capture, reference)


def depth_maps(result: Result, capture: CaptureFacts, reference: str = "") -> Picture:
    """Draw the depth maps of all methods next to the reference surface, on one colour scale as in
    the paper's Fig. 3 and 4.
    Below them are the photograph, if there is one, and the methods' signed errors. Without a
    reference, there are no errors."""
    maps = [
        (f"{method.title}\n{time_text(result, method)}", result.surface(capture.name, method.name))
        for method in methods(result)
    ]
    errors: list[Layer] = []
    below = "."
    if reference:
        truth = result.surface(capture.name, reference)
        maps.insert(0, ("ground truth", truth))
        errors = _errors(result, capture, reference)
        below = f"; below them their errors {against(result, reference)}: {COLOURS}"
    photo = result.photo(capture.name)
    titles = ", ".join(title for title, _ in maps) + ", photograph" * bool(photo)
    return Picture(
        f"depth_{capture.name}",
        f"Capture {capture.name}: depth maps on one colour scale, with the time per frame; grey: "
        f"not observed{below}",
        f"Depth maps of capture {capture.name}, side by side: {titles}. {_text(errors)}",
        _compared(maps, errors, np.asarray(Image.open(photo).convert("RGB")) if photo else None),
    )


def error_maps(result: Result, capture: CaptureFacts, reference: str) -> Picture:
    """Draw the signed errors of every method against one reference surface, as in the paper's Fig.
    4. The colour scale is the same for all captures."""
    errors = _errors(result, capture, reference)
    return Picture(
        f"error_{capture.name}__{reference}",
        f"Capture {capture.name}: signed errors {against(result, reference)}: {COLOURS}",
        f"Error maps of capture {capture.name} {against(result, reference)}. {_text(errors)}",
        sheet([errors]),
    )


def methods_figure(title: str, shown: Sequence[tuple[str, np.ndarray, ErrorMap]]) -> Figure:
    """Draw a surface and the depth maps of several methods in a row, with their signed errors
    below.
    title: the surface's. shown: for each method, its title, its depths z_m [ny, nx] in metres (NaN
    where not observed), and its error map, whose reference depths are the surface."""
    errors = [error_layer(of, method) for method, _, of in shown]
    maps = [(method, SurfaceMap(of.x_m, of.y_m, z_m)) for method, z_m, of in shown]
    of = shown[0][2]
    surface = SurfaceMap(of.x_m, of.y_m, of.reference_z_m)
    with styled(STYLE):
        return _compared([(title, surface), *maps], errors)


def _compared(
    maps: Sequence[tuple[str, SurfaceMap]], errors: Sequence[Layer], photo: np.ndarray | None = None
) -> Figure:
    """Draw depth maps, with their titles, on the colour scale of the first, and below it a
    photograph [ny, nx, 3], and below the others their errors."""
    scale = depth_scale(maps[0][1])
    depths = [depth_layer(title, surface, scale) for title, surface in maps]
    return sheet([depths, [photo, *errors]])


def _errors(result: Result, capture: CaptureFacts, reference: str) -> list[Layer]:
    """Return a panel of each method's signed errors for one capture."""
    return [
        error_layer(result.errors(capture.name, method.name, reference), method.title)
        for method in methods(result)
    ]


def _text(errors: Sequence[Layer]) -> str:
    """Describe panels of errors for screen readers by their titles."""
    return "; ".join(layer.title.replace("\n", ": ") for layer in errors)


def film(frames: Frames, title: str) -> bytes:
    """Return a film of all frames as the bytes of a GIF: depth, and radial velocity in red away
    from the array and blue towards it, on colour scales that all frames share."""
    pictures = list(_pictures(frames, title))
    # all have the colours of the first, in which the colour bars have every colour
    palette = pictures[0].quantize(method=Image.Quantize.MAXCOVERAGE)
    first, *others = (p.quantize(palette=palette, dither=Image.Dither.NONE) for p in pictures)
    stream = io.BytesIO()
    first.save(stream, "GIF", save_all=True, append_images=others, duration=PAUSE_MS, loop=0)
    return stream.getvalue()


def _pictures(frames: Frames, title: str) -> Iterator[Image.Image]:
    """Draw the frames of a film, at most MOST_FRAMES."""
    count = len(frames.times_s)
    layers = depth_layers(SurfaceMap(frames.x_m, frames.y_m, frames.z_m), vars(frames))
    # shows what any frame shows, so that its axes suit them all
    figure = layers_figure([replace(of, values=np.fmax.reduce(of.values)) for of in layers], title)
    for n in np.unique(np.linspace(0, count - 1, min(count, MOST_FRAMES)).round().astype(int)):
        time_ms = 1e3 * (frames.times_s[n] - frames.times_s[0])
        for axis, layer in zip(figure.axes, layers, strict=False):  # colour bars have axes, too
            axis.images[0].set_data(layer.values[n])
        figure.suptitle(f"{title}: frame {n}, {time_ms:.0f} ms")
        content = image_bytes(figure, style=STYLE | {"savefig.dpi": DPI})
        yield Image.open(io.BytesIO(content)).convert("RGB")
