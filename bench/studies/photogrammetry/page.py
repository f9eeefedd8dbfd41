"""The rows as a table (Markdown, CSV) and as a figure."""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from bench.studies.photogrammetry.run import Row
from bench.studies.report import STYLE, markdown_table, write_page

COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9")  # of Okabe and Ito's palette
MARKERS = {"draft": "o", "normal": "s", "high": "^"}
PERCENT = 100.0


def write(rows: list[Row], folder: Path, name: str) -> None:
    """Write photogrammetry_<name>.md, .csv and, of a sweep, .png into the folder."""
    with matplotlib.rc_context(STYLE):
        figure = draw(rows) if len({row.case.quality for row in rows}) > 1 else None
        write_page(folder / f"photogrammetry_{name}", markdown(rows), table(rows), figure)


def table(rows: list[Row]) -> list[list[str]]:
    """Header and one line per case: millimetres, shares in per cent, seconds."""
    head = [
        "case",
        "pose",
        "median mm",
        "RMS mm",
        "p95 mm",
        "max mm",
        "complete %",
        "scale %",
        "centres mm",
        "1σ %",
        "2σ %",
        "95 % band %",
        "sparse s",
        "dense s",
        "mesh s",
        "all s",
        "peak MB",
    ]
    return [head, *(_cells(row) for row in rows)]


def _cells(row: Row) -> list[str]:
    s, seconds = row.score, row.seconds
    cells = [row.case.name, row.case.pose, *(f"{1e3 * v:.3f}" for v in (s.median_m, s.rms_m, s.p95_m))]
    cells += [f"{1e3 * s.max_m:.2f}"]
    cells += [f"{PERCENT * s.complete:.1f}", f"{PERCENT * s.scale:+.4f}", f"{1e3 * s.centre_m:.3f}"]
    cells += [f"{PERCENT * v:.1f}" for v in (s.within_1_sigma, s.within_2_sigma, s.within_95)]
    cells += [f"{seconds[stage]:.1f}" for stage in ("sparse", "dense", "mesh")]
    return [*cells, f"{row.total_s:.1f}", f"{row.peak_memory_mb:.0f}"]


def markdown(rows: list[Row]) -> str:
    """The table for the documentation."""
    return markdown_table(table(rows), words=(0, 1))


def draw(rows: list[Row]) -> Figure:
    """Error and completeness over seconds; colour: views, size: of the photographs, shape: quality."""
    figure = Figure(figsize=(9.5, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    colour = dict(zip(sorted({row.case.cameras for row in rows}), COLOURS, strict=False))
    sizes = {width: 20 + 25 * i for i, width in enumerate(sorted({row.case.width for row in rows}))}
    for row in rows:
        look = {"color": colour[row.case.cameras], "s": sizes[row.case.width], "marker": MARKERS[row.case.quality]}
        left.scatter(row.total_s, 1e3 * row.score.rms_m, alpha=0.8, **look)
        right.scatter(row.total_s, PERCENT * row.score.complete, alpha=0.8, **look)
    for cameras, name in colour.items():
        left.scatter([], [], color=name, label=f"{cameras} views")
    for quality, marker in MARKERS.items():
        left.scatter([], [], color="0.3", marker=marker, label=quality)
    for width, size in sizes.items():
        left.scatter([], [], color="0.7", s=size, label=f"{width} px wide")
    front = np.array(sorted((row.total_s, 1e3 * row.score.rms_m) for row in rows))
    best = np.minimum.accumulate(front[:, 1])
    left.step(front[:, 0], best, where="post", color="0.5", linewidth=0.8, zorder=0)
    left.set(xscale="log", yscale="log", xlabel="seconds, two cores", ylabel="RMS of the mesh in mm", title="error")
    right.set(xscale="log", xlabel="seconds, two cores", ylabel="% of the radar's side within 1 mm")
    right.set_title("completeness")
    figure.legend(loc="outside lower center", ncols=5, frameon=False)
    return figure
