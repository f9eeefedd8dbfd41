"""Figures of moving scenes: error over speed, and error over the frames."""

import pandas as pd
from matplotlib.ticker import MaxNLocator

from handbench.bench.evaluation.metrics import HEADLINE, chosen
from handbench.bench.results.result_folder import Result
from handbench.reports.figures.references import DRAWN
from handbench.reports.figures.style import Picture, add_legend, charts, log_axis, methods
from handbench.reports.tables.table import AGAINST

FEWEST = 3  # captures that a line connects
LINEAR_MM_S = 10.0  # of speeds, up to which their scale is linear


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


def errors_of_maps(result: Result) -> pd.DataFrame:
    """Return the lines of the table of scores with the mean absolute errors in mm of all methods
    with their own settings, against the references of pictures."""
    scores = result.scores
    own = (scores.metric == HEADLINE) & (scores.treatment == "") & scores.value.notna()
    return scores[own & scores.reference.isin(DRAWN)]


def error_over_frames(result: Result) -> Picture:
    """Plot the mean absolute error of each method over the frames of the captures that have
    several: thin lines for these captures, and points for their mean. There is one panel for each
    reference."""
    lines = errors_of_maps(result)
    lines = lines[lines.capture.isin(lines.capture[lines.frame > 0])]
    against = {r: AGAINST[r] for r in DRAWN if (lines.reference == r).any()}
    figure, axes = charts(against, "frame", f"{result.title(HEADLINE)} in mm")
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
        f"Mean absolute error over the frames: points are the mean over {count} captures, thin "
        "lines the captures.",
        f"Mean absolute error of each method in {lines.frame.nunique()} frames.",
        figure,
    )
