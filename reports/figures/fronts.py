"""Pictures of a trade-off: error against time of every setting, with those that no other beats (the
front), and how the time of each setting is divided."""

from collections.abc import Iterator
from textwrap import wrap

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter

from handbench.bench.results import HEADLINE, Section, Setting, Tradeoff
from handbench.reports.figures.motion import over_speed
from handbench.reports.figures.numbers import number_points
from handbench.reports.figures.style import (
    COLOURS,
    COLUMN_IN,
    INK,
    DrawnMethod,
    Picture,
    drawn_methods,
    log_axis,
    narrow,
    nth_style,
)
from handbench.reports.tables.blocks import error_text, is_known, rounded, seconds_text

LINE_IN = 0.165  # of a legend
PARTS = {  # of a frame's time: name, colour, hatch
    "acquisition_s": ("acquisition", COLOURS[5], "//"),
    "imaging_s": ("imaging", COLOURS[0], ""),
    "extraction_s": ("extraction", COLOURS[2], "xx"),
}
BARS = 40  # settings with a bar at most; the front's come first


def pictures(found: Tradeoff) -> Iterator[Picture]:
    """Yield the pictures of a trade-off. For each section, such as imaging or ground truth, this is
    error against time of its settings (or against the speed of the target), and a bar chart of how
    the time is divided, if that is known."""
    for about in found.facts.sections:
        settings = found.section(about.name)
        if any(setting.speed_m_s is not None and setting.error for setting in settings):
            yield over_speed(about, settings)
        elif any(is_plottable(setting) for setting in settings):
            yield front(about, settings)
        if any(parts(setting) for setting in settings):
            yield time_split(about, settings)


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
    if reference and reference.seconds:
        _ratios(axis, reference.title, reference.seconds)
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
    if best:
        # lays it out: only then are the positions of points and numbers known
        picture.draw_without_rendering()
        _number(axis, best, shown, line)
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


def _number(axis: Axes, best: list[Setting], shown: list[Setting], line: list[Setting]) -> None:
    """Write numbers next to the points of the front (`best`), where they cover no other setting, no
    interval and not the line that joins the front.
    shown: all settings drawn; line: the settings that the line joins."""
    ends = [
        [(s.seconds_low, s.error), (s.seconds_high, s.error)]
        for s in shown
        if is_known(s.seconds_low)
    ]
    ends += [[(s.seconds, s.low), (s.seconds, s.high)] for s in shown if is_known(s.low)]
    crossed = [np.array(end, dtype=float) for end in (*ends, [(s.seconds, s.error) for s in line])]
    others = np.array([(s.seconds, s.error) for s in shown if s not in best]).reshape(-1, 2)
    number_points(axis, np.array([(s.seconds, s.error) for s in best]), others, crossed)


def metric_words(about: Section) -> str:
    """Return the error metric of a trade-off's section in words and without its unit, such as "MAE"
    for mae_mm."""
    name = about.metric.removesuffix("_percent").removesuffix(f"_{about.unit}").replace("_", " ")
    return name.upper() if about.metric in (HEADLINE, "rmse_mm") else name


def _ratios(axis: Axes, title: str, seconds: float) -> None:
    """Add a second time axis at the top, in multiples of the time of the reference setting.
    title, seconds: of the reference setting."""
    above = axis.secondary_xaxis(
        "top", functions=(lambda s: np.divide(s, seconds), lambda r: np.multiply(r, seconds))
    )
    above.set_xlabel(f"time ÷ that of {title}")
    above.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    above.xaxis.set_major_formatter("{x:g}")
    above.xaxis.set_minor_formatter(NullFormatter())


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


def parts(setting: Setting) -> list[float]:
    """Return the seconds that acquisition, imaging and extraction of depths take for one frame; 0
    for an unknown one, and [] if none is known."""
    values = [getattr(setting, part) for part in PARTS]
    return [value or 0.0 for value in values] if any(values) else []


def time_split(about: Section, settings: tuple[Setting, ...]) -> Picture:
    """Plot how the time of each setting is divided, as two bars.
    The left bar has the shares in % of acquisition, imaging and extraction of depths in the time of
    a frame, and the total in seconds. The right bar has the seconds of the preparation (plan),
    which is done once for a geometry and shared by many frames. At most 40 settings (BARS) are
    drawn, those on the front first."""
    with_parts = sorted((s for s in settings if parts(s)), key=lambda s: not s.on_front)
    known, left_out = sorted(with_parts[:BARS], key=lambda s: sum(parts(s))), len(with_parts[BARS:])
    names = ["\n".join(wrap(s.title, 24)) if narrow() else s.title for s in known]
    lines = sum(name.count("\n") + 1 for name in names)
    figure = Figure(figsize=(COLUMN_IN if narrow() else 9, 1.1 + 0.2 * lines), layout="constrained")
    frame, plan = figure.subplots(1, 2, sharey=True, width_ratios=(3, 1))
    rows, seconds = np.arange(len(known)), np.array([parts(s) for s in known])
    shares = 100 * seconds / seconds.sum(axis=1, keepdims=True)
    left = np.zeros(len(known))
    for (name, colour, hatch), share in zip(PARTS.values(), shares.T, strict=True):
        frame.barh(
            rows,
            share,
            left=left,
            color=colour,
            hatch=hatch,
            edgecolor="white",
            linewidth=0.4,
            label=name,
        )
        left += share
    for row, total in enumerate(seconds.sum(axis=1)):
        frame.annotate(f" {rounded(total)} s", (100, row), va="center", fontsize=8)
    plan.barh(rows, [s.plan_s or 0 for s in known], color="0.55")
    plan.set_xlabel("plan in s" if narrow() else "plan in seconds")
    frame.set_yticks(range(len(known)), names, fontsize=8)
    frame.set(xlim=(0, 170 if narrow() else 115), xticks=range(0, 101, 50 if narrow() else 20))
    frame.set_xlabel("share of time in %" if narrow() else "share of a frame's time in %")
    frame.set_ylim(len(known) - 0.4, -0.6)
    figure.legend(loc="outside upper center", ncols=len(PARTS), frameon=False, fontsize=8)
    more = f" {left_out} settings that others beat are left out." if left_out else ""
    return Picture(
        f"time_{about.name}",
        f"{about.title}: where the time of one frame goes, with the whole at the end of each "
        "bar; at the right what "
        f"its plan takes, once for a geometry.{more}",
        "; ".join(f"{s.title}: " + ", ".join(_parts_in_words(s)) for s in known) + ".",
        figure,
    )


def _parts_in_words(setting: Setting) -> list[str]:
    values = zip(
        [*(name for name, *_ in PARTS.values()), "plan"],
        [*parts(setting), setting.plan_s],
        strict=True,
    )
    return [f"{name} {rounded(value)} s" for name, value in values if value]
