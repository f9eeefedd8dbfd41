"""Errors by cause, in small multiples, and the reliability of the methods' own σ."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bench.results import MethodFacts, Result
from bench.results.tables import each
from reports.figures.style import Picture, log_axis, looks, methods
from reports.tables.blocks import AGAINST, DRAWN

CAUSES = {
    "incidence_deg": "incidence angle in °",
    "below_maximum_db": "amplitude below the maximum in dB",
    "part": "part of the hand",
    "edge_distance_mm": "distance to an edge in mm",
}
ROWS = {"absolute_mm": "mean |z − z_ref| in mm", "mean_mm": "mean z − z_ref in mm"}
LINEAR_MM = 1  # of signed means, up to which their scale is linear


def explained(result: Result) -> Iterator[Picture]:
    """The pictures that the result has the data for."""
    for reference in DRAWN:
        causes = result.causes[result.causes.reference == reference]
        if len(causes):
            yield by_cause(result, causes, reference)
    if len(result.reliability):
        yield reliability(result)


def bin_label(line: Any) -> str:
    """The bin of a line of causes.csv, as it is printed."""
    return line.part or (f"{line.low:g}–{line.high:g}" if line.high == line.high else f"≥ {line.low:g}")


def by_cause(result: Result, causes: pd.DataFrame, reference: str) -> Picture:
    """Mean absolute and signed error of each method over the bins of each cause."""
    shown = [cause for cause in CAUSES if (causes.cause == cause).any()]
    widths = [causes[causes.cause == cause].groupby(["part", "low"], dropna=False).ngroups + 1 for cause in shown]
    figure = Figure(figsize=(2.6 * len(shown) + 1.6, 4.6), layout="constrained")
    axes = figure.subplots(2, len(shown), sharex="col", sharey="row", squeeze=False, width_ratios=widths)
    for column, cause in zip(axes.T, shown, strict=True):
        lines = causes[causes.cause == cause].assign(bin=[bin_label(x) for x in each(causes[causes.cause == cause])])
        bins = list(dict.fromkeys(lines.sort_values(["low", "part"]).bin))
        for axis, value in zip(column, ROWS, strict=True):
            for method, mine in _of_methods(result, lines):
                places = [bins.index(name) for name in mine.bin]
                _line(result, axis, method, np.array(places), mine[value].to_numpy())
        column[1].axhline(0, color="0.6", linewidth=0.6)
        column[1].set_xticks(range(len(bins)), bins, rotation=45, ha="right", rotation_mode="anchor")
        column[1].set(xlim=(-0.5, len(bins) - 0.5), xlabel=CAUSES[cause])
    for axis, label in zip(axes[:, 0], ROWS.values(), strict=True):
        axis.set_ylabel(label)
    log_axis(axes[0, 0], "y")
    axes[1, 0].set_yscale("symlog", linthresh=LINEAR_MM)
    axes[1, 0].yaxis.set_major_formatter("{x:g}")
    figure.align_xlabels()
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside right center", frameon=False)
    return Picture(
        f"causes__{reference}",
        f"Errors by cause, {AGAINST[reference]}: means of the pixels in each bin, formed for each capture and averaged "
        f"over those that have some. Signed means (below) are drawn linearly up to {LINEAR_MM} mm.",
        f"Mean absolute and signed error of each method over {', '.join(CAUSES[cause] for cause in shown)}.",
        figure,
    )


def reliability(result: Result) -> Picture:
    """Share of all errors within the interval that each method's σ promises, over what it promises."""
    lines = result.reliability[result.reliability.pixels == "all"]
    references = [reference for reference in DRAWN if (lines.reference == reference).any()]
    figure = Figure(figsize=(3.2 * len(references) + 1.6, 3.2), layout="constrained")
    axes = figure.subplots(1, len(references), sharex=True, sharey=True, squeeze=False)[0]
    for axis, reference in zip(axes, references, strict=True):
        axis.plot((50, 100), (50, 100), color="0.6", linewidth=0.8)
        for method, mine in _of_methods(result, lines[lines.reference == reference]):
            _line(result, axis, method, mine.nominal_percent.to_numpy(), mine.observed_percent.to_numpy())
        axis.set(title=AGAINST[reference], xlabel="nominal coverage in %", xticks=sorted(set(lines.nominal_percent)))
    axes[0].set_ylabel("observed coverage in %")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside right center", frameon=False)
    return Picture(
        "reliability",
        "Reliability of σ: share of all errors that lie within the normal interval about the depth; on the grey line σ "
        "is right, below it too small.",
        "Observed over nominal coverage of each method that predicts its own error.",
        figure,
    )


def _of_methods(result: Result, lines: pd.DataFrame) -> Iterator[tuple[MethodFacts, pd.DataFrame]]:
    """Each method with its lines, if it has some."""
    for method in methods(result):
        mine = lines[lines.method == method.name]
        if len(mine):
            yield method, mine


def _line(result: Result, axis: Axes, method: MethodFacts, x: np.ndarray, y: np.ndarray) -> None:
    colour, marker = looks(m.name for m in methods(result))[method.name]
    axis.plot(x, y, color=colour, marker=marker, markersize=4, linewidth=0.9, label=method.title)
    axis.grid(alpha=0.25, linewidth=0.4)
