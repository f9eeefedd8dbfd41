"""Content of the interactive 3-D view: reference and radar surfaces of each capture, small enough
to embed in a page."""

import base64
import math
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import to_hex
from PIL import Image

from handbench.bench.results.about import CaptureFacts
from handbench.bench.results.maps import SurfaceMap
from handbench.bench.results.result_folder import Result
from handbench.reports.figures import layers
from handbench.reports.figures.style import drawn_references, methods
from handbench.reports.page.rendering import image, render
from handbench.reports.tables.table import against
from handbench.support.errors import HandbenchError

# of one surface at most: of a finer one every second, third, … row and column is shown
PIXELS = 60_000
LEVELS = 65_535  # a depth is one of so many steps between the capture's nearest and farthest
COLOURS = 65  # samples of each colour scale
STILL_PX = 3  # pixels of the still picture for one of the map, each way

# name, title, surface, and by reference the signed errors [ny, nx] in metres, and against what
Part = tuple[str, str, SurfaceMap, dict[str, tuple[np.ndarray, str]]]


def scene(result: Result, capture: CaptureFacts) -> dict[str, Any] | None:
    """Return the content of the interactive 3-D view for one capture, as values for the page's
    script: the reference surfaces, and the depth maps of all methods with their errors. None if
    nothing was observed."""
    references = drawn_references([capture])
    parts: list[Part] = [
        (name, against(result, name), result.surface(capture.name, name), {}) for name in references
    ]
    for method in methods(result):
        surface = result.surface(capture.name, method.name)
        errors = {
            r: (result.errors(capture.name, method.name, r).error_m, against(result, r))
            for r in references
        }
        parts.append((method.name, method.title, surface, errors))
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
    picture = _shaded(surface, np.full_like(surface.z_m, np.nan))
    still = image(picture, f"{title}, seen from the {sensor}.", shown=2 / STILL_PX)
    method = {"name": title, "title": title}
    facts = {"methods": [method], "shown": title, "scales": scales()}
    return render("single.html", name=name, captures=[{"scene": scene, "still": still}], **facts)


def _scene(name: str, references: list[str], parts: list[Part]) -> dict[str, Any] | None:
    """Return the content of the 3-D view for several surfaces, on the depth scale of the first;
    None if no pixel of any surface has a depth.
    references: names of the reference surfaces among them."""
    z_mm = 1e3 * np.concatenate([surface.z_m.ravel() for _, _, surface, _ in parts])
    if not np.isfinite(z_mm).any():
        return None
    norm = layers.depth_scale(parts[0][2]).norm
    low_mm, high_mm = float(np.nanmin(z_mm)), float(np.nanmax(z_mm))
    step_mm = max((high_mm - low_mm) / LEVELS, 1e-6)
    return {
        "capture": name,
        "low_mm": low_mm,
        "step_mm": step_mm,
        "depth_mm": [norm.vmin, norm.vmax],
        "references": references,
        "surfaces": [_surface(*part, low_mm, step_mm) for part in parts],
    }


def scales() -> dict[str, Any]:
    """Return the colour scales that the page's script uses: colours as text (#rrggbb) for depth and
    error, and the ticks of the errors in mm with their positions from 0 to 1."""
    norm = layers.ERRORS.norm
    return {
        "skin": layers.SKIN,
        "depth": [to_hex(colour) for colour in _samples(layers.DEPTH_COLOURS)],
        "error": [to_hex(colour) for colour in _samples(layers.ERROR_COLOURS)],
        "ticks": [[tick, round(float(norm(tick)), 4)] for tick in layers.ERROR_TICKS_MM],
    }


def _samples(colours: str) -> np.ndarray:
    """Return colours [65, 3] along the scale with this name, RGB, 0 to 1."""
    return colormaps[colours](np.linspace(0, 1, COLOURS))[:, :3]


def _surface(
    name: str,
    title: str,
    surface: SurfaceMap,
    errors: dict[str, tuple[np.ndarray, str]],
    low_mm: float,
    step_mm: float,
) -> dict[str, Any]:
    """Pack one surface for the page's script.
    Depths and errors are given for the observed pixels only: depths in steps of step_mm above
    low_mm, errors as the number of their colour from 1 on (0: no reference). For each pixel of the
    surrounding box, a bit tells whether it was observed. Arrays become base64 text."""
    inside = _box(surface.z_m)
    z_mm = 1e3 * surface.z_m[inside]
    seen = np.isfinite(z_mm)
    x_m, y_m = surface.x_m[inside[1]], surface.y_m[inside[0]]
    return {
        "name": name,
        "title": title,
        "pixels": int(np.isfinite(surface.z_m).sum()),
        "x_mm": [1e3 * float(x_m[0]), 1e3 * float(x_m[-1])],
        "y_mm": [1e3 * float(y_m[0]), 1e3 * float(y_m[-1])],
        "shape": list(z_mm.shape),
        "seen": _base64(np.packbits(seen)),
        "z": _base64(np.round((z_mm[seen] - low_mm) / step_mm).astype("<u2")),
        "errors": {
            reference: {
                "colours": _base64(_colour_numbers(error_m[inside][seen])),
                "note": f"{layers.mean_text(error_m)} {words}",
            }
            for reference, (error_m, words) in errors.items()
        },
    }


def _colour_numbers(error_m: np.ndarray) -> np.ndarray:
    """Return the numbers of the colours of signed errors [n], from 1 on; 0 for NaN."""
    shares = np.clip(layers.ERRORS.norm(1e3 * np.nan_to_num(error_m)), 0, 1)
    return np.where(np.isnan(error_m), 0, 1 + np.round((COLOURS - 1) * shares)).astype("u1")


def _box(z_m: np.ndarray) -> tuple[slice, slice]:
    """Return the slices of rows and columns around the observed pixels of a depth map z_m [ny, nx].
    Of a large map, only every second, third, … row and column is taken, so that about 60 000 pixels
    remain (PIXELS). If nothing was observed, the slices are a corner of 2 × 2 pixels."""
    rows, columns = (np.flatnonzero(np.isfinite(z_m).any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return slice(0, 2), slice(0, 2)
    thin = math.ceil(math.sqrt((np.ptp(rows) + 1) * (np.ptp(columns) + 1) / PIXELS))
    return slice(rows[0], rows[-1] + 1, thin), slice(columns[0], columns[-1] + 1, thin)


def _base64(array: np.ndarray) -> str:
    return base64.b64encode(array.tobytes()).decode("ascii")


def still(result: Result, capture: CaptureFacts, method: str) -> Image.Image:
    """Return a static picture for paper and for browsers without WebGL.
    It shows the capture's first reference surface (or, without one, the method's depth map). Pixels
    that the method observed have the colours of their errors. method: "" for none."""
    reference = next(iter(drawn_references([capture])), "")
    surface = result.surface(capture.name, reference or method)
    if reference and method:
        error_m = result.errors(capture.name, method, reference).error_m
        if error_m.shape == surface.z_m.shape:  # else the method has its own pixels
            return _shaded(surface, error_m)
    return _shaded(surface, np.full_like(surface.z_m, np.nan))


def _shaded(surface: SurfaceMap, error_m: np.ndarray) -> Image.Image:
    """Return a picture of a surface, seen from the array and lit from the upper left, cut to its
    box and transparent around it. Pixels have the colours of their errors [ny, nx], those without
    the colour of skin."""
    inside = _box(surface.z_m)
    palette = np.vstack([layers.SKIN, _samples(layers.ERROR_COLOURS)])
    colours = palette[_colour_numbers(error_m)] * layers.shade(surface)
    # y up, x to the left
    picture = np.dstack([colours, np.isfinite(surface.z_m)])[inside][::-1, ::-1]
    large = picture.repeat(STILL_PX, axis=0).repeat(STILL_PX, axis=1)
    return Image.fromarray(np.round(255 * large).astype(np.uint8))
