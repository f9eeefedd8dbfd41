"""Charts that explain the errors: errors by cause, and reliability of the methods' σ."""

from collections.abc import Iterator
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from handbench.bench.results import Result, each
from handbench.reports.figures.style import (
    DrawnMethod,
    Picture,
    log_axis,
    methods,
    name_all,
    name_ticks,
    side_by_side,
    width_in,
)
from handbench.reports.tables.blocks import AGAINST, DRAWN

CAUSES = {
    "incidence_deg": "incidence angle in °",
    "below_maximum_db": "amplitude below the maximum in dB",
    "part": "part of the hand",
    "edge_distance_mm": "distance to an edge in mm",
}
ROWS = {"absolute_mm": "mean |z − z_ref| in mm", "mean_mm": "mean z − z_ref in mm"}
LINEAR_MM = 1  # of signed means, up to which their scale is linear


def cause_charts(result: Result) -> Iterator[Picture]:
    """Yield the charts that explain the errors: for each reference surface, the errors grouped by
    cause; and one chart that shows whether the methods' predicted σ is right. A chart without data
    is left out."""
    for reference in DRAWN:
        causes = result.causes[result.causes.reference == reference]
        if len(causes):
            yield by_cause(result, causes, reference)
    if len(result.reliability):
        yield reliability(result)


def bin_label(line: Any) -> str:
    """Return the label of one group of pixels on the axis of a cause: the part of the hand, or a
    range of values such as "10–20", or "≥ 20" for the last range.
    line: a row of the result's table `causes`."""
    return line.part or (
        f"{line.low:g}–{line.high:g}" if line.high == line.high else f"≥ {line.low:g}"
    )


def by_cause(result: Result, causes: pd.DataFrame, reference: str) -> Picture:
    """Plot each method's mean absolute error (above) and mean signed error (below), in mm, for
    groups of pixels by cause of error, such as ranges of incidence angle or parts of the hand.
    causes: the rows of the result's table `causes` for this reference surface."""
    shown = [cause for cause in CAUSES if (causes.cause == cause).any()]
    widths = [
        causes[causes.cause == cause].groupby(["part", "low"], dropna=False).ngroups + 1
        for cause in shown
    ]
    figure = Figure(
        figsize=(width_in(2.6 * len(shown) + 1.6, columns=2), 4.6), layout="constrained"
    )
    axes = figure.subplots(
        2, len(shown), sharex="col", sharey="row", squeeze=False, width_ratios=widths
    )
    for column, cause in zip(axes.T, shown, strict=True):
        lines = causes[causes.cause == cause].assign(
            bin=[bin_label(x) for x in each(causes[causes.cause == cause])]
        )
        bins = list(dict.fromkeys(lines.sort_values(["low", "part"]).bin))
        for axis, value in zip(column, ROWS, strict=True):
            for method, mine in _of_methods(result, lines):
                x = [bins.index(name) for name in mine.bin]
                method.draw(axis, x, mine[value], linewidth=0.9)
        column[1].axhline(0, color="0.6", linewidth=0.6)
        name_ticks(column[1], bins)
        column[1].set(xlim=(-0.5, len(bins) - 0.5), xlabel=CAUSES[cause])
    for axis, label in zip(axes[:, 0], ROWS.values(), strict=True):
        axis.set_ylabel(label)
    log_axis(axes[0, 0], "y")
    axes[1, 0].set_yscale("symlog", linthresh=LINEAR_MM)
    axes[1, 0].yaxis.set_major_formatter("{x:g}")
    figure.align_xlabels()
    name_all(figure)
    return Picture(
        f"causes__{reference}",
        f"Errors by cause, {AGAINST[reference]}: means of the pixels in each bin, formed for "
        "each capture and averaged "
        f"over those that have some. Signed means (below) are drawn linearly up to {LINEAR_MM} mm.",
        "Mean absolute and signed error of each method over "
        f"{', '.join(CAUSES[cause] for cause in shown)}.",
        figure,
    )


def reliability(result: Result) -> Picture:
    """Plot how often the error is inside the interval that a method's predicted σ gives: observed
    over nominal share in %, with a line for each method that predicts σ and a panel for each
    reference surface."""
    lines = result.reliability[result.reliability.pixels == "all"]
    known = {r: AGAINST[r] for r in DRAWN if (lines.reference == r).any()}
    figure, axes = side_by_side(known, 3.2)
    for reference, axis in axes.items():
        axis.plot((50, 100), (50, 100), color="0.6", linewidth=0.8)
        for method, mine in _of_methods(result, lines[lines.reference == reference]):
            method.draw(axis, mine.nominal_percent, mine.observed_percent, linewidth=0.9)
        axis.set(xlabel="nominal coverage in %", ylabel="observed coverage in %")
        axis.set_xticks(sorted(set(lines.nominal_percent)))
    name_all(figure)
    return Picture(
        "reliability",
        "Reliability of σ, the standard deviation that a method predicts for each of its depths: "
        "share of all errors inside the normal interval about the depth; on the grey line σ is "
        "right, below it too small.",
        "Observed over nominal coverage of each method that predicts its own error.",
        figure,
    )


def _of_methods(result: Result, lines: pd.DataFrame) -> Iterator[tuple[DrawnMethod, pd.DataFrame]]:
    """Yield each method that occurs in a table, together with its rows, in the order in which
    pictures show the methods."""
    for method in methods(result):
        mine = lines[lines.method == method.name]
        if len(mine):
            yield method, mine
