"""Figures of a whole result, by name: the report shows all that the result has data for, and `plot`
of the Python interface one of them."""

from collections.abc import Callable, Iterator
from typing import Any

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from handbench.bench.evaluation.metrics import HEADLINE
from handbench.bench.results.result_folder import Result
from handbench.reports.figures.motion import (
    error_over_frames,
    errors_of_maps,
    errors_over_speed,
    sequences,
)
from handbench.reports.figures.pixel_errors import Counts, error_distributions
from handbench.reports.figures.references import DRAWN, drawn_references, floor_note
from handbench.reports.figures.style import (
    COLUMN,
    DrawnMethod,
    Picture,
    log_axis,
    methods,
    name_all,
    name_ticks,
    side_by_side,
    time_text,
    width_in,
)
from handbench.reports.tables.table import AGAINST
from handbench.support.config import suggest
from handbench.support.errors import HandbenchError


def plot(result: Result, kind: str) -> Figure:
    """Draw one figure of a result, as wide as a column of a paper.
    kind: a name in KINDS. Raises HandbenchError for an unknown kind, and for a result without the
    data of this figure."""
    if kind not in KINDS:
        hint = suggest(kind, list(KINDS))
        raise HandbenchError(f"plot: unknown kind '{kind}'; {hint} (known: {', '.join(KINDS)})")
    has_data, needs, picture = KINDS[kind]
    if not has_data(result):
        raise HandbenchError(
            f"{result.folder}: has no {needs}, which '{kind}' draws; choose another kind "
            f"({', '.join(KINDS)})"
        )
    with matplotlib.rc_context(COLUMN):
        return picture(result).figure


def overview(result: Result, counts: Counts | None = None) -> Iterator[Picture]:
    """Yield all figures of a result that it has data for.
    counts: pixels by their errors, over all captures, as `error_counts` returns them. If None, they
    are counted here, which reads every error map."""
    for has_data, _, picture in KINDS.values():
        if has_data(result):
            counted = picture is error_distributions
            yield picture(result, counts) if counted else picture(result)


def accuracy_against_time(result: Result) -> Picture:
    """Plot the mean absolute error of each method over its seconds per frame, with one panel for
    each reference surface.
    Error bars show the 95 % intervals of both. An open marker shows the error that the paper
    reports, drawn at the time measured here."""
    points = _timed(result)
    figure, axes = side_by_side({r: AGAINST[r] for r in dict.fromkeys(r for r, *_ in points)})
    notes = []
    for reference, method, error, time in points:
        axis, bounds = axes[reference], [(of.value, of.low, of.high) for of in (time, error)]
        style: dict[str, Any] = {
            "linestyle": "none",
            "markersize": 6,
            "capsize": 3,
            "elinewidth": 1,
        }
        method.draw_point(axis, *bounds, **style)
        if error.paper > 0:
            hollow: dict[str, Any] = {"markersize": 6, "fillstyle": "none", "label": None}
            method.draw(axis, [time.value], [error.paper], **hollow)
        notes.append(
            f"{method.title} {AGAINST[reference]}: {error.value:.2f} mm in "
            f"{time_text(result, method)}"
        )
    for axis in axes.values():
        axis.set(xlabel="seconds per frame", ylabel=f"{result.title(HEADLINE)} in mm")
        axis.margins(0.15)
        log_axis(axis, "x", "y")
    of_paper, hollow_note = {}, ""
    if result.table.paper.notna().any():
        hollow_note = " Open markers: the paper's error, drawn at our time."
        mark = Line2D([], [], color="0.5", marker="o", linestyle="none", fillstyle="none")
        of_paper = {"paper (at our time)": mark}
    name_all(figure, **of_paper)
    return Picture(
        "accuracy_time",
        "Accuracy against time: mean absolute error over seconds per frame, with 95 % intervals."
        f"{hollow_note}{floor_note(result)}",
        f"Mean absolute error against time per frame. {'; '.join(notes)}.",
        figure,
    )


def _timed(result: Result) -> list[tuple[str, DrawnMethod, Any, Any]]:
    """Return (reference, method, line with its MAE, line with its time) of the main table, where
    both are above 0."""
    lines = [
        (r, m, *(result.row(metric, m.name, r) for metric in (HEADLINE, "seconds")))
        for r in DRAWN
        for m in methods(result)
    ]
    return [
        (r, m, error, time)
        for r, m, error, time in lines
        if error and time and error.value > 0 and time.value > 0
    ]


def error_of_captures(result: Result) -> Picture:
    """Plot the mean absolute error of each method on each capture as points, and their mean with
    its 95 % interval, with one panel for each reference."""
    lines = _first_frames(result)
    captures, shown = lines.capture.unique().tolist(), methods(result)
    drawn = {r: AGAINST[r] for r in DRAWN if (lines.reference == r).any()}
    figure, axes = side_by_side(drawn, 1.4 + 0.32 * max(len(shown), 4))
    for reference, axis in axes.items():
        _draw_columns(axis, shown, lines[lines.reference == reference])
        for column, method in enumerate(shown):
            if mean := result.row(HEADLINE, method.name, reference):
                ends = column - 0.4, column + 0.4
                axis.hlines(mean.value, *ends, color=method.colour, linewidth=1.5)
                bar: dict[str, Any] = {"marker": "none", "capsize": 3, "elinewidth": 1}
                bounds = mean.value, mean.low, mean.high
                method.draw_point(axis, (column, None, None), bounds, **bar)
        log_axis(axis, "y")
        axis.set_ylabel(f"{result.title(HEADLINE)} in mm")
        axis.label_outer()
    return Picture(
        "error_captures",
        f"Mean absolute error of each method on {len(captures)} captures: points, from "
        f"{captures[0]} to {captures[-1]}; lines: their mean, from five captures on with its 95 % "
        "interval.",
        "Mean absolute error of each method on each capture, and the mean.",
        figure,
    )


def repeats(result: Result) -> Picture:
    """Plot the precision: for each method and capture, the depth of the strongest scatterer in
    every repeated frame, in mm from the mean over these frames."""
    known = result.repeats.dropna(subset="z_m")
    means_m = known.groupby(["capture", "method"]).z_m.transform("mean")
    shown = [m for m in methods(result) if (known.method == m.name).any()]
    figure = Figure(figsize=(width_in(1.6 + 0.95 * max(len(shown), 3)), 3.2), layout="constrained")
    axis = figure.subplots()
    _draw_columns(axis, shown, known.assign(value=1e3 * (known.z_m - means_m)))
    axis.axhline(0, color="0.6", linewidth=0.6)
    axis.set_ylabel("z − mean z of the capture in mm")
    count = known.capture.nunique()
    return Picture(
        "repeats",
        "Precision: depth of the strongest scatterer in each repeat, from the mean of its "
        f"capture{f'; a column for each of {count} captures' if count > 1 else ''}.",
        "Scatter of the strongest scatterer's depth over the repeats, for each method and capture.",
        figure,
    )


def _draw_columns(axis: Axes, shown: list[DrawnMethod], lines: pd.DataFrame) -> None:
    """Draw values as points, in a column for each method and in it at a place for each capture.
    lines: with the columns capture, method and value."""
    captures = lines.capture.unique()
    places = dict(zip(captures, np.linspace(-0.3, 0.3, len(captures) + 2)[1:-1], strict=True))
    for column, method in enumerate(shown):
        mine = lines[lines.method == method.name]
        x = column + mine.capture.map(places)
        method.draw(axis, x, mine.value, linestyle="none", alpha=0.6, mew=0)
    name_ticks(axis, [method.title for method in shown])


def _has_maps(result: Result) -> bool:
    return bool(result.about.methods and drawn_references(result.scored()))


def _first_frames(result: Result) -> pd.DataFrame:
    lines = errors_of_maps(result)
    return lines[lines.frame == 0]


# name: whether a result has the data, what that is, and the function that draws it
KINDS: dict[str, tuple[Callable[[Result], bool], str, Callable[..., Picture]]] = {
    "time": (lambda r: bool(_timed(r)), "errors with times", accuracy_against_time),
    "captures": (
        lambda r: _first_frames(r).capture.nunique() > 1,
        "errors of several captures",
        error_of_captures,
    ),
    "ecdf": (_has_maps, "error maps", error_distributions),
    "frames": (lambda r: bool(sequences(r)), "errors of several frames", error_over_frames),
    "speed": (lambda r: bool(len(r.motion)), "captures that move", errors_over_speed),
    "repeats": (lambda r: bool(r.repeats["repeat"].any()), "repeated frames", repeats),
}
