"""3-FSK maps of one scene: exact, ours with each choice of effects, and what lies between them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage

from radar.support.files import read_npz

PICTURED = ("finger before palm, skin, along", "")  # the cases whose maps are shown, the first one that there is
SHOWN_M = 0.05  # half the width and height that is shown
MOST_MM = 5.0  # of the differences


def draw(folder: Path) -> Figure | None:
    """Above: the exact map and ours; below: ours − exact. A column for each choice of effects."""
    found = next((paths for name in PICTURED if (paths := sorted(folder.glob(f"{name}*.npz")))), [])
    if not found:
        return None
    case = found[0].stem.rpartition(", ")[0]
    kept = [read_npz(path, ("x_m", "y_m", "ours_m", "exact_m")) for path in found if path.stem.startswith(case)]
    figure = Figure(figsize=(2.2 * (len(kept) + 1), 4.8), layout="constrained")
    above, below = figure.subplots(2, len(kept) + 1, sharex=True, sharey=True)
    low_m, high_m = np.nanpercentile(kept[0]["exact_m"], [1, 99])
    shown = _shown(above[0], kept[0], kept[0]["exact_m"], 1e3 * low_m, 1e3 * high_m, "viridis", "exact")
    below[0].set_axis_off()
    for rung, (maps, upper, lower) in enumerate(zip(kept, above[1:], below[1:], strict=True), 1):
        _shown(upper, maps, maps["ours_m"], 1e3 * low_m, 1e3 * high_m, "viridis", f"ours, row {rung}")
        off = _shown(lower, maps, maps["ours_m"] - maps["exact_m"], -MOST_MM, MOST_MM, "RdBu_r", "ours − exact")
    figure.colorbar(shown, ax=above, label="depth, mm")
    figure.colorbar(off, ax=below, label="difference, mm")
    figure.suptitle(f"3-FSK: {case}")
    return figure


def _shown(
    axes: Axes,
    maps: dict[str, np.ndarray],
    values_m: np.ndarray,
    low_mm: float,
    high_mm: float,
    colours: str,
    title: str,
) -> AxesImage:
    edges_mm = [1e3 * end for axis in (maps["x_m"], maps["y_m"]) for end in (axis[0], axis[-1])]
    image = axes.imshow(
        1e3 * values_m, extent=edges_mm, origin="lower", cmap=colours, vmin=low_mm, vmax=high_mm, interpolation="none"
    )
    axes.set(title=title, xlim=(-1e3 * SHOWN_M, 1e3 * SHOWN_M), ylim=(-1e3 * SHOWN_M, 1e3 * SHOWN_M), facecolor="0.92")
    return image
