"""What the errors cost in time, how they are distributed, and how far repeats scatter."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter

from bench.results import Result, Row
from reports.style import AGAINST, Picture, looks, methods, time_text
from reports.tables import floor_note


def accuracy_against_time(result: Result) -> Picture:
    """MAE over seconds per frame with both intervals; the paper's MAE as an open marker at our time."""
    references = [r for r in AGAINST if any((row.metric, row.reference) == ("mae_mm", r) for row in result.rows)]
    figure, axes = _side_by_side(len(references))
    notes, handles = [], {}
    for axis, reference in zip(axes, references, strict=True):
        for method in methods(result):
            mae, time = (result.row(metric, method.name, reference) for metric in ("mae_mm", "seconds"))
            if not (mae and time and mae.value and time.value):
                continue
            colour, marker = looks(result)[method.name]
            x, y = time.value, mae.value
            style = {"color": colour, "marker": marker, "markersize": 6, "capsize": 3, "elinewidth": 1}
            handles[method.title] = axis.errorbar(x, y, _whiskers(mae), _whiskers(time), linestyle="none", **style)
            if mae.paper:
                axis.plot(x, mae.paper, marker, color=colour, markersize=6, fillstyle="none")
            notes.append(f"{method.title} {AGAINST[reference]}: {mae.value:.2f} mm in {time_text(result, method)}")
        axis.set(xlabel="seconds per frame", title=AGAINST[reference])
        axis.margins(0.15)
        for side in ("x", "y"):
            _log(axis, side)
    axes[0].set_ylabel("MAE in mm")
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
    references = [r for r in AGAINST if any(r in capture.references for capture in result.scored())]
    figure, axes = _side_by_side(len(references))
    for axis, reference in zip(axes, references, strict=True):
        for method in methods(result):
            errors_mm = _absolute_errors_mm(result, method.name, reference)
            share = 100 * np.arange(1, len(errors_mm) + 1) / max(len(errors_mm), 1)
            axis.step(errors_mm, share, where="post", color=looks(result)[method.name][0], label=method.title)
        _log(axis, "x")
        axis.set(xlim=(0.02, 100), ylim=(0, 100), xlabel="|z − z_ref| in mm", title=AGAINST[reference])
    axes[0].set_ylabel("share of observed pixels in %")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside right center", frameon=False)
    return Picture(
        "error_distribution",
        "Share of the observed pixels, of all captures together, whose absolute error is below the abscissa.",
        "Cumulative distribution of the absolute errors of each method.",
        figure,
    )


def repeats(result: Result) -> Picture:
    """Every repeat's depth of the strongest scatterer, from its hand's mean."""
    figure, (axis,) = _side_by_side(1)
    hands = sorted({repeat.capture for repeat in result.repeats})
    for column, method in enumerate(methods(result)):
        colour, marker = looks(result)[method.name]
        for i, hand in enumerate(hands):
            z_m = [r.z_m for r in result.repeats if (r.capture, r.method) == (hand, method.name) and r.z_m is not None]
            deviation_mm = 1e3 * (np.array(z_m) - np.mean(z_m)) if z_m else np.empty(0)
            place = column + 0.5 * (i - (len(hands) - 1) / 2) / max(len(hands), 1)
            axis.plot(np.full(len(z_m), place), deviation_mm, marker, color=colour, markersize=4, alpha=0.6, mew=0)
    axis.axhline(0, color="0.6", linewidth=0.6)
    axis.set_xticks(range(len(methods(result))), [method.title for method in methods(result)])
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


def _absolute_errors_mm(result: Result, method: str, reference: str) -> np.ndarray:
    """Sorted absolute errors of the observed pixels of all captures."""
    captures = [capture.name for capture in result.scored() if reference in capture.references]
    error_m = np.concatenate([result.errors(name, method, reference).error_m.ravel() for name in captures])
    return np.sort(1e3 * np.abs(error_m[np.isfinite(error_m)]))


def _whiskers(row: Row) -> list[list[float]] | None:
    if row.low is None or row.high is None:
        return None
    return [[row.value - row.low], [row.high - row.value]]


def _log(axis: Axes, side: str) -> None:
    """A logarithmic axis that reads 0.1, 0.2, 0.5, 1 rather than powers of ten."""
    axis.set(**{f"{side}scale": "log"})
    ticks = axis.xaxis if side == "x" else axis.yaxis
    low, high = ticks.get_view_interval()
    ticks.set_major_locator(LogLocator(subs=(1, 2, 5) if high / low < 300 else (1,)))
    ticks.set_major_formatter("{x:g}")
    ticks.set_minor_formatter(NullFormatter())
    axis.grid(axis=side, alpha=0.25, linewidth=0.4)
