"""Tornadoes of the figures over each factor's values, and the distance to the paper over the two
factors that matter most."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from handbench.bench.evaluation.metrics import METRICS, TITLES
from tests.bench.studies.sensitivity.nearness import KEYS, PAPER
from tests.bench.studies.sensitivity.sensitivity_cases import (
    BASE,
    Value,
    ranged,
    shown,
    titled,
    unit_of,
)
from tests.bench.studies.study import BLUE, GREY, ORANGE, VERMILION

MOST = 12  # factors in a tornado
FEWEST = 3  # settings that a cell of the map is coloured by
COLOURS = "viridis_r"
NEAREST = 5  # settings marked on the map


def draw_tornadoes(frames: dict[str, pd.DataFrame]) -> Figure | None:
    """A panel a figure of the paper's: bars from the lowest to the highest value that each factor
    leads to, the largest first; the draws of the benchmark itself among them; the paper's value."""
    rows = frames["rows"]
    base = rows[rows.name == BASE]
    lines = [
        key
        for key in KEYS
        if any(rows[f"{family}_{key}"].notna().any() for family in METRICS[key].paper)
    ]
    if base.empty or not lines:
        return None
    figure, families = (
        Figure(figsize=(4.2 * 4, 3.6 * len(lines)), layout="constrained"),
        tuple(METRICS[KEYS[0]].paper),
    )
    panels = figure.subplots(len(lines), len(families), squeeze=False)
    for (row, column), axes in np.ndenumerate(panels):
        family, key = families[column], lines[row]
        name = f"{family}_{key}"
        if name in PAPER and rows[name].notna().any():
            _tornado(axes, rows, base.iloc[0], name)
            axes.set_title(f"{TITLES[family]}: {METRICS[key].title}, mm")
        else:
            axes.set_axis_off()
    figure.legend(
        *panels[0, 0].get_legend_handles_labels(),
        loc="outside lower center",
        ncols=4,
        frameon=False,
    )
    return figure


def _tornado(axes: Axes, rows: pd.DataFrame, base: pd.Series, name: str) -> None:
    bars = []
    for factor, found in rows[rows.factor.astype(bool) & rows[name].notna()].groupby("factor"):
        values = found.sort_values(name)[[name, "name"]].to_numpy()[[0, -1]]
        ends = [(value, told.removeprefix(titled(str(factor))).strip()) for value, told in values]
        least, most = min(ends[0], (base[name], "")), max(ends[1], (base[name], ""))
        bars.append((titled(str(factor)), BLUE, least, most))
    if pd.notna(base.get(f"{name}_low")):
        bars.append(
            ("draws of the noise", ORANGE, (base[f"{name}_low"], ""), (base[f"{name}_high"], ""))
        )
    bars = sorted(
        (bar for bar in bars if bar[3][0] > bar[2][0]), key=lambda bar: bar[3][0] - bar[2][0]
    )[-MOST:]
    for place, (_, colour, (low_mm, low), (high_mm, high)) in enumerate(bars):
        axes.barh(place, high_mm - low_mm, left=low_mm, color=colour, height=0.7)
        for at_mm, text, side in ((low_mm, f"{low} ", "right"), (high_mm, f" {high}", "left")):
            axes.text(at_mm, place, text, ha=side, va="center", fontsize=6)
    axes.set_yticks(np.arange(len(bars)), [bar[0] for bar in bars], fontsize=7)
    axes.use_sticky_edges = False  # the words beside the bars need room
    axes.margins(x=0.2)
    axes.axvline(base[name], color=GREY, linewidth=0.8, label=BASE)
    axes.axvline(PAPER[name], color=VERMILION, linestyle="--", linewidth=1.2, label="the paper")


def draw_map(
    frames: dict[str, pd.DataFrame], factors: Mapping[str, Sequence[Value]]
) -> Figure | None:
    """The settings over the two factors with the smallest p, coloured by their distance, above the
    mean distance of each cell."""
    settings, first = frames["settings"], list(frames["factors"].factor[:2])
    if len(first) < 2:
        return None
    figure = Figure(figsize=(6.4, 5.2), layout="constrained")
    axes, (x, y) = figure.subplots(), first
    across, up = _places(settings, x, factors[x]), _places(settings, y, factors[y])
    distance, cells = (
        settings.distance.to_numpy(),
        (_edges(across, factors[x]), _edges(up, factors[y])),
    )
    scale = Normalize(distance.min(), np.quantile(distance, 0.95))
    count = np.histogram2d(across, up, bins=cells)[0]
    total = np.histogram2d(across, up, bins=cells, weights=distance)[0]
    mean = np.where(count >= FEWEST, total / np.maximum(count, 1), np.nan)
    axes.pcolormesh(*cells, mean.T, norm=scale, cmap=COLOURS, alpha=0.45, linewidth=0)
    apart = np.random.default_rng(0).uniform(
        -0.3, 0.3, (2, len(settings))
    )  # of those with one and the same value
    across, up = (
        across + apart[0] * (not ranged(factors[x])),
        up + apart[1] * (not ranged(factors[y])),
    )
    points = axes.scatter(
        across, up, c=distance, s=22, norm=scale, cmap=COLOURS, edgecolors="white", linewidths=0.4
    )
    axes.scatter(
        across[:NEAREST],
        up[:NEAREST],
        s=90,
        facecolors="none",
        edgecolors=VERMILION,
        linewidths=1.4,
    )
    axes.set(xlabel=_label(x, factors[x]), ylabel=_label(y, factors[y]))
    for axis, name in ((axes.xaxis, x), (axes.yaxis, y)):
        if not ranged(factors[name]):
            axis.set_ticks(
                np.arange(len(factors[name])), [shown(name, value) for value in factors[name]]
            )
    figure.colorbar(points, label="distance to the paper: RMS of ln(ours / paper)", extend="max")
    axes.set_title(f"{len(settings)} settings; circles: the nearest {min(NEAREST, len(settings))}")
    return figure


def _label(factor: str, values: Sequence[Value]) -> str:
    return titled(factor) + (f", {unit_of(factor)[2].strip()}" if ranged(values) else "")


def _edges(places: np.ndarray, values: Sequence[Value]) -> np.ndarray:
    """The cells' edges along an axis: five cells of a range, or one a choice."""
    if ranged(values):
        return np.linspace(places.min() - 1e-9, places.max() + 1e-9, 6)
    return np.arange(len(values) + 1) - 0.5


def _places(settings: pd.DataFrame, factor: str, values: Sequence[Value]) -> np.ndarray:
    """The settings' places along an axis: the factor's value as a person reads it, or the number of
    the choice."""
    if ranged(values):
        return settings[factor].to_numpy(float) * unit_of(factor)[1]
    return np.array([values.index(value) for value in settings[factor]], float)
