"""Content of the interactive 3-D view: reference and radar surfaces of each capture, small enough
to embed in a page."""

import base64
import math
from typing import Any

import numpy as np
from matplotlib import colormaps
from PIL import Image

from handbench.bench.results.about import CaptureFacts
from handbench.bench.results.maps import SurfaceMap
from handbench.bench.results.result_folder import Result
from handbench.reports.figures import layers
from handbench.reports.figures.references import drawn_references
from handbench.reports.figures.style import methods
from handbench.reports.page.rendering import image, render
from handbench.reports.tables.table import AGAINST
from handbench.support.errors import HandbenchError

# of one surface at most: of a finer one every second, third, … row and column is shown
PIXELS = 60_000
LEVELS = 65_535  # a depth is one of so many steps between the capture's nearest and farthest
ERROR_STEP_MM, NO_ERROR = 0.002, -32_768
COLOURS = 65  # samples of each colour scale
STILL_PX = 3  # pixels of the still picture for one of the map, each way

# by reference: signed errors [ny, nx] in metres, and a note
Errors = dict[str, tuple[np.ndarray, str]]
Part = tuple[str, str, SurfaceMap, Errors]  # name, title, surface, and its errors


def scene(result: Result, capture: CaptureFacts) -> dict[str, Any] | None:
    """Return the content of the interactive 3-D view for one capture, as values for the page's
    script: the reference surfaces, and the depth maps of all methods with their errors. None if
    nothing was observed."""
    references = drawn_references([capture])
    parts: list[Part] = [
        (name, AGAINST[name], result.surface(capture.name, name), {}) for name in references
    ]
    for method in methods(result):
        errors = {r: result.errors(capture.name, method.name, r).error_m for r in references}
        error_maps: Errors = {
            r: (error_m, f"{layers.mean_text(error_m)} {AGAINST[r]}")
            for r, error_m in errors.items()
        }
        parts.append(
            (method.name, method.title, result.surface(capture.name, method.name), error_maps)
        )
    return _scene(capture.name, references, parts)


def page(name: str, title: str, surface: SurfaceMap, sensor: str = "array") -> str:
    """Return an HTML page on which one surface can be turned.
    name: heading of the page; title: name of the surface; sensor: sensor from which it is seen.
    Raises HandbenchError if no pixel has a depth."""
    scene = _scene(name, [], [(title, title, surface, {})])
    if scene is None:
        raise HandbenchError(
            f"{name}: has no observed pixel or vertex, so there is nothing to show in 3D"
        )
    picture = layers.shaded_colours(surface, np.isfinite(surface.z_m))[::-1, ::-1]
    still = image(
        Image.fromarray(np.round(255 * picture).astype(np.uint8)),
        f"{title}, seen from the {sensor}.",
        shown=2,
    )
    facts = {
        "methods": [{"name": title, "title": title}],
        "shown": title,
        "scales": scales(),
        "still": still,
    }
    return render("single.html", name=name, scenes=[scene], **facts)


def _scene(name: str, references: list[str], parts: list[Part]) -> dict[str, Any] | None:
    """Return the content of the 3-D view for several surfaces, on the depth scale of the first;
    None if no pixel of any surface has a depth.
    references: names of the reference surfaces among them; parts: name, title, surface and errors
    of each surface."""
    z_mm = 1e3 * np.concatenate(
        [surface.z_m[np.isfinite(surface.z_m)] for _, _, surface, _ in parts]
    )
    if not len(z_mm):
        return None
    norm, low_mm, step_mm = (
        layers.depth_scale(parts[0][2]),
        z_mm.min(),
        max(np.ptp(z_mm) / LEVELS, 1e-6),
    )
    return {
        "capture": name,
        "low_mm": float(low_mm),
        "step_mm": float(step_mm),
        "depth_mm": [norm.vmin, norm.vmax],
        "references": references,
        "surfaces": [_surface(*part, low_mm, step_mm) for part in parts],
    }


def scales() -> dict[str, Any]:
    """Return the colour scales that the page's script uses: colours as text (#rrggbb) for depth and
    error, the error in mm at each colour, and the ticks with their positions from 0 to 1."""
    norm = layers.error_scale()
    at = np.linspace(0, 1, COLOURS)
    return {
        "skin": layers.SKIN,
        "depth": _hex(layers.DEPTH_COLOURS, at),
        "error": _hex(layers.ERROR_COLOURS, at),
        # the error at each colour, rising
        "error_mm": [round(float(value), 6) for value in norm.inverse(at)],
        "ticks": [[tick, round(float(norm(tick)), 4)] for tick in layers.ERROR_TICKS_MM],
        "error_step_mm": ERROR_STEP_MM,
        "no_error": NO_ERROR,
    }


def _surface(
    name: str, title: str, surface: SurfaceMap, errors: Errors, low_mm: float, step_mm: float
) -> dict[str, Any]:
    """Pack one surface for the page's script.
    Depths and errors are given for the observed pixels only, as integers: depths in steps of
    step_mm above low_mm, errors in steps of 2 µm (ERROR_STEP_MM). For each pixel of the surrounding
    box, a bit tells whether it was observed. Arrays become base64 text."""
    inside = _box(surface.z_m)
    z_mm = 1e3 * surface.z_m[inside]
    x_mm, y_mm = 1e3 * surface.x_m[inside[1]], 1e3 * surface.y_m[inside[0]]
    seen = np.isfinite(z_mm)
    against = {}
    for reference, (error_m, note) in errors.items():
        error_mm = 1e3 * error_m[inside][seen]
        steps = np.clip(np.nan_to_num(error_mm) / ERROR_STEP_MM, NO_ERROR + 1, -NO_ERROR - 1)
        against[reference] = {
            "steps": _base64(
                np.where(np.isfinite(error_mm), np.round(steps), NO_ERROR).astype("<i2")
            ),
            "note": note,
        }
    return {
        "name": name,
        "title": title,
        "pixels": int(np.isfinite(surface.z_m).sum()),
        "x_mm": [float(x_mm[0]), float(x_mm[-1])],
        "y_mm": [float(y_mm[0]), float(y_mm[-1])],
        "shape": list(z_mm.shape),
        "seen": _base64(np.packbits(seen)),
        "z": _base64(np.round((z_mm[seen] - low_mm) / step_mm).astype("<u2")),
        "errors": against,
    }


def _box(z_m: np.ndarray) -> tuple[slice, slice]:
    """Return the slices of rows and columns around the observed pixels of a depth map z_m [ny, nx].
    Of a large map, only every second, third, … row and column is taken, so that about 60 000 pixels
    remain (PIXELS). If nothing was observed, the slices are a corner of 2 × 2 pixels."""
    rows, columns = (np.flatnonzero(np.isfinite(z_m).any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return slice(0, 2), slice(0, 2)
    high, wide = rows[-1] + 1 - rows[0], columns[-1] + 1 - columns[0]
    thin = max(math.ceil(math.sqrt(high * wide / PIXELS)), 1)
    return slice(rows[0], rows[-1] + 1, thin), slice(columns[0], columns[-1] + 1, thin)


def _base64(array: np.ndarray) -> str:
    return base64.b64encode(array.tobytes()).decode("ascii")


def _hex(colours: str, at: np.ndarray) -> list[str]:
    return [
        "#" + "".join(f"{round(255 * c):02x}" for c in colour[:3])
        for colour in colormaps[colours](at)
    ]


def still(result: Result, capture: CaptureFacts, method: str | None) -> Image.Image:
    """Return a static picture for paper and for browsers without WebGL.
    It shows the capture's first reference surface (or, without one, the method's depth map) from
    the array and lit from the upper left. Pixels that the method observed have the colours of their
    errors."""
    reference = next(iter(drawn_references([capture])), None)
    source = reference or method or ""
    surface = result.surface(capture.name, source)
    inside = _box(surface.z_m)
    z_m, x_m, y_m = surface.z_m[inside], surface.x_m[inside[1]], surface.y_m[inside[0]]
    shade = layers.shade(SurfaceMap(x_m, y_m, z_m))
    picture, there = np.array(layers.SKIN) * shade, np.isfinite(z_m)
    if reference and method:
        errors = result.errors(capture.name, method, reference)
        if errors.error_m.shape == surface.z_m.shape:
            error_mm = 1e3 * errors.error_m[inside]
            colours = colormaps[layers.ERROR_COLOURS](
                layers.error_scale()(np.nan_to_num(error_mm))
            )[..., :3]
            picture = np.where(np.isfinite(error_mm)[..., None], colours * shade, picture)
            there = there | np.isfinite(error_mm)
    picture = np.dstack([picture, there])[::-1, ::-1]  # y up, x to the left; transparent outside
    return Image.fromarray(
        np.round(255 * picture.repeat(STILL_PX, 0).repeat(STILL_PX, 1)).astype(np.uint8)
    )
