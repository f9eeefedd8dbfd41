"""Depth maps of measured captures, which have no reference surface."""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from handbench.bench.results import SurfaceMap
from handbench.reports.figures.layers import box_of
from handbench.reports.figures.style import STYLE


def measured_figure(shown: Sequence[tuple[str, np.ndarray, np.ndarray, np.ndarray]]) -> Figure:
    """Draw depth maps in rows of two, each with its own scale and cut to its own pixels, as seen
    from the array (x grows to the left). shown: for each its title, x_m [nx], y_m [ny] and z_m [ny,
    nx] (NaN: not shown)."""
    columns = min(len(shown), 2)
    rows = math.ceil(len(shown) / columns)
    with rc_context(STYLE):
        figure = Figure(figsize=(2.6 * columns, 2.3 * rows), layout="constrained")
        axes = figure.subplots(rows, columns, squeeze=False).ravel()
        for axis, (title, x_m, y_m, z_m) in zip(axes, shown, strict=False):
            drawn = axis.pcolormesh(1e3 * x_m, 1e3 * y_m, 1e3 * z_m, cmap="viridis_r")
            right, left, low, high = box_of([SurfaceMap(x_m, y_m, z_m)])
            axis.set(title=title, aspect="equal", xlim=(right, left), ylim=(low, high))
            figure.colorbar(drawn, ax=axis, label="z in mm")
        for axis in axes[len(shown) :]:
            axis.set_axis_off()
        for axis in axes[::columns]:
            axis.set_ylabel("y in mm")
        for axis in axes[max(len(shown) - columns, 0) : len(shown)]:
            axis.set_xlabel("x in mm")
    return figure
