"""Figures of a whole result, by name: the report shows all that the result has data for, and `plot`
of the Python interface one of them."""

from collections.abc import Callable, Iterator

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from handbench.bench.evaluation.intervals import counted
from handbench.bench.evaluation.metrics import HEADLINE, chosen
from handbench.bench.results.result_folder import Result
from handbench.reports.figures.fronts import pictures, ranked_methods
from handbench.reports.figures.style import (
    COLUMN,
    DRAWN,
    DrawnMethod,
    Picture,
    add_legend,
    charts,
    drawn_references,
    log_axis,
    methods,
    styled,
    whiskers,
)
from handbench.reports.tables.table import AGAINST, against
from handbench.support.config import suggest
from handbench.support.errors import HandbenchError

DISTRIBUTION_MM = (0.02, 100)  # errors whose distribution is drawn
FEWEST = 3  # captures of a moving scene that a line connects
LINEAR_MM_S = 10.0  # of speeds, up to which their scale is linear


def plot(result: Result, kind: str) -> Figure:
    """Draw one figure of a result, as wide as a column of a paper.
    kind: a name in KINDS. Raises HandbenchError for an unknown kind, and for a result without the
    data of this figure."""
    drawn = {name: picture for name, (has_data, _, picture) in KINDS.items() if has_data(result)}
    if kind not in drawn:
        why = f"it draws {KINDS[kind][1]}" if kind in KINDS else suggest(kind, list(KINDS))
        raise HandbenchError(
            f"plot: '{kind}' is no figure of {result.folder} ({why}); choose from "
            f"{', '.join(drawn)}"
        )
    with styled(COLUMN):
        return drawn[kind](result).figure


def overview(result: Result) -> Iterator[Picture]:
    """Yield all figures of a result that it has data for."""
    yield from pictures(result)
    for kind, (has_data, _, picture) in KINDS.items():
        if kind != "time" and has_data(result):
            yield picture(result)


def error_over_time(result: Result) -> Picture:
    """Plot the error of each method over its seconds per frame: the first of `fronts.pictures`."""
    return next(pictures(result))


def error_of_captures(result: Result) -> Picture:
    """Plot the mean absolute error of each method on each capture as points, and their mean with
    its 95 % interval, with one panel for each reference."""
    lines = _first_frames(result)
    captures, shown = lines.capture.unique().tolist(), methods(result)
    drawn = {r: against(result, r) for r in DRAWN if (lines.reference == r).any()}
    wide_in = 1.4 + 0.32 * max(len(shown), 4)
    figure, axes = charts(drawn, "", f"{result.title(HEADLINE)} in mm", wide_in)
    for reference, axis in axes.items():
        _draw_columns(axis, shown, lines[lines.reference == reference])
        means = result.table[result.table.metric == HEADLINE]
        for column, method in enumerate(shown):
            of_method = (means.method == method.name) & (means.reference == reference)
            mean = means[of_method]
            bars = whiskers(mean.value, mean.low, mean.high)
            looks = method.style | {"marker": "_", "markersize": 16}
            axis.errorbar([column] * len(mean), mean.value, bars, elinewidth=1, **looks)
        log_axis(axis, "y")
    return Picture(
        "error_captures",
        f"Mean absolute error of each method on {len(captures)} captures: points, from "
        f"{captures[0]} to {captures[-1]}; lines: their mean, from five captures on with its 95 % "
        "interval.",
        "Mean absolute error of each method on each capture, and the mean.",
        figure,
    )


def error_distributions(result: Result) -> Picture:
    """Plot the cumulative distribution of each method's errors, with one panel for each reference
    surface: the share in % of the observed pixels of all captures whose |z − z_ref| is at most the
    value on the x axis."""
    drawn = {r: against(result, r) for r in drawn_references(result.scored())}
    figure, axes = charts(drawn, "|z − z_ref| in mm", "pixels in %")
    percent = np.linspace(0, 100, 401)
    for reference, axis in axes.items():
        captures = [c.name for c in result.scored() if reference in c.references]
        for i, method in enumerate(methods(result)):
            maps = (result.errors(name, method.name, reference).error_m for name in captures)
            error_m = np.concatenate([error_m[np.isfinite(error_m)] for error_m in maps])
            if len(error_m):
                every = (4 * i % 40, 40)  # markers of different methods do not fall on each other
                error_mm = 1e3 * np.percentile(np.abs(error_m), percent)
                axis.plot(error_mm, percent, **method.style, markevery=every)
        axis.set(xlim=DISTRIBUTION_MM, ylim=(0, 100))
        log_axis(axis, "x")
    add_legend(figure)
    return Picture(
        "error_distribution",
        "Share of the observed pixels, of all captures together, whose absolute error is not "
        "above the abscissa.",
        "Cumulative distribution of the absolute errors of each method.",
        figure,
    )


def errors_over_speed(result: Result) -> Picture:
    """Plot the depth error, and next to it the velocity error of the methods that measure it, over
    the mean radial speed of the surface: a marker for each capture, with a ring if the true speed
    is beyond the method's unambiguous velocity. Lines connect captures of one pose and step
    time."""
    shown = {
        metric: f"{result.title(metric)} in {result.about.metrics[metric].unit}"
        for metric in chosen("motion")
        if result.motion[metric].notna().any()
    }
    figure, axes = charts(shown, "mean radial speed in mm/s", "")
    poses = {capture.name: capture.pose for capture in result.about.captures}
    found = result.motion.assign(pose=result.motion.capture.map(poses)).sort_values("speed_mm_s")
    for metric, axis in axes.items():
        for method in methods(result):
            own = found[(found.method == method.name) & found[metric].notna()]
            for _, series in own.groupby(["pose", "step_time_s"], dropna=False):
                line = "-" if len(series) >= FEWEST else "none"
                axis.plot(series.speed_mm_s, series[metric], **method.style, linestyle=line)
            marked = own[own.velocity_beyond_percent > 0]
            speeds = marked.speed_mm_s
            axis.plot(speeds, marked[metric], "o", color="0.5", markersize=9, fillstyle="none")
        log_axis(axis, "y")
        axis.set_xscale("symlog", linthresh=LINEAR_MM_S, linscale=0.5)
        axis.set_xlim(-0.2 * LINEAR_MM_S, 1.5 * max(found.speed_mm_s.max(), LINEAR_MM_S))
        axis.xaxis.set_major_formatter("{x:g}")
    add_legend(figure)
    return Picture(
        "error_over_speed",
        "Error over speed: mean absolute error of depth and of radial velocity over the mean "
        f"radial speed of the surface, {AGAINST['truth']} at the start of the frame. Lines connect "
        "captures of one pose and step time; the others are single markers. Rings: at some pixels "
        "the speed is beyond the method's unambiguous velocity.",
        "Mean absolute errors of depth and velocity of each method over the speed.",
        figure,
    )


def error_over_frames(result: Result) -> Picture:
    """Plot the mean absolute error of each method over the frames of the captures that have
    several: thin lines for these captures, and points for their mean. There is one panel for each
    reference."""
    lines = _errors_of_maps(result)
    lines = lines[lines.capture.isin(lines.capture[lines.frame > 0])]
    drawn = {r: against(result, r) for r in DRAWN if (lines.reference == r).any()}
    figure, axes = charts(drawn, "frame", f"{result.title(HEADLINE)} in mm")
    for reference, axis in axes.items():
        for method in methods(result):
            mine = lines[(lines.method == method.name) & (lines.reference == reference)]
            maes_mm = mine.pivot(index="frame", columns="capture", values="value")
            every = max(len(maes_mm) // 10, 1)
            axis.plot(maes_mm, color=method.colour, linewidth=0.5, alpha=0.5)
            axis.plot(maes_mm.mean(axis=1), **method.style, markevery=every)
        log_axis(axis, "y")
        axis.xaxis.set_major_locator(MaxNLocator(integer=True))
    add_legend(figure)
    count = lines.capture.nunique()
    return Picture(
        "error_frames",
        f"Mean absolute error over the frames: points are the mean over {counted(count)}, thin "
        "lines the captures.",
        f"Mean absolute error of each method in {lines.frame.nunique()} frames.",
        figure,
    )


def repeats(result: Result) -> Picture:
    """Plot the precision: for each method and capture, the depth of the strongest scatterer in
    every repeated frame, in mm from the mean over these frames."""
    known = result.repeats.dropna(subset="z_m")
    means_m = known.groupby(["capture", "method"]).z_m.transform("mean")
    shown = [m for m in methods(result) if (known.method == m.name).any()]
    wide_in = 0.95 * max(len(shown), 3)
    figure, axes = charts({"": ""}, "", "z − mean z in mm", wide_in)
    _draw_columns(axes[""], shown, known.assign(value=1e3 * (known.z_m - means_m)))
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
        axis.plot(x, mine.value, **method.style, linestyle="none", alpha=0.6, mew=0)
    names = [method.title for method in shown]
    axis.set_xticks(range(len(names)), names, rotation=45, ha="right", rotation_mode="anchor")


def _has_maps(result: Result) -> bool:
    return bool(result.about.methods and drawn_references(result.scored()))


def _errors_of_maps(result: Result) -> pd.DataFrame:
    """Return the lines of the table of scores with the mean absolute errors in mm of all methods
    with their own settings, against the references of pictures."""
    scores = result.scores
    own = (scores.metric == HEADLINE) & (scores.treatment == "") & scores.value.notna()
    return scores[own & scores.reference.isin(DRAWN)]


def _first_frames(result: Result) -> pd.DataFrame:
    lines = _errors_of_maps(result)
    return lines[lines.frame == 0]


# name: whether a result has the data, what that is, and the function that draws it
KINDS: dict[str, tuple[Callable[[Result], bool], str, Callable[[Result], Picture]]] = {
    "time": (lambda r: bool(ranked_methods(r)), "errors with times", error_over_time),
    "captures": (
        lambda r: _first_frames(r).capture.nunique() > 1,
        "errors of several captures",
        error_of_captures,
    ),
    "ecdf": (_has_maps, "error maps", error_distributions),
    "frames": (
        lambda r: bool((_errors_of_maps(r).frame > 0).any()),
        "errors of several frames",
        error_over_frames,
    ),
    "speed": (lambda r: bool(len(r.motion)), "captures that move", errors_over_speed),
    "repeats": (lambda r: bool(r.repeats["repeat"].any()), "repeated frames", repeats),
}
