"""Maps as SVG for a page of many captures, laid out as `reports.figures.depth_maps.sheet` does in ten times the time: a
map's pixels are an image that the browser enlarges, texts and lines have the page's colour, light or dark."""

import base64
import io
from pathlib import Path
from typing import Any

import numpy as np
from contourpy import contour_generator
from markupsafe import Markup
from matplotlib.colors import to_hex
from PIL import Image as Pixels

from handbench.reports.figures.depth_maps import EMPTY, X_LABEL, Box, Maps, Panel, Strip, edges_mm, layout, ticks_mm
from handbench.reports.figures.style import Layout
from handbench.reports.page.rendering import QUALITY, Image, render
from handbench.support.files import write_text

PX = 84  # CSS pixels for an inch of the layout
COLOURS = 255  # of a scale; one more index stands for what was not observed
CAP = 0.05  # of a bar of colours, for what lies beyond it
PHOTO_PX = 320  # of a photograph's width: twice a panel's


def image(maps: Maps, folder: Path) -> Image:
    """Maps for a page; the same SVG is written into `folder` as STEM.svg."""
    at = layout(maps.strips, maps.box)
    lowest = {column: i for i, (row, _) in enumerate(at.rows) for column, p in enumerate(row.panels) if p.surface}
    rows = [
        _row(row, at, at.height - lower - at.high, maps.box, [lowest.get(c) == i for c in range(len(row.panels))])
        for i, (row, lower) in enumerate(at.rows)
    ]
    width, height = round(PX * at.width), round(PX * at.height)
    middle = PX * (at.lefts[0] + at.lefts[-1] + at.wide) / 2
    facts = {"alt": maps.alt, "width": width, "height": height, "middle": middle, "x_label": X_LABEL, "empty": EMPTY}
    svg = render("sheet.svg", rows=rows, **facts)
    write_text(folder / f"{maps.stem}.svg", svg)
    for old in ("png", "pdf"):  # of an earlier report of another result
        (folder / f"{maps.stem}.{old}").unlink(missing_ok=True)
    return Image("", width, height, maps.alt, maps.caption, maps.stem, kinds=("svg",), svg=Markup(svg))


def _row(strip: Strip, at: Layout, upper_in: float, box: Box, lowest: list[bool]) -> dict[str, Any]:
    """A row of panels for the template; upper_in: from the top to its upper edge; lowest: those with numbers at x."""
    scale = PX * min(at.wide / (box[0] - box[1]), at.high / (box[3] - box[2]))  # pixels for a millimetre
    wide, high = scale * (box[0] - box[1]), scale * (box[3] - box[2])
    upper, edges_of = PX * (upper_in + at.high / 2) - high / 2, strip.norm.inverse(np.arange(1, COLOURS) / COLOURS)
    colours = np.round(255 * strip.colours(np.linspace(0, 1, COLOURS))[:, :3]).astype(np.uint8)
    outlines: dict[bytes, str] = {}  # of the panels, which mostly share one
    panels = []
    for x_in, panel, numbered in zip(at.lefts, strip.panels, lowest, strict=False):
        told: dict[str, Any] = {"photo": "", "map": "", "outline": "", "numbered": numbered}
        told |= {"x": PX * (x_in + at.wide / 2) - wide / 2, "title": panel.title.split("\n")}
        if panel.photo is not None:
            told["photo"] = _uri(Pixels.fromarray(panel.photo), "JPEG")
        elif panel.surface is not None:
            told |= _map(panel, box, edges_of, colours, outlines)
        panels.append(told)
    bar_high = PX * at.high * (1 - 2 * CAP)
    levels = [(bar_high * (1 - float(strip.norm(value))), text) for value, text in strip.ticks().items()]
    return {
        "panels": panels,
        "upper": upper,
        "size": (wide, high),
        "x_ticks": [(scale * (box[0] - x), f"{x:g}".replace("-", "−")) for x in ticks_mm("x", box).tolist()],
        "y_ticks": [(scale * (box[3] - y), f"{y:g}".replace("-", "−")) for y in ticks_mm("y", box).tolist()],
        "bar": {
            "place": (PX * at.bar[0], PX * (upper_in + CAP * at.high), PX * at.bar[1], bar_high, PX * CAP * at.high),
            "uri": _uri(Pixels.fromarray(colours[::-1, None]), "PNG"),
            "ends": [to_hex(strip.colours(end)) for end in (1.0, 0.0)],
            "ticks": levels,
            "label": strip.label,
        },
    }


def _map(
    panel: Panel, box: Box, edges_of: np.ndarray, colours: np.ndarray, outlines: dict[bytes, str]
) -> dict[str, Any]:
    """A map's image, its size and the box in its pixels, and the outline in halves of them, all as seen from the
    array."""
    assert panel.surface is not None
    z_mm = 1e3 * panel.surface.z_m[::-1, ::-1]
    seen, (high, wide) = np.isfinite(z_mm), z_mm.shape
    indices = np.full(z_mm.shape, COLOURS, np.uint8)
    indices[seen] = np.searchsorted(edges_of, z_mm[seen])
    picture = Pixels.fromarray(indices)
    picture.putpalette(colours.tobytes() + bytes(3))
    (right, left), (bottom, top) = edges_mm(panel.surface.x_m), edges_mm(panel.surface.y_m)
    across, up = (left - right) / wide, (top - bottom) / high
    view = (left - box[0]) / across, (top - box[3]) / up, (box[0] - box[1]) / across, (box[3] - box[2]) / up
    found = {"map": _uri(picture, "PNG", transparency=COLOURS), "shape": (wide, high), "view": view}
    if panel.errors is None:
        return found
    covered = np.isfinite(panel.errors.reference_z_m[::-1, ::-1])
    outline = outlines.get(covered.tobytes())
    if outline is None:
        outline = outlines[covered.tobytes()] = _outline(covered)
    return found | {"outline": outline}


def _outline(covered: np.ndarray) -> str:
    """The outlines of pixels [ny, nx], as steps from one middle between two pixels to the next, in halves of pixels."""
    parts = []
    for line in contour_generator(z=covered.astype(float)).lines(0.5):
        points = np.round(2 * np.asarray(line) + 1).astype(int)
        parts.append("M{} {}l".format(*points[0]) + " ".join(map(str, np.diff(points, axis=0).ravel().tolist())))
    return "".join(parts)


def _uri(picture: Pixels.Image, form: str, **options: Any) -> str:
    """A picture as a data: URI; a photograph no wider than a panel needs."""
    if form == "JPEG":
        picture.thumbnail((PHOTO_PX, 2 * PHOTO_PX))
        options |= {"quality": QUALITY}
    stream = io.BytesIO()
    picture.save(stream, form, **options)
    return f"data:image/{form.lower()};base64,{base64.b64encode(stream.getvalue()).decode('ascii')}"
