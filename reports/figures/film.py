"""Films of a sequence of frames: depth and radial velocity side by side, as GIF."""

import io
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from PIL import Image

from handbench.bench.results import Frames, SurfaceMap
from handbench.reports.figures.layers import (
    box_of,
    depth_layer,
    depth_scale,
    layers_figure,
    velocity_layer,
    velocity_scale,
)
from handbench.reports.figures.style import STYLE

MOST_FRAMES = 48  # of a film; a longer sequence is shown at evenly spaced frames
PAUSE_MS = 100  # per frame: slow enough to read its number
DPI, COLOURS = 100, 96  # of a frame; so many keep 48 frames below 2 MB


def film(frames: Frames, title: str) -> bytes:
    """Return a film of all frames as the bytes of a GIF: depth, and radial velocity in red away
    from the array and blue towards it, on colour scales that all frames share."""
    pictures = [
        picture.quantize(COLOURS, dither=Image.Dither.NONE) for picture in _pictures(frames, title)
    ]
    stream, first = io.BytesIO(), pictures[0]
    first.save(stream, "GIF", save_all=True, append_images=pictures[1:], duration=PAUSE_MS, loop=0)
    return stream.getvalue()


def _pictures(frames: Frames, title: str) -> Iterator[Image.Image]:
    """Draw the frames of a film, at most MOST_FRAMES."""
    count = len(frames.times_s)
    whole = [SurfaceMap(frames.x_m, frames.y_m, z_m) for z_m in frames.z_m]
    box, depths = box_of(whole), depth_scale(SurfaceMap(frames.x_m, frames.y_m, frames.z_m))
    speeds = velocity_scale(frames.velocity_m_s)
    for n in np.unique(np.linspace(0, count - 1, min(count, MOST_FRAMES)).round().astype(int)):
        time_ms = 1e3 * (frames.times_s[n] - frames.times_s[0])
        layers = [
            depth_layer("depth", whole[n], depths),
            velocity_layer(whole[n], frames.velocity_m_s[n], speeds),
        ]
        figure = layers_figure(
            [replace(layer, box=box) for layer in layers], f"{title}: frame {n}, {time_ms:.0f} ms"
        )
        figure.set_dpi(DPI)
        with rc_context(STYLE):
            canvas = FigureCanvasAgg(figure)
            canvas.draw()
        yield Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
