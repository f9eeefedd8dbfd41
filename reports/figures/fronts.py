"""Pictures of accuracy against time: every setting of the methods, with those that no other beats
(the front)."""

from collections.abc import Iterator, Sequence
from textwrap import fill

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from handbench.bench.evaluation.front import front, fronts
from handbench.bench.evaluation.metrics import METRICS
from handbench.bench.results.about import titles
from handbench.bench.results.result_folder import Result
from handbench.reports.figures.style import (
    COLUMN_IN,
    INK,
    DrawnMethod,
    Picture,
    add_legend,
    drawn_methods,
    log_axis,
    narrow,
    whiskers,
)
from handbench.reports.tables.rounding import figure

LINE_IN = 0.165  # of a legend
LABEL_SHARE = np.array([0.08, 0.04])  # of the axes' width and height that a label takes


def ranked_methods(result: Result) -> dict[str, pd.DataFrame]:
    """Return the ranked settings of a result for each error: see `front.fronts`."""
    ids = {method.name: method.id for method in result.about.methods}
    return fronts(result.table, result.scores, ids)


def pictures(result: Result) -> Iterator[Picture]:
    """Yield a picture of error against time for each error of a result: of depth maps, and of
    reconstructed surfaces."""
    own = {method.name: method for method in result.about.methods}
    ids = [method.id for method in result.about.methods]
    single = {m.id: m.title for m in result.about.methods if ids.count(m.id) == 1}
    legend = {id: (titles() | single).get(id, id) for id in ids} | {"": "setting"}
    drawn = drawn_methods(legend)
    for metric, settings in ranked_methods(result).items():
        named = settings.assign(
            title=[own[name].title if name in own else name for name in settings.index],
            id=[own[name].id if name in own else "" for name in settings.index],
        )
        yield _draw(metric, named, drawn)


def _draw(metric: str, settings: pd.DataFrame, methods: Sequence[DrawnMethod]) -> Picture:
    """Plot the error over the seconds of all settings, on logarithmic axes.
    metric: that of the error; settings: ranked, with `title` and `id`; methods: whose
    names are these ids. Settings on
    the front are filled, the others faint. If an id has several settings, those on the front are
    numbered, and listed below the chart."""
    best = front(settings)
    swept = settings.id.nunique() < len(settings)
    texts = [fill(f"{i}  {title}", 50) for i, title in enumerate(best.title, 1)] * swept
    wide_in, columns = (COLUMN_IN, 1) if narrow() else (9, 2)
    rows = (
        sum(text.count("\n") + 1 for text in texts) / columns + narrow() * settings.id.nunique() / 2
    )
    picture = Figure(figsize=(wide_in, 3.5 + LINE_IN * rows), layout="constrained")
    axis = picture.subplots()
    line = best[best.error < best.error.cummin().shift(fill_value=np.inf)]
    axis.plot(line.seconds, line.error, color=INK, marker=".", label="front")
    for method in methods:
        for on_front, some in settings[settings.id == method.name].groupby("on_front"):
            looks = {"markersize": 6} if on_front else {"alpha": 0.6, "fillstyle": "none"}
            looks |= method.style | {"linestyle": "none", "capsize": 0, "elinewidth": 0.7}
            errors = whiskers(some.error, some.low, some.high)
            times = whiskers(some.seconds, some.seconds_low, some.seconds_high)
            axis.errorbar(some.seconds, some.error, errors, times, **looks)
    axis.margins(0.1)
    log_axis(axis, "x", "y")
    title, unit = METRICS[metric].title, METRICS[metric].unit
    axis.set(xlabel="seconds per frame", ylabel=f"{title} in {unit}")
    add_legend(picture)
    if swept:
        blank = [Line2D([], [], linestyle="none")] * len(texts)
        picture.legend(blank, texts, loc="outside lower left", ncols=columns, handlelength=0)
        for numbers, at in _labels(axis, best[["seconds", "error"]].to_numpy()):
            axis.annotate(numbers, at, (4, 4), textcoords="offset points")
    listed = "; ".join(
        f"{s.title}: {figure(s.error, s.low, s.high, unit)} {unit}, "
        f"{figure(s.seconds, s.seconds_low, s.seconds_high)} s"
        for _, s in best.iterrows()
    )
    return Picture(
        f"front_{metric}",
        f"{title} over seconds, with 95 % intervals. Filled points: no other is as good in time, "
        "accuracy and completeness together; faint, hollow points: one is. The line joins those "
        "that none beats in time and accuracy; the others on the front show more.",
        f"{title} against time of {len(settings)} settings. On the front, from fast to slow: "
        f"{listed}.",
        picture,
    )


def _labels(axis: Axes, points: np.ndarray) -> Iterator[tuple[str, tuple[float, float]]]:
    """Yield the numbers of points [n, 2], as drawn beside them, and the place: points that lie too
    close for separate labels share one, such as "15, 16, 21"."""
    places = axis.transAxes.inverted().transform(axis.transData.transform(points))
    groups: dict[int, list[str]] = {}
    for i, place in enumerate(places):
        near = [first for first in groups if (abs(place - places[first]) < LABEL_SHARE).all()]
        groups.setdefault(near[0] if near else i, []).append(str(i + 1))
    for first, numbers in groups.items():
        yield ", ".join(numbers), tuple(points[first])
