"""Figures as files and as bytes, and the maps of several methods of one surface as a figure of its own."""

import io
from collections.abc import Sequence
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from handbench.bench.results import ErrorMap, Surface
from handbench.reports.figures.depth_maps import Panel, box_of, depth_strip, error_panel, error_strip, sheet
from handbench.reports.figures.style import STYLE
from handbench.support.errors import HandbenchError
from handbench.support.files import atomic_path

FORMATS = (".png", ".pdf", ".svg")


def methods_figure(shown: Sequence[tuple[str, np.ndarray, ErrorMap]]) -> Figure:
    """A figure of a true surface, beside it the titled depths z_m [ny, nx] of methods, and below these their errors,
    which hold the surface of all."""
    maps = [errors for *_, errors in shown]
    truth = Surface(maps[0].x_m, maps[0].y_m, maps[0].reference_z_m)
    depths = [Panel(title, Surface(errors.x_m, errors.y_m, z_m)) for title, z_m, errors in shown]
    upper = depth_strip([Panel("true surface\n", truth), *depths], truth)
    lower = error_strip([Panel(), *(error_panel("", errors) for errors in maps)])
    with matplotlib.rc_context(STYLE):
        return sheet([upper, lower], box_of([truth]))


def save(figure: Figure, file: str | Path) -> None:
    """Write a figure, atomically; HandbenchError for a suffix other than those of FORMATS."""
    if Path(file).suffix.lower() not in FORMATS:
        raise HandbenchError(f"{file}: is no picture's name; expected one that ends in {', '.join(FORMATS)}")
    with matplotlib.rc_context(STYLE), atomic_path(file) as temporary:
        figure.savefig(temporary, format=Path(file).suffix[1:].lower())


def png(figure: Figure) -> bytes:
    """The figure as the bytes of a PNG."""
    stream = io.BytesIO()
    with matplotlib.rc_context(STYLE):
        figure.savefig(stream, format="png")
    return stream.getvalue()
