"""3-FSK maps of one scene: exact, ours with each choice of effects, and the differences."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage

from radar.support.files import read_npz

PICTURED = ("finger before palm, 12 mm aside, skin, along", "")  # beginnings of cases: the first that there is is shown
SHOWN_MM = 50.0  # half the width and height that is shown
MOST_MM = 5.0  # of the differences


def draw(folder: Path, rungs: Sequence[str]) -> Figure | None:
    """Above: the exact map and ours; below: ours − exact. A column for each choice of effects, named by its last."""
    found = next((paths for name in PICTURED if (paths := sorted(folder.glob(f"{name}*.npz")))), [])
    if not found:
        return None
    case = found[0].stem.rpartition(", ")[0]
    kept = [read_npz(folder / f"{case}, {n}.npz", ("x_m", "y_m", "ours_m", "exact_m")) for n, _ in enumerate(rungs, 1)]
    figure = Figure(figsize=(2.2 * (len(kept) + 1), 4.6), layout="constrained")
    axes = figure.subplots(2, len(kept) + 1, sharex=True, sharey=True)
    low_mm, high_mm = 1e3 * np.nanpercentile(kept[0]["exact_m"], [0.5, 99.5])
    depths = (low_mm - 1, high_mm + 1)
    shown = _shown(axes[0, 0], kept[0], kept[0]["exact_m"], depths, "viridis", "exact")
    axes[1, 0].set_axis_off()
    for (above, below), maps, rung in zip(axes.T[1:], kept, rungs, strict=True):
        _shown(above, maps, maps["ours_m"], depths, "viridis", f"ours, {rung}")
        off = _shown(below, maps, maps["ours_m"] - maps["exact_m"], (-MOST_MM, MOST_MM), "RdBu_r", "ours − exact")
    figure.colorbar(shown, ax=axes[0], label="depth, mm")
    figure.colorbar(off, ax=axes[1], label="difference, mm")
    figure.suptitle(f"3-FSK: {case}")
    figure.supxlabel("x, mm", fontsize="medium")
    figure.supylabel("y, mm", fontsize="medium")
    return figure


def _shown(
    axes: Axes,
    maps: dict[str, np.ndarray],
    values_m: np.ndarray,
    limits_mm: tuple[float, float],
    colours: str,
    title: str,
) -> AxesImage:
    x_mm, y_mm = 1e3 * maps["x_m"], 1e3 * maps["y_m"]
    ends_mm = (float(x_mm[0]), float(x_mm[-1]), float(y_mm[0]), float(y_mm[-1]))
    low_mm, high_mm = limits_mm
    image = axes.imshow(1e3 * values_m, colours, extent=ends_mm, origin="lower", vmin=low_mm, vmax=high_mm)
    axes.set(title=title, xlim=(-SHOWN_MM, SHOWN_MM), ylim=(-SHOWN_MM, SHOWN_MM), facecolor="0.92")
    return image
