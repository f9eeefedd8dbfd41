"""Pictures of a trade-off: error against time of every setting, with those that no other beats (the
front)."""

from collections.abc import Iterator
from itertools import groupby
from textwrap import wrap

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from handbench.bench.results import HEADLINE, Section, Setting, Tradeoff
from handbench.reports.figures.style import (
    COLUMN_IN,
    INK,
    DrawnMethod,
    Picture,
    drawn_methods,
    log_axis,
    narrow,
    nth_style,
)
from handbench.reports.tables.blocks import error_text, is_known, seconds_text

LINE_IN = 0.165  # of a legend
LABEL_SHARE = np.array([0.05, 0.03])  # of the axes' width and height that a label takes


def pictures(found: Tradeoff) -> Iterator[Picture]:
    """Yield the pictures of a trade-off: for each section, such as imaging or ground truth, error
    against time of its settings."""
    for about in found.facts.sections:
        settings = found.section(about.name)
        if any(is_plottable(setting) for setting in settings):
            yield front(about, settings)


def is_plottable(setting: Setting) -> bool:
    """Tell whether a setting's error and time are known and above zero, so that it can be drawn on
    logarithmic axes."""
    return bool(setting.error and setting.seconds and setting.error > 0 and setting.seconds > 0)


def front(about: Section, settings: tuple[Setting, ...]) -> Picture:
    """Plot the error over the seconds of computing for all settings in one part of a trade-off,
    for example those of imaging.
    Settings that no other beats (the front) are numbered points, the others are faint, and the
    reference setting is in a square. If settings have a method, they have its colour and marker."""
    shown = [s for s in settings if is_plottable(s)]
    best = sorted((s for s in shown if s.on_front), key=lambda s: s.seconds)
    # some settings have no method
    names = dict.fromkeys(s.method for s in shown)
    methods = drawn_methods({name: name for name in names if name})
    if "" in names:
        methods[""] = DrawnMethod("", "setting", *nth_style(0))
    wide_in, high_in, abreast, of_styles = (COLUMN_IN, 2.9, 1, 2) if narrow() else (9, 4.4, 3, 6)
    lines = [f"{i}  " + "\n     ".join(wrap(s.title, 46)) for i, s in enumerate(best, 1)]
    rows = sum(text.count("\n") + 1 for text in lines) / abreast + 1
    rows += (len(names) + 2) / of_styles
    picture = Figure(figsize=(wide_in, high_in + LINE_IN * rows), layout="constrained")
    axis = picture.subplots()
    line = [s for i, s in enumerate(best) if all(s.error < before.error for before in best[:i])]
    axis.plot(
        [s.seconds for s in line], [s.error for s in line], color=INK, linewidth=1.2, zorder=2
    )
    for s in shown:
        bold = (
            {"markersize": 6, "zorder": 3}
            if s.on_front
            else {"markersize": 4, "alpha": 0.4, "fillstyle": "none"}
        )
        bounds = (s.seconds, s.seconds_low, s.seconds_high), (s.error, s.low, s.high)
        methods[s.method].draw_point(axis, *bounds, elinewidth=0.7, linestyle="none", **bold)
    reference = next((s for s in settings if s.name == about.reference), None)
    if reference in shown:
        axis.plot(
            reference.seconds,
            reference.error,
            "s",
            color=INK,
            fillstyle="none",
            markersize=12,
            zorder=4,
        )
    log_axis(axis, "x", "y")
    axis.margins(0.1)
    axis.set(xlabel="seconds", ylabel=f"{metric_words(about)} in {about.unit}")
    handles = _legend([methods[name] for name in names], reference in shown)
    plain = {
        "frameon": False,
        "fontsize": 8,
        "labelspacing": 0.25,
        "columnspacing": 1,
        "handletextpad": 0.3,
    }
    picture.legend(handles=handles, loc="outside upper center", ncols=of_styles, **plain)
    blank = [Line2D([], [], linestyle="none", label=text) for text in lines]
    picture.legend(
        handles=blank, loc="outside lower center", ncols=abreast, handlelength=0, **plain
    )
    for numbers, at in _labels(axis, best):
        axis.annotate(numbers, at, (4, 4), textcoords="offset points", fontsize=8)
    listed = "; ".join(f"{s.title}: {error_text(s)} {s.unit}, {seconds_text(s)} s" for s in best)
    more = any(is_known(s.seen_percent) for s in shown)
    good = "time, accuracy and completeness together" if more else "both time and accuracy"
    notes = ""
    if line != best:
        notes += " The line joins those that none beats in time and accuracy; the others see more."
    if reference in shown:
        notes += f" The square marks the reference, {reference.title}."
    if len(shown) < len(settings):
        notes += (
            " Settings with no error, or without a figure, have no place on these axes and "
            "are in the table."
        )
    return Picture(
        f"front_{about.name}",
        f"{about.title}: {metric_words(about)} over seconds, with the 95 % interval of the error "
        "and the range of the "
        f"repeats. Filled, numbered points: no other setting is as good in {good}; faint, hollow "
        "points: one "
        f"is.{notes}",
        f"{metric_words(about)} against time of {len(shown)} settings. On the front, from fast "
        f"to slow: {listed}.",
        picture,
    )


def metric_words(about: Section) -> str:
    """Return the error metric of a trade-off's section in words and without its unit, such as "MAE"
    for mae_mm."""
    name = about.metric.removesuffix("_percent").removesuffix(f"_{about.unit}").replace("_", " ")
    return name.upper() if about.metric in (HEADLINE, "rmse_mm") else name


def _labels(axis: Axes, best: list[Setting]) -> Iterator[tuple[str, tuple[float, float]]]:
    """Yield the numbers of settings, as drawn beside their points, and the point: those of points
    that lie too close for labels of their own share one, such as "15–18, 21"."""
    points = [(s.seconds or 0.0, s.error or 0.0) for s in best]
    places = axis.transAxes.inverted().transform(axis.transData.transform(points))
    groups: list[list[int]] = []
    for i, place in enumerate(places):
        near = (g for g in groups if (np.abs(place - places[g[0]]) < LABEL_SHARE).all())
        if (group := next(near, None)) is None:
            groups.append([i])
        else:
            group.append(i)
    for group in groups:
        runs = groupby(enumerate(group, 1), lambda pair: pair[1] - pair[0])
        spans = ([i + 1 for _, i in run] for _, run in runs)
        words = (f"{run[0]}–{run[-1]}" if run[1:] else str(run[0]) for run in spans)
        yield ", ".join(words), points[group[0]]


def _legend(methods: list[DrawnMethod], reference: bool) -> list[Line2D]:
    """Return the entries of the legend: one for each method, one for the front and, if `reference`
    is true, one for the square around the reference setting."""
    handles = [
        Line2D([], [], color=m.colour, marker=m.marker, linestyle="none", label=m.title)
        for m in methods
    ]
    handles.append(Line2D([], [], color=INK, marker=".", label="front"))
    if reference:
        square = Line2D(
            [], [], color=INK, marker="s", markersize=9, fillstyle="none", linestyle="none"
        )
        square.set_label("reference")
        handles.append(square)
    return handles
