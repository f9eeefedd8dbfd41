"""Figures as files and as bytes."""

import io
from pathlib import Path

import matplotlib
from matplotlib.figure import Figure

from radar.support.errors import HandbenchError
from radar.support.files import atomic_path
from reports.figures.style import STYLE

FORMATS = (".png", ".pdf", ".svg")


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
