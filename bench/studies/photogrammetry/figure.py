"""The price of accuracy as a figure: error and completeness over seconds."""

import pandas as pd
from matplotlib.figure import Figure

from bench.studies.study import BLUE, GREEN, ORANGE

COLOURS = (BLUE, ORANGE, GREEN, "#CC79A7", "#56B4E9")
MARKERS = {"draft": "o", "normal": "s", "high": "^"}


def draw(frames: dict[str, pd.DataFrame]) -> Figure:
    """Colour: views, size: of the photographs, shape: quality."""
    rows = frames["rows"].sort_values("all_s")
    figure = Figure(figsize=(9.5, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    colour = dict(zip(sorted(rows.cameras.unique()), COLOURS, strict=False))
    sizes = {width: 20 + 25 * i for i, width in enumerate(sorted(rows.width.unique()))}
    for (cameras, width, quality), some in rows.groupby(["cameras", "width", "quality"]):
        look = {"color": colour[cameras], "s": sizes[width], "marker": MARKERS[str(quality)], "alpha": 0.8}
        left.scatter(some.all_s, 1e3 * some.rms_m, **look)
        right.scatter(some.all_s, 100 * some.complete, **look)
    for cameras, name in colour.items():
        left.scatter([], [], color=name, label=f"{cameras} views")
    for quality, marker in MARKERS.items():
        left.scatter([], [], color="0.3", marker=marker, label=quality)
    for width, size in sizes.items():
        left.scatter([], [], color="0.7", s=size, label=f"{width} px wide")
    left.step(rows.all_s, 1e3 * rows.rms_m.cummin(), where="post", color="0.5", linewidth=0.8, zorder=0)
    left.set(xscale="log", yscale="log", xlabel="seconds, two cores", ylabel="RMS of the mesh in mm", title="error")
    right.set(xscale="log", xlabel="seconds, two cores", ylabel="% of the radar's side within 1 mm")
    right.set_title("completeness")
    figure.legend(loc="outside lower center", ncols=5, frameon=False)
    return figure
