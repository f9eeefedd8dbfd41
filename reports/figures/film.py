"""Films of a sequence of frames: depth and radial velocity side by side, as GIF."""

import io
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from matplotlib import colormaps, rc_context
from PIL import Image

from handbench.bench.results.maps import Frames, SurfaceMap
from handbench.reports.figures.layers import (
    DEPTH_COLOURS,
    ERROR_COLOURS,
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
DPI, SCALES = 100, (DEPTH_COLOURS, ERROR_COLOURS)


def film(frames: Frames, title: str) -> bytes:
    """Return a film of all frames as the bytes of a GIF: depth, and radial velocity in red away
    from the array and blue towards it, on colour scales that all frames share."""
    palette = Image.new("P", (1, 1))
    palette.putpalette(_colours().ravel().tolist())
    pictures = [
        picture.quantize(palette=palette, dither=Image.Dither.NONE)
        for picture in _pictures(frames, title)
    ]
    stream, first = io.BytesIO(), pictures[0]
    first.save(stream, "GIF", save_all=True, append_images=pictures[1:], duration=PAUSE_MS, loop=0)
    return stream.getvalue()


def _colours() -> np.ndarray:
    """Return the 256 colours [256, 3] of a film, 0 to 255: those of both scales, and greys."""
    scales = [colormaps[name](np.linspace(0, 1, 108))[:, :3] for name in SCALES]
    greys = np.linspace(0, 1, 40)[:, None].repeat(3, axis=1)
    return np.round(255 * np.concatenate([*scales, greys])).astype(np.uint8)


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
        with rc_context(STYLE):
            figure.savefig(stream := io.BytesIO(), format="png", dpi=DPI)
        yield Image.open(stream).convert("RGB")
