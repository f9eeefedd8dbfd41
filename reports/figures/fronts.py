"""Pictures of accuracy against time: every setting of the methods, with those that no other beats
(the front)."""

from collections.abc import Iterator
from itertools import groupby
from textwrap import wrap

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from handbench.bench.evaluation.front import SURFACE, front, fronts
from handbench.bench.evaluation.metrics import METRICS
from handbench.bench.results.about import titles
from handbench.bench.results.result_folder import Result
from handbench.reports.figures.style import COLUMN_IN, INK, Picture, drawn_methods, log_axis, narrow
from handbench.reports.tables.rounding import figure

LINE_IN = 0.165  # of a legend
LABEL_SHARE = np.array([0.05, 0.03])  # of the axes' width and height that a label takes


def is_swept(result: Result) -> bool:
    """Tell whether a result compares several settings of a method, or of the ground truth."""
    ids = [method.id for method in result.about.methods]
    return len(set(ids)) < len(ids) or SURFACE in set(result.scores.metric)


def ranked_methods(result: Result) -> dict[str, pd.DataFrame]:
    """Return the ranked settings of a result for each error: see `front.fronts`."""
    ids = {method.name: method.id for method in result.about.methods}
    return fronts(result.table, result.scores, ids)


def pictures(result: Result) -> Iterator[Picture]:
    """Yield a picture of error against time for each error of a result: of depth maps, and of
    reconstructed surfaces."""
    titles, ids = result.about.method_titles, {m.name: m.id for m in result.about.methods}
    for metric, settings in ranked_methods(result).items():
        named = settings.assign(
            title=[titles.get(name, name) for name in settings.index],
            id=[ids.get(name, "") for name in settings.index],
        )
        yield draw(metric, named)


def draw(metric: str, settings: pd.DataFrame) -> Picture:
    """Plot the error over the seconds of all settings, on logarithmic axes.
    metric: that of the error; settings: ranked, with `title` and `id` ("": no method). Settings on
    the front are numbered points, the others are faint."""
    best = front(settings)
    methods = drawn_methods(
        {id: titles().get(id, id) or "setting" for id in dict.fromkeys(settings.id)}
    )
    wide_in, high_in, abreast, of_styles = (COLUMN_IN, 2.9, 1, 2) if narrow() else (9, 4.4, 3, 6)
    lines = [f"{i}  " + "\n     ".join(wrap(title, 46)) for i, title in enumerate(best.title, 1)]
    rows = sum(text.count("\n") + 1 for text in lines) / abreast + 1
    rows += (len(methods) + 2) / of_styles
    picture = Figure(figsize=(wide_in, high_in + LINE_IN * rows), layout="constrained")
    axis = picture.subplots()
    line = best[best.error < best.error.cummin().shift(fill_value=np.inf)]
    axis.plot(line.seconds, line.error, color=INK, linewidth=1.2, zorder=2)
    for _, s in settings.iterrows():
        looks = (
            {"markersize": 6, "zorder": 3}
            if s.on_front
            else {"markersize": 4, "alpha": 0.4, "fillstyle": "none"}
        )
        bounds = (s.seconds, s.seconds_low, s.seconds_high), (s.error, s.low, s.high)
        methods[s.id].draw_point(axis, *bounds, elinewidth=0.7, linestyle="none", **looks)
    log_axis(axis, "x", "y")
    axis.margins(0.1)
    title, unit = METRICS[metric].title, METRICS[metric].unit
    axis.set(xlabel="seconds", ylabel=f"{title} in {unit}")
    handles = [
        Line2D([], [], color=m.colour, marker=m.marker, linestyle="none", label=m.title)
        for m in methods.values()
    ]
    handles.append(Line2D([], [], color=INK, marker=".", label="front"))
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
    for numbers, at in _labels(axis, best[["seconds", "error"]].to_numpy()):
        axis.annotate(numbers, at, (4, 4), textcoords="offset points", fontsize=8)
    listed = "; ".join(
        f"{s.title}: {figure(s.error, s.low, s.high, unit)} {unit}, "
        f"{figure(s.seconds, s.seconds_low, s.seconds_high, 's')} s"
        for _, s in best.iterrows()
    )
    return Picture(
        f"front_{metric}",
        f"{title} over seconds, with 95 % intervals. Filled, numbered points: no other setting is "
        "as good in time, accuracy and completeness together; faint, hollow points: one is. The "
        "line joins those that none beats in time and accuracy; the others on the front see more.",
        f"{title} against time of {len(settings)} settings. On the front, from fast to slow: "
        f"{listed}.",
        picture,
    )


def _labels(axis: Axes, points: np.ndarray) -> Iterator[tuple[str, tuple[float, float]]]:
    """Yield the numbers of points [n, 2], as drawn beside them, and the place: points that lie too
    close for separate labels share one, such as "15–18, 21"."""
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
        x, y = points[group[0]]
        yield ", ".join(words), (x, y)
