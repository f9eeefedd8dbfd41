"""The ablation as a table (Markdown, CSV) and as a figure."""

from __future__ import annotations

import csv
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bench.studies.ablation.measure import METHODS, REPEATED, Row
from bench.studies.report import STYLE, markdown_table
from radar.support.files import atomic_path, write_text

BLUE, VERMILION, GREY = "#0072B2", "#D55E00", "0.35"  # of Okabe and Ito's palette
SMALLEST_MM = 1e-4  # what is smaller stands at the axis


def write(rows: list[Row], folder: Path) -> None:
    """Write effects_table.md, effects.csv and effects.png into the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / "effects_table.md", markdown(rows))
    with atomic_path(folder / "effects.csv") as temporary, temporary.open("w", newline="", encoding="utf-8") as stream:
        csv.writer(stream).writerows(table(rows))
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(9.5, 5.2), layout="constrained")
        draw(rows, figure)
        with atomic_path(folder / "effects.png") as temporary:
            figure.savefig(temporary, format="png")


def table(rows: list[Row]) -> list[list[str]]:
    """Header and one line per case, all figures in millimetres and seconds."""
    head = ["case", "change of 3-FSK mm", "estimate mm", "effect s", "simulation s"]
    head += [f"{m} {figure}" for m in METHODS for figure in ("MAE mm", "MAX mm")]
    head += [f"{m} precision mm" for m in REPEATED]
    return [head, *(_cells(row) for row in rows)]


def _cells(row: Row) -> list[str]:
    cells = [row.name, f"{row.change_mm:.3f}", "" if row.estimate_mm is None else f"{row.estimate_mm:.3f}"]
    cells += [f"{row.effect_s:.2f}", f"{row.simulate_s:.2f}"]
    cells += [f"{row.values[m][key]:.{n}f}" for m in METHODS for key, n in (("mae_mm", 3), ("max_mm", 1))]
    precisions = [row.values[m]["precision_mm"] for m in REPEATED]
    return cells + ["" if p is None else f"{p:.3f}" for p in precisions]


def markdown(rows: list[Row]) -> str:
    """Two tables for the documentation: size and cost of each case, and what the methods make of it."""
    head, *lines = table(rows)
    sizes = [[line[0], *line[1:5]] for line in (head, *lines)]
    figures = [[line[0], *line[5:]] for line in (head, *lines)]
    return markdown_table(sizes) + "\n" + markdown_table(figures)


def draw(rows: list[Row], figure: Figure) -> None:
    """Left: what each effect changes, measured and estimated; right: what it costs."""
    effects = sorted((row for row in rows if row.name != "reference"), key=lambda row: row.change_mm)
    left, right = figure.subplots(1, 2, width_ratios=(3, 2), sharey=True)
    places = np.arange(len(effects))
    _sizes(left, effects, places)
    right.barh(places, [row.simulate_s for row in effects], color="0.85", label="whole simulation")
    right.barh(places, [row.effect_s for row in effects], color=BLUE, label="the effect")
    right.set(xlabel="seconds per pose, 130 tones", title="what it costs")
    figure.legend(loc="outside lower center", ncols=4, frameon=False)


def _sizes(axes: Axes, effects: list[Row], places: np.ndarray) -> None:
    measured = [max(row.change_mm, SMALLEST_MM) for row in effects]
    axes.barh(places, measured, color=BLUE, height=0.6, label="measured, mean |Δz| of the 3-FSK map")
    known = [(place, row) for place, row in zip(places, effects, strict=True) if row.estimate_mm is not None]
    estimated = [max(row.estimate_mm, SMALLEST_MM) for _, row in known]
    axes.plot(estimated, [place for place, _ in known], "D", color=VERMILION, label="estimated")
    axes.axvline(0.1, color=GREY, linestyle="--", linewidth=0.8)
    axes.annotate("0.1 mm", (0.1, len(effects) - 0.4), color=GREY, ha="center", va="bottom", annotation_clip=False)
    axes.set_yticks(places, [row.name for row in effects])
    axes.set(xscale="log", xlabel="change of the depth map, mm", xlim=(SMALLEST_MM, 20))
