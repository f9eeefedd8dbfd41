"""Charts of a whole result: errors against time, their distribution, and how far repeats scatter."""

from collections.abc import Iterator

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from bench.results import HEADLINE, Result
from bench.results.about import TREATMENTS
from reports.figures.style import Picture, log_axis, looks, methods, time_text, whiskers
from reports.tables.blocks import AGAINST, DRAWN, floor_note

EDGES_MM = np.geomspace(0.02, 100, 400)


def overview(result: Result) -> Iterator[Picture]:
    """The pictures of all captures together that the result has the data for."""
    if (result.table.metric == HEADLINE).any():
        yield accuracy_against_time(result)
    if result.about.methods and any(capture.references for capture in result.scored()):
        yield error_distributions(result)
    if len(result.curves):
        yield risk_coverage(result)
    if len(result.repeats):
        yield repeats(result)


def accuracy_against_time(result: Result) -> Picture:
    """Mean error over seconds per frame with both intervals; the paper's as an open marker at our time."""
    scored = set(result.table.reference[result.table.metric == HEADLINE])
    references = [reference for reference in DRAWN if reference in scored]
    figure, axes = _side_by_side(len(references))
    look = looks(m.name for m in methods(result))
    notes, handles = [], {}
    for axis, reference in zip(axes, references, strict=True):
        for method in methods(result):
            error, time = (result.row(metric, method.name, reference) for metric in (HEADLINE, "seconds"))
            if not (error and time and error.value > 0 and time.value > 0):
                continue
            colour, marker = look[method.name]
            x, y = time.value, error.value
            bars = (whiskers(of.value, of.low, of.high) for of in (error, time))
            style = {"color": colour, "marker": marker, "markersize": 6, "capsize": 3, "elinewidth": 1}
            handles[method.title] = axis.errorbar(x, y, *bars, linestyle="none", **style)
            if error.paper > 0:
                axis.plot(x, error.paper, marker, color=colour, markersize=6, fillstyle="none")
            notes.append(f"{method.title} {AGAINST[reference]}: {error.value:.2f} mm in {time_text(result, method)}")
        axis.set(xlabel="seconds per frame", title=AGAINST[reference])
        axis.margins(0.15)
        for side in ("x", "y"):
            log_axis(axis, side)
    axes[0].set_ylabel(f"{result.title(HEADLINE)} in mm")
    handles["paper (at our time)"] = Line2D([], [], color="0.3", marker="o", linestyle="none", fillstyle="none")
    figure.legend(handles.values(), handles.keys(), loc="outside right center", frameon=False)
    return Picture(
        "accuracy_time",
        "Accuracy against time: mean absolute error over seconds per frame, with 95 % intervals. "
        f"Open markers: the paper's error, drawn at our time.{floor_note(result)}",
        f"Mean absolute error against time per frame. {'; '.join(notes)}.",
        figure,
    )


def error_distributions(result: Result) -> Picture:
    """Share of the observed pixels whose error is smaller than e: the whole distribution, not only its mean."""
    references = [r for r in DRAWN if any(r in capture.references for capture in result.scored())]
    figure, axes = _side_by_side(len(references))
    look = looks(m.name for m in methods(result))
    for axis, reference in zip(axes, references, strict=True):
        for i, method in enumerate(methods(result)):
            colour, marker = look[method.name]
            share = _shares(result, method.name, reference)
            every = (4 * i % 40, 40)  # markers of different methods do not fall on each other
            axis.plot(EDGES_MM, share, color=colour, marker=marker, markevery=every, markersize=4, label=method.title)
        log_axis(axis, "x")
        axis.set(xlim=EDGES_MM[[0, -1]], ylim=(0, 100), xlabel="|z − z_ref| in mm", title=AGAINST[reference])
        axis.grid(alpha=0.25, linewidth=0.4)
    axes[0].set_ylabel("share of observed pixels in %")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside right center", frameon=False)
    return Picture(
        "error_distribution",
        "Share of the observed pixels, of all captures together, whose absolute error is not above the abscissa.",
        "Cumulative distribution of the absolute errors of each method.",
        figure,
    )


def risk_coverage(result: Result) -> Picture:
    """Error over completeness: each method's strongest pixels, as many as make up a share of the surface."""
    figure, axes = _side_by_side(len(TREATMENTS))
    look = looks(m.name for m in methods(result))
    reference = result.curves.reference.iloc[0]
    for axis, (treatment, said) in zip(axes, TREATMENTS.items(), strict=True):
        for method in methods(result):
            curve = result.curves[(result.curves.method == method.name) & (result.curves.treatment == treatment)]
            colour, marker = look[method.name]
            style = {"color": colour, "marker": marker, "markevery": 10, "markersize": 4, "label": method.title}
            axis.plot(curve.share_percent, curve.risk_mm, **style)
        log_axis(axis, "y")
        axis.set(xlabel="share of the surface in %", title=said)
        axis.grid(alpha=0.25, linewidth=0.4)
    axes[0].set_ylabel(f"{result.title(HEADLINE)} in mm")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside right center", frameon=False)
    return Picture(
        "risk_coverage",
        f"Error over completeness {AGAINST[reference]}: the mean absolute error of each method's strongest pixels, as "
        "many as make up a share of the surface. No threshold decides; the mean of the captures.",
        "Mean absolute error over completeness for each method, unsmoothed and all smoothed alike.",
        figure,
    )


def _shares(result: Result, method: str, reference: str) -> np.ndarray:
    """Percentage of the observed pixels of all captures with an absolute error up to each of EDGES_MM; read capture by
    capture, for there may be a thousand."""
    below, observed = np.zeros(len(EDGES_MM)), 0
    for capture in result.scored():
        if reference in capture.references:
            error_m = result.errors(capture.name, method, reference).error_m
            error_mm = np.sort(1e3 * np.abs(error_m[np.isfinite(error_m)]))
            below += np.searchsorted(error_mm, EDGES_MM, side="right")
            observed += len(error_mm)
    return 100 * below / observed if observed else np.full(len(EDGES_MM), np.nan)


def repeats(result: Result) -> Picture:
    """Every repeat's depth of the strongest scatterer, from its hand's mean."""
    hands = sorted(set(result.repeats.capture))
    repeated = [m for m in methods(result) if (result.repeats.method == m.name).any()]
    figure = Figure(figsize=(1.6 + 0.95 * max(len(repeated), 3), 3.2), layout="constrained")
    axis = figure.subplots()
    look = looks(m.name for m in methods(result))
    for column, method in enumerate(repeated):
        colour, marker = look[method.name]
        mine = result.repeats[result.repeats.method == method.name].dropna(subset="z_m")
        for i, hand in enumerate(hands):
            z_m = mine.z_m[mine.capture == hand].to_numpy()
            deviation_mm = 1e3 * (z_m - z_m.mean()) if len(z_m) else z_m
            place = column + 0.5 * (i - (len(hands) - 1) / 2) / max(len(hands), 1)
            place_of = np.full(len(z_m), place)
            axis.plot(place_of, deviation_mm, ls="none", marker=marker, color=colour, markersize=4, alpha=0.6, mew=0)
    axis.axhline(0, color="0.6", linewidth=0.6)
    axis.set_xticks(range(len(repeated)), [method.title for method in repeated])
    axis.set_ylabel("z − mean z of the hand in mm")
    axis.grid(axis="y", alpha=0.25, linewidth=0.4)
    return Picture(
        "repeats",
        f"Precision: depth of the strongest scatterer in each repeat, from the mean of its hand; a column for each of "
        f"{len(hands)} hands.",
        "Scatter of the strongest scatterer's depth over the repeats, for each method and hand.",
        figure,
    )


def _side_by_side(columns: int) -> tuple[Figure, np.ndarray]:
    figure = Figure(figsize=(3.6 * columns + 1.6, 3.2), layout="constrained")
    return figure, figure.subplots(1, columns, sharex=True, sharey=True, squeeze=False)[0]
