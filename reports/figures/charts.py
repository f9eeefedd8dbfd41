"""Charts of a whole result: error against time, distribution of errors, scatter over repeats,
errors by cause, and reliability of the methods' σ."""

from collections.abc import Iterable, Iterator
from functools import reduce
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from handbench.bench.results import HEADLINE, CaptureFacts, MethodFacts, Result, each
from handbench.bench.results.about import TREATMENTS
from handbench.reports.figures.motion import errors_over_speed
from handbench.reports.figures.style import (
    Picture,
    draw,
    log_axis,
    method_styles,
    methods,
    name_all,
    side_by_side,
    time_text,
    whiskers,
)
from handbench.reports.figures.style import width_in as wide
from handbench.reports.tables.blocks import AGAINST, DRAWN, beside_paper, floor_note

EDGES_MM = np.geomspace(0.02, 100, 400)
Counts = dict[tuple[str, str], np.ndarray]  # by method and reference
CAUSES = {
    "incidence_deg": "incidence angle in °",
    "below_maximum_db": "amplitude below the maximum in dB",
    "part": "part of the hand",
    "edge_distance_mm": "distance to an edge in mm",
}
ROWS = {"absolute_mm": "mean |z − z_ref| in mm", "mean_mm": "mean z − z_ref in mm"}
LINEAR_MM = 1  # of signed means, up to which their scale is linear


def overview(result: Result, counts: Counts | None = None) -> Iterator[Picture]:
    """Yield the pictures that summarise all captures of a result: error against time, distribution
    of the errors, error over completeness, scatter over repeats, and error over speed. A picture is
    left out if the result has no data for it.

    counts: numbers of pixels by error, over all captures that are compared with a reference, as
    `error_counts` returns them. If None, they are counted here, which reads every error map.
    """
    if (result.table.metric == HEADLINE).any():
        yield accuracy_against_time(result)
    if result.about.methods and any(capture.references for capture in result.scored()):
        yield error_distributions(result, counts or error_counts(result, result.scored()))
    if len(result.curves):
        yield risk_coverage(result)
    if len(result.repeats):
        yield repeats(result)
    if len(result.motion):
        yield errors_over_speed(result)


def accuracy_against_time(result: Result) -> Picture:
    """Plot the mean absolute error of each method over its seconds per frame, with one panel for
    each reference surface.
    Error bars show the 95 % intervals of both. An open marker shows the error that the paper
    reports, drawn at the time measured here."""
    scored = set(result.table.reference[result.table.metric == HEADLINE])
    references = [reference for reference in DRAWN if reference in scored]
    figure, axes = side_by_side(len(references))
    look = method_styles(m.name for m in methods(result))
    notes, handles = [], {}
    for axis, reference in zip(axes, references, strict=True):
        for method in methods(result):
            error, time = (
                result.row(metric, method.name, reference) for metric in (HEADLINE, "seconds")
            )
            if not (error and time and error.value > 0 and time.value > 0):
                continue
            colour, marker = look[method.name]
            x, y = time.value, error.value
            bars = (whiskers(of.value, of.low, of.high) for of in (error, time))
            style = {
                "color": colour,
                "marker": marker,
                "markersize": 6,
                "capsize": 3,
                "elinewidth": 1,
            }
            handles[method.title] = axis.errorbar(x, y, *bars, linestyle="none", **style)
            if error.paper > 0:
                axis.plot(x, error.paper, marker, color=colour, markersize=6, fillstyle="none")
            notes.append(
                f"{method.title} {AGAINST[reference]}: {error.value:.2f} mm in "
                f"{time_text(result, method)}"
            )
        axis.set(
            xlabel="seconds per frame",
            ylabel=f"{result.title(HEADLINE)} in mm",
            title=AGAINST[reference],
        )
        axis.margins(0.15)
        for side in ("x", "y"):
            log_axis(axis, side)
    hollow = ""
    if beside_paper(result):
        hollow = " Open markers: the paper's error, drawn at our time."
        handles["paper (at our time)"] = Line2D(
            [], [], color="0.5", marker="o", linestyle="none", fillstyle="none"
        )
    name_all(figure, handles.values(), handles)
    return Picture(
        "accuracy_time",
        "Accuracy against time: mean absolute error over seconds per frame, with 95 % intervals."
        f"{hollow}{floor_note(result)}",
        f"Mean absolute error against time per frame. {'; '.join(notes)}.",
        figure,
    )


def error_distributions(result: Result, counts: Counts) -> Picture:
    """Plot the cumulative distribution of each method's errors, with one panel for each reference
    surface: the share in % of the observed pixels of all captures whose |z − z_ref| is at most the
    value on the x axis.
    counts: numbers of pixels by error, as `error_counts` returns them."""
    references = [r for r in DRAWN if any(r in capture.references for capture in result.scored())]
    figure, axes = side_by_side(len(references))
    for axis, reference in zip(axes, references, strict=True):
        for i, method in enumerate(methods(result)):
            every = (4 * i % 40, 40)  # markers of different methods do not fall on each other
            *below, observed = counts[method.name, reference]
            shares = 100 * np.array(below) / (observed or np.nan)
            draw(result, axis, method, EDGES_MM, shares, markevery=every)
        log_axis(axis, "x")
        axis.set(
            xlim=EDGES_MM[[0, -1]],
            ylim=(0, 100),
            xlabel="|z − z_ref| in mm",
            title=AGAINST[reference],
        )
        axis.set_ylabel("pixels in %")
    name_all(figure, *axes[0].get_legend_handles_labels())
    return Picture(
        "error_distribution",
        "Share of the observed pixels, of all captures together, whose absolute error is not "
        "above the abscissa.",
        "Cumulative distribution of the absolute errors of each method.",
        figure,
    )


def risk_coverage(result: Result) -> Picture:
    """Plot error over completeness, with a line for each method: for each share of the surface in
    %, the mean absolute error in mm of the strongest pixels that cover this share.
    One panel shows the depth maps without smoothing, the other all of them with the same
    smoothing."""
    figure, axes = side_by_side(len(TREATMENTS))
    reference = result.curves.reference.iloc[0]
    for axis, (treatment, words) in zip(axes, TREATMENTS.items(), strict=True):
        for method in methods(result):
            curve = result.curves[
                (result.curves.method == method.name) & (result.curves.treatment == treatment)
            ]
            draw(result, axis, method, curve.share_percent, curve.risk_mm, markevery=10)
        log_axis(axis, "y")
        axis.set(
            xlabel="share of the surface in %",
            ylabel=f"{result.title(HEADLINE)} in mm",
            title=words,
        )
    name_all(figure, *axes[0].get_legend_handles_labels())
    return Picture(
        "risk_coverage",
        f"Error over completeness {AGAINST[reference]}: the mean absolute error of each method's "
        "strongest pixels, as "
        "many as make up a share of the surface. No threshold decides; the mean of the captures.",
        "Mean absolute error over completeness for each method, unsmoothed and with the same "
        "smoothing.",
        figure,
    )


def error_counts(result: Result, captures: Iterable[CaptureFacts]) -> Counts:
    """Count the pixels of several captures by the size of their error: (method, reference) → array.
    Value i of an array is the number of observed pixels with |z − z_ref| up to a limit,
    EDGES_MM[i]; the last value is the number of all observed pixels."""
    counts = {
        (m.name, reference): np.zeros(len(EDGES_MM) + 1, int)
        for m in methods(result)
        for reference in DRAWN
    }
    for capture in captures:
        for method, reference in (key for key in counts if key[1] in capture.references):
            error_m = result.errors(capture.name, method, reference).error_m
            error_mm = np.sort(1e3 * np.abs(error_m[np.isfinite(error_m)]))
            counts[method, reference] += [
                *np.searchsorted(error_mm, EDGES_MM, side="right"),
                len(error_mm),
            ]
    return counts


def total_counts(parts: Iterable[Counts]) -> Counts:
    """Return the sum of the pixel counts that `error_counts` gave for several groups of captures.
    The groups must not overlap, because a capture in two of them would count twice."""
    return reduce(lambda a, b: {key: a[key] + b[key] for key in a}, parts)


def repeats(result: Result) -> Picture:
    """Plot the precision: for each method and capture, the depth of the strongest scatterer in
    every repeated frame, in mm from the mean over these frames."""
    hands = sorted(set(result.repeats.capture))
    repeated = [m for m in methods(result) if (result.repeats.method == m.name).any()]
    figure = Figure(figsize=(wide(1.6 + 0.95 * max(len(repeated), 3)), 3.2), layout="constrained")
    axis = figure.subplots()
    look = method_styles(m.name for m in methods(result))
    for column, method in enumerate(repeated):
        colour, marker = look[method.name]
        mine = result.repeats[result.repeats.method == method.name].dropna(subset="z_m")
        for i, hand in enumerate(hands):
            z_m = mine.z_m[mine.capture == hand].to_numpy()
            deviation_mm = 1e3 * (z_m - z_m.mean()) if len(z_m) else z_m
            place = column + 0.5 * (i - (len(hands) - 1) / 2) / max(len(hands), 1)
            place_of = np.full(len(z_m), place)
            axis.plot(
                place_of,
                deviation_mm,
                ls="none",
                marker=marker,
                color=colour,
                markersize=4,
                alpha=0.6,
                mew=0,
            )
    axis.axhline(0, color="0.6", linewidth=0.6)
    titles = [method.title for method in repeated]
    axis.set_xticks(range(len(repeated)), titles, rotation=30, ha="right", rotation_mode="anchor")
    axis.set_ylabel("z − mean z of the capture in mm")
    axis.grid(axis="y", alpha=0.25, linewidth=0.4)
    return Picture(
        "repeats",
        "Precision: depth of the strongest scatterer in each repeat, from the mean of its "
        f"capture{f'; a column for each of {len(hands)} captures' if len(hands) > 1 else ''}.",
        "Scatter of the strongest scatterer's depth over the repeats, for each method and capture.",
        figure,
    )


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
    figure = Figure(figsize=(wide(2.6 * len(shown) + 1.6, columns=2), 4.6), layout="constrained")
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
                draw(
                    result,
                    axis,
                    method,
                    [bins.index(name) for name in mine.bin],
                    mine[value],
                    linewidth=0.9,
                )
        column[1].axhline(0, color="0.6", linewidth=0.6)
        column[1].set_xticks(
            range(len(bins)), bins, rotation=45, ha="right", rotation_mode="anchor"
        )
        column[1].set(xlim=(-0.5, len(bins) - 0.5), xlabel=CAUSES[cause])
    for axis, label in zip(axes[:, 0], ROWS.values(), strict=True):
        axis.set_ylabel(label)
    log_axis(axes[0, 0], "y")
    axes[1, 0].set_yscale("symlog", linthresh=LINEAR_MM)
    axes[1, 0].yaxis.set_major_formatter("{x:g}")
    figure.align_xlabels()
    name_all(figure, *axes[0, 0].get_legend_handles_labels())
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
    references = [reference for reference in DRAWN if (lines.reference == reference).any()]
    figure, axes = side_by_side(len(references), 3.2)
    for axis, reference in zip(axes, references, strict=True):
        axis.plot((50, 100), (50, 100), color="0.6", linewidth=0.8)
        for method, mine in _of_methods(result, lines[lines.reference == reference]):
            draw(result, axis, method, mine.nominal_percent, mine.observed_percent, linewidth=0.9)
        axis.set(
            title=AGAINST[reference],
            xlabel="nominal coverage in %",
            ylabel="observed coverage in %",
        )
        axis.set_xticks(sorted(set(lines.nominal_percent)))
    name_all(figure, *axes[0].get_legend_handles_labels())
    return Picture(
        "reliability",
        "Reliability of σ: share of all errors inside the normal interval about the "
        "depth; on the grey line σ "
        "is right, below it too small.",
        "Observed over nominal coverage of each method that predicts its own error.",
        figure,
    )


def _of_methods(result: Result, lines: pd.DataFrame) -> Iterator[tuple[MethodFacts, pd.DataFrame]]:
    """Yield each method that occurs in a table, together with its rows, in the order in which
    pictures show the methods."""
    for method in methods(result):
        mine = lines[lines.method == method.name]
        if len(mine):
            yield method, mine
