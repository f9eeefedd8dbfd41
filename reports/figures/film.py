"""Films of a sequence of frames: depth and radial velocity side by side, as GIF."""

import io
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from PIL import Image

from handbench.bench.results.maps import Frames, SurfaceMap
from handbench.reports.figures.layers import depth_layers, layers_figure
from handbench.reports.figures.style import STYLE, image_bytes

MOST_FRAMES = 48  # of a film; a longer sequence is shown at evenly spaced frames
PAUSE_MS = 100  # per frame: slow enough to read its number
DPI = 130


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
