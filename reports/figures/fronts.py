"""Pictures of a trade-off: error against time of every setting, the front that none beats, and where time goes."""

from __future__ import annotations

from collections.abc import Iterator
from textwrap import wrap

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter

from bench.results import HEADLINE, Section, Setting, Tradeoff
from reports.figures.style import COLOURS, Picture, log_axis, look, looks, whiskers
from reports.tables.blocks import figure as figure_text
from reports.tables.blocks import known, number, three_digits

NAMES = 20  # of the front beside the picture at most
PARTS = {  # of a frame's time: name, colour, hatch
    "acquisition_s": ("acquisition", COLOURS[5], "//"),
    "imaging_s": ("imaging", COLOURS[0], ""),
    "extraction_s": ("extraction", COLOURS[2], "xx"),
}
BARS = 40  # settings with a bar at most; the front's come first


def pictures(found: Tradeoff) -> Iterator[Picture]:
    """Each section's front and, where the parts of its time are known, how they add up."""
    for about in found.facts.sections:
        settings = found.section(about.name)
        if any(plotted(setting) for setting in settings):
            yield front(about, settings)
        if any(parts(setting) for setting in settings):
            yield time_split(about, settings)


def plotted(setting: Setting) -> bool:
    """True where it has a place on logarithmic axes."""
    return known(setting.error, setting.seconds) and setting.error > 0 and setting.seconds > 0


def front(about: Section, settings: tuple[Setting, ...]) -> Picture:
    """Error over seconds: the front as a line of numbered points, the other settings faint, the reference in a square;
    colours and markers are the methods', where settings have one."""
    shown = [s for s in settings if plotted(s)]
    best = sorted((s for s in shown if s.on_front), key=lambda s: s.seconds)
    styles = _look(shown)
    picture = Figure(figsize=(9, 4.6), layout="constrained")
    axis = picture.subplots()
    line = [s for i, s in enumerate(best) if all(s.error < before.error for before in best[:i])]
    axis.plot([s.seconds for s in line], [s.error for s in line], color="0.25", linewidth=1.2, zorder=2)
    for s in shown:
        colour, marker = styles[s.method]
        bold = {"markersize": 6, "zorder": 3} if s.on_front else {"markersize": 4, "alpha": 0.4, "fillstyle": "none"}
        bars = whiskers(s.error, s.low, s.high), whiskers(s.seconds, s.seconds_low, s.seconds_high)
        style = {"color": colour, "marker": marker, "elinewidth": 0.7, "linestyle": "none"}
        axis.errorbar(s.seconds, s.error, *bars, **style, **bold)
    for i, s in enumerate(best, 1):
        axis.annotate(str(i), (s.seconds, s.error), (5, 5), textcoords="offset points", fontsize=8, zorder=5)
    reference = next((s for s in settings if s.name == about.reference), None)
    if reference in shown:
        axis.plot(reference.seconds, reference.error, "s", color="0.25", fillstyle="none", markersize=12, zorder=4)
    for side in ("x", "y"):
        log_axis(axis, side)
    axis.margins(0.1)
    axis.set(xlabel="seconds", ylabel=f"{metric_words(about)} in {about.unit}")
    if reference and reference.seconds:
        _ratios(axis, reference)
    handles = _legend(shown, best, reference in shown)
    picture.legend(handles=handles, loc="outside right upper", frameon=False, fontsize=7.5)
    told = "; ".join(f"{s.title}: {error_text(s)}, {seconds_text(s)}" for s in best)
    framed = f" The square marks the reference, {reference.title}." if reference in shown else ""
    if len(shown) < len(settings):
        framed += " Settings with no error, or without a figure, have no place on these axes and stand in the table."
    return Picture(
        f"front_{about.name}",
        f"{about.title}: {metric_words(about)} over seconds, with the 95 % interval of the error and the range of the "
        f"repeats. Filled, numbered points: no other setting is as good in {_what(shown)}; faint, hollow points: one "
        f"is.{_beside(line, best)}{framed}",
        f"{metric_words(about)} against time of {len(shown)} settings. On the front, from fast to slow: {told}.",
        picture,
    )


def _what(shown: list[Setting]) -> str:
    complete = any(known(s.seen_percent) for s in shown)
    return "time, accuracy and completeness together" if complete else "both time and accuracy"


def _beside(line: list[Setting], best: list[Setting]) -> str:
    """A sentence on the numbered points off the line; empty where there is none."""
    return " The line joins those that none beats in time and accuracy alone; the others see more." * (line != best)


def _look(shown: list[Setting]) -> dict[str, tuple[str, str]]:
    """Colour and marker of each method, and of settings of no method."""
    return looks(filter(None, (s.method for s in shown))) | {"": look(0)}


def metric_words(about: Section) -> str:
    """The section's metric as a person writes it."""
    name = about.metric.removesuffix("_percent").removesuffix(f"_{about.unit}").replace("_", " ")
    return name.upper() if about.metric in (HEADLINE, "rmse_mm") else name


def _ratios(axis: Axes, reference: Setting) -> None:
    """The same axis above, in times of the reference's seconds."""
    above = axis.secondary_xaxis("top", functions=(lambda s: s / reference.seconds, lambda r: r * reference.seconds))
    above.set_xlabel(f"time ÷ that of {reference.title}")
    above.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    above.xaxis.set_major_formatter("{x:g}")
    above.xaxis.set_minor_formatter(NullFormatter())


def _legend(shown: list[Setting], best: list[Setting], reference: bool) -> list[Line2D]:
    """The markers' meaning, then the names of the front's numbers."""
    names = dict.fromkeys(s.method for s in shown)
    handles = []
    for name, (colour, marker) in ((name, _look(shown)[name]) for name in names):
        style = {"color": colour, "marker": marker, "markersize": 5, "linestyle": "none"}
        handles.append(Line2D([], [], **style, label=name or "setting"))
    handles.append(Line2D([], [], color="0.25", marker=".", label="front, from fast to slow:"))
    numbers = [f"   {i}  " + "\n        ".join(wrap(s.title, 40)) for i, s in enumerate(best[:NAMES], 1)]
    numbers += [f"   … {len(best) - NAMES} more in the table"] if len(best) > NAMES else []
    handles += [Line2D([], [], linestyle="none", label=number) for number in numbers]
    if reference:
        square = {"marker": "s", "markersize": 9, "fillstyle": "none", "linestyle": "none"}
        handles.append(Line2D([], [], color="0.25", **square, label="reference"))
    return handles


def parts(setting: Setting) -> list[float]:
    """The parts of a frame's time, as far as they are known; [] where none is."""
    values = [getattr(setting, part) for part in PARTS]
    return [value or 0.0 for value in values] if any(values) else []


def time_split(about: Section, settings: tuple[Setting, ...]) -> Picture:
    """Two bars for each setting: the shares of a frame's time, with the whole in seconds at their end; and the plan,
    which many frames share."""
    known = sorted((s for s in settings if parts(s)), key=lambda s: not s.on_front)[:BARS]
    known.sort(key=lambda s: sum(parts(s)))
    figure = Figure(figsize=(9, 1.1 + 0.2 * len(known)), layout="constrained")
    frame, plan = figure.subplots(1, 2, sharey=True, width_ratios=(3, 1))
    seconds = np.array([parts(s) for s in known])
    shares = 100 * seconds / seconds.sum(axis=1, keepdims=True)
    left = np.zeros(len(known))
    for (name, colour, hatch), share in zip(PARTS.values(), shares.T, strict=True):
        frame.barh(
            range(len(known)), share, left=left, color=colour, hatch=hatch, edgecolor="white", linewidth=0.4, label=name
        )
        left += share
    for row, total in enumerate(seconds.sum(axis=1)):
        frame.annotate(f" {number(total, three_digits(total))} s", (100, row), va="center", fontsize=7.5)
    plan.barh(range(len(known)), [s.plan_s or 0 for s in known], color="0.55")
    plan.set_xlabel("plan in seconds")
    frame.set_yticks(range(len(known)), [s.title for s in known], fontsize=7.5)
    frame.set(xlim=(0, 115), xlabel="share of a frame's time in %", xticks=range(0, 101, 20))
    frame.set_ylim(len(known) - 0.4, -0.6)
    figure.legend(loc="outside upper center", ncols=len(PARTS), frameon=False, fontsize=8)
    left_out = sum(bool(parts(s)) for s in settings) - len(known)
    more = f" {left_out} settings that others beat are left out." if left_out else ""
    return Picture(
        f"time_{about.name}",
        f"{about.title}: where the time of one frame goes, with the whole at the end of each bar; at the right what "
        f"its plan takes, once for a geometry.{more}",
        "; ".join(f"{s.title}: " + ", ".join(_parts_in_words(s)) for s in known) + ".",
        figure,
    )


def _parts_in_words(setting: Setting) -> list[str]:
    named = zip(PARTS.values(), parts(setting), strict=True)
    values = [(name, value) for (name, *_), value in named] + [("plan", setting.plan_s)]
    return [f"{name} {number(value, three_digits(value))} s" for name, value in values if value]


def error_text(s: Setting, unit: bool = True) -> str:
    """Its error with the interval."""
    return figure_text(s.error, s.low, s.high, s.unit) + (f" {s.unit}" if unit else "")


def seconds_text(s: Setting, unit: bool = True) -> str:
    """Its time with the range."""
    return figure_text(s.seconds, s.seconds_low, s.seconds_high, "s") + (" s" if unit else "")
