"""Figures of moving scenes: error over speed, and error over the frames."""

import pandas as pd
from matplotlib.figure import Figure

from handbench.bench.evaluation.metrics import HEADLINE, chosen
from handbench.bench.results.about import CaptureFacts
from handbench.bench.results.derived import START
from handbench.bench.results.result_folder import Result
from handbench.reports.figures.references import DRAWN
from handbench.reports.figures.style import (
    Picture,
    log_axis,
    methods,
    name_all,
    side_by_side,
    width_in,
)
from handbench.reports.tables.table import AGAINST

FEWEST = 3  # captures that a line connects
LINEAR_MM_S = 10.0  # of speeds, up to which their scale is linear


def errors_over_speed(result: Result) -> Picture:
    """Plot the depth error, and below it the velocity error of the methods that measure it, over
    the mean radial speed of the surface: a marker for each capture, with a ring if the true speed
    is beyond the method's unambiguous velocity. Lines connect captures of one pose and step
    time."""
    shown = [m for m in chosen("motion") if result.motion[m].notna().any()]
    figure = Figure(figsize=(width_in(5.4), 0.6 + 2.3 * len(shown)), layout="constrained")
    axes = figure.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
    poses = {capture.name: capture.pose for capture in result.about.captures}
    found = result.motion.assign(pose=result.motion.capture.map(poses)).sort_values("speed_mm_s")
    for axis, metric in zip(axes, shown, strict=True):
        for method in methods(result):
            own = found[(found.method == method.name) & found[metric].notna()]
            for _, series in own.groupby(["pose", "step_time_s"], dropna=False):
                line = "-" if len(series) >= FEWEST else "none"
                method.draw(axis, series.speed_mm_s, series[metric], linestyle=line)
            marked = own[own.velocity_beyond_percent > 0]
            ring = {"color": "0.5", "markersize": 9, "fillstyle": "none"}
            axis.plot(marked.speed_mm_s, marked[metric], "o", **ring)
        log_axis(axis, "y")
        axis.set_ylabel(f"{result.title(metric)} in {result.about.metrics[metric].unit}")
    axes[-1].set_xscale("symlog", linthresh=LINEAR_MM_S, linscale=0.5)
    axes[-1].set_xlim(-0.2 * LINEAR_MM_S, 1.5 * max(found.speed_mm_s.max(), LINEAR_MM_S))
    axes[-1].xaxis.set_major_formatter("{x:g}")
    axes[-1].set_xlabel("mean radial speed in mm/s")
    name_all(figure)
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


def sequences(result: Result) -> list[str]:
    """Return the names of the captures that have errors of several frames."""
    lines = errors_of_maps(result)
    return lines.capture[lines.frame > 0].unique().tolist()


def error_over_frames(result: Result, capture: CaptureFacts | None = None) -> Picture:
    """Plot the mean absolute error of each method over the frames of one capture, or of all that
    have several: thin lines for these captures, and points for their mean. There is one panel for
    each reference; the x axis is in seconds if the captures start their frames at the same known
    times."""
    names = [capture.name] if capture else sequences(result)
    lines, starts = errors_of_maps(result), result.scores[result.scores.metric == START]
    lines, starts = (of[of.capture.isin(names)] for of in (lines, starts))
    known = starts.groupby("frame").value
    timed = known.ngroups == lines.frame.nunique() and (known.nunique() == 1).all()
    figure, axes = side_by_side({r: AGAINST[r] for r in DRAWN if (lines.reference == r).any()})
    for reference, axis in axes.items():
        for method in methods(result):
            mine = lines[(lines.method == method.name) & (lines.reference == reference)]
            maes_mm = mine.pivot(index="frame", columns="capture", values="value")
            x = known.first().reindex(maes_mm.index) if timed else maes_mm.index
            every = max(len(x) // 10, 1)
            method.draw(axis, x, maes_mm.mean(axis=1), markevery=every, linewidth=1.2)
            if len(names) > 1:
                axis.plot(x, maes_mm, color=method.colour, linewidth=0.5, alpha=0.5)
        log_axis(axis, "y")
        axis.set(xlabel="start of the frame in s" if timed else "frame")
        axis.set_ylabel(f"{result.title(HEADLINE)} in mm")
        if not timed:
            axis.xaxis.get_major_locator().set_params(integer=True)
    name_all(figure)
    points = f"points are the mean over {len(names)} captures, thin lines the captures"
    return Picture(
        f"frames_{capture.name}" if capture else "error_frames",
        "Mean absolute error over the frames"
        + (f": {points}." if len(names) > 1 else f" of capture {names[0]}."),
        f"Mean absolute error of each method in {lines.frame.nunique()} frames.",
        figure,
    )
