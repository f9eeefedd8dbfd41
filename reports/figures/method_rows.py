"""A true surface, the depth maps of methods beside it, and below each its errors: one picture."""

import io
from pathlib import Path

import matplotlib
import numpy as np
from PIL import Image

from bench.results import ErrorMap, Surface
from radar.support.files import atomic_path
from reports.figures.depth_maps import DEPTH_COLOURS, box_of, depth_scale, error_sheet, sheet
from reports.figures.single import png
from reports.figures.style import STYLE


def save_rows(shown: list[tuple[str, np.ndarray, ErrorMap]], file: Path) -> None:
    """Write the PNG of titled depths z_m [ny, nx], each with its errors, which hold the surface of all."""
    maps = [errors for *_, errors in shown]
    truth = Surface(maps[0].x_m, maps[0].y_m, maps[0].reference_z_m)
    depths = [(title, Surface(e.x_m, e.y_m, z_m)) for title, z_m, e in shown]
    signed = [("", Surface(e.x_m, e.y_m, e.error_m)) for e in maps]
    with matplotlib.rc_context(STYLE):
        first = [("true surface\n", truth), *depths]
        upper, _, _ = sheet(first, DEPTH_COLOURS, depth_scale(truth), "z in mm", box_of([truth]))
        lower = error_sheet(signed, maps, box_of([truth]))
    rows = [Image.open(io.BytesIO(png(figure))) for figure in (upper, lower)]
    whole = Image.new("RGB", (max(row.width for row in rows), sum(row.height for row in rows)), "white")
    for row, top in zip(rows, (0, rows[0].height), strict=True):  # panels are of one size: the right edges align them
        whole.paste(row, (whole.width - row.width, top))
    with atomic_path(file) as temporary:
        whole.save(temporary, format="PNG")
