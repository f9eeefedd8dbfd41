"""Error against time, and time against size, as PNG and PDF."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bench.studies.engine.report import seconds_text
from radar.support.files import atomic_path

STYLE = {"font.size": 9, "axes.titlesize": 9, "axes.linewidth": 0.6, "savefig.dpi": 200, "pdf.fonttype": 42}
DOUBLE = 1e-9  # errors that single precision cannot have
BLUE, VERMILION, GREEN, GREY = "#0072B2", "#D55E00", "#009E73", "0.35"  # of Okabe and Ito's palette


def draw(result: dict[str, Any], stem: Path) -> None:
    """Write STEM.png and STEM.pdf."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(9.5, 4.0), layout="constrained")
        left, right = figure.subplots(1, 2, width_ratios=(3, 2))
        _errors(left, [row for row in result["rows"] if row["section"] == "volume"])
        _growth(right, [entry for entry in result["growth"] if entry["what"].startswith("voxels")])
        for suffix, metadata in ((".png", {}), (".pdf", {"CreationDate": None})):
            with atomic_path(stem.with_suffix(suffix)) as temporary:
                figure.savefig(temporary, metadata=metadata)


def _errors(axes: Axes, rows: list[dict[str, Any]]) -> None:
    """Relative error over seconds per volume; open markers are extrapolated."""
    fast = [row for row in rows if row.get("tolerance")]
    for what, colour, marker in (("volume", BLUE, "o"), ("projection", GREEN, "s")):
        some = [row for row in fast if what in row["method"]]
        seconds = [row["seconds"] for row in some]
        axes.plot(seconds, [row["relative_error"] for row in some], marker + "-", color=colour, markersize=5)
        if what == "volume":
            axes.plot(seconds, [row["noise_error"] for row in some], marker + ":", color=colour, markersize=3)
            for row in some:
                text = f"  {row['tolerance']:.0e}".replace("e-0", "e-")
                axes.annotate(text, (row["seconds"], row["noise_error"]), va="bottom", color=colour, fontsize=8)
    slow = [row for row in rows if row["extrapolated"] or row["method"] == "exact"]
    double = [row for row in slow if (row["relative_error"] or 0) < DOUBLE]
    for i, row in enumerate(slow):
        error, name = row["relative_error"], row["method"].replace(", ", ",\n")
        text = f"{name}\n{seconds_text(row['seconds'])} s"
        if row in double:  # in double precision: exact on this scale
            axes.axvline(row["seconds"], color=GREY, linestyle="--", linewidth=0.8)
            axes.annotate(
                text, (row["seconds"], 0.97 - 0.3 * i), (-3, 0), ("data", "axes fraction"), "offset points",
                ha="right", va="top", bbox={"facecolor": "white", "edgecolor": "none", "pad": 1},
            )  # fmt: skip
            continue
        where = (row["seconds"], error)
        axes.plot(*where, "D", color=VERMILION, fillstyle="none" if row["extrapolated"] else "full")
        axes.annotate(text, where, xytext=(0, 7), textcoords="offset points", ha="center", va="bottom")
    axes.set(xscale="log", yscale="log", xlabel="seconds per volume", ylabel="relative error of the volume")
    axes.set(ylim=(2e-8, 5e-2))


def _growth(axes: Axes, series: list[dict[str, Any]]) -> None:
    """Seconds over voxels, with proportional growth for comparison."""
    for entry, colour, marker in zip(series, (BLUE, VERMILION), ("o", "s"), strict=False):
        sizes, seconds = np.array(entry["sizes"], float), np.array(entry["seconds"])
        axes.plot(sizes, seconds, marker + "-", color=colour, markersize=5)
        name = entry["what"].removeprefix("voxels, ")
        text = f"{name}: exponent {entry['exponent']:.2f}"
        axes.annotate(text, (0.05, 0.93 - 0.07 * (colour == VERMILION)), xycoords="axes fraction", color=colour)
    sizes, seconds = np.array(series[0]["sizes"], float), series[0]["seconds"]
    axes.plot(sizes, seconds[0] * sizes / sizes[0], color=GREY, linestyle=":", linewidth=0.8)
    axes.set(xscale="log", yscale="log", xlabel="voxels", ylabel="seconds at a tolerance of 1e-3")
