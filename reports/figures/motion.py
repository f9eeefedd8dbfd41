"""Figures of moving scenes: error over speed, and error over the time of the frames."""

from matplotlib.figure import Figure

from handbench.bench.results import HEADLINE, CaptureFacts, Result
from handbench.bench.results.derived import START
from handbench.reports.figures.style import Picture, draw, log_axis, methods, name_all, width_in
from handbench.reports.tables.blocks import AGAINST
from handbench.reports.tables.motion_table import BEYOND, VELOCITY

FEWEST = 3  # captures that a line connects
LINEAR_MM_S = 10.0  # of speeds, up to which their scale is linear


def errors_over_speed(result: Result) -> Picture:
    """Plot the depth error, and below it the velocity error of the methods that measure it, over
    the mean radial speed of the surface: a marker for each capture, with a ring if the true speed
    is beyond the method's unambiguous velocity. Lines connect captures of one pose and step
    time."""
    shown = [m for m in (HEADLINE, VELOCITY) if result.motion[m].notna().any()]
    figure = Figure(figsize=(width_in(5.4), 0.6 + 2.3 * len(shown)), layout="constrained")
    axes = figure.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
    poses = {capture.name: capture.pose for capture in result.about.captures}
    found = result.motion.assign(pose=result.motion.capture.map(poses)).sort_values("speed_mm_s")
    for axis, metric in zip(axes, shown, strict=True):
        for method in methods(result):
            own = found[(found.method == method.name) & found[metric].notna()]
            for _, series in own.groupby(["pose", "step_time_s"], dropna=False):
                line = "-" if len(series) >= FEWEST else "none"
                draw(result, axis, method, series.speed_mm_s, series[metric], linestyle=line)
            marked = own[own[BEYOND] > 0]
            ring = {"color": "0.5", "markersize": 9, "fillstyle": "none"}
            axis.plot(marked.speed_mm_s, marked[metric], "o", **ring)
        log_axis(axis, "y")
        axis.set_ylabel(f"{result.title(metric)} in {result.about.metrics[metric].unit}")
    axes[-1].set_xscale("symlog", linthresh=LINEAR_MM_S, linscale=0.5)
    axes[-1].set_xlim(-0.2 * LINEAR_MM_S, 1.5 * max(found.speed_mm_s.max(), LINEAR_MM_S))
    axes[-1].xaxis.set_major_formatter("{x:g}")
    axes[-1].set_xlabel("mean radial speed in mm/s")
    named = dict(zip(*axes[0].get_legend_handles_labels()[::-1], strict=True))
    name_all(figure, named.values(), named)
    return Picture(
        "error_over_speed",
        "Error over speed: mean absolute error of depth and of radial velocity over the mean "
        f"radial speed of the surface, {AGAINST['truth']} at the start of the frame. Lines connect "
        "captures of one pose and step time; the others are single markers. Rings: at some pixels "
        "the speed is beyond the method's unambiguous velocity.",
        "Mean absolute errors of depth and velocity of each method over the speed.",
        figure,
    )


def errors_over_time(result: Result, capture: CaptureFacts) -> Picture | None:
    """Plot the mean absolute error of each method over the time of a capture's frames; None if it
    has one frame, or frames without times."""
    lines = result.scores[result.scores.metric.isin([START, HEADLINE])]
    lines = lines[(lines.capture == capture.name) & (lines.treatment == "")]
    keys = ["reference", "method", "frame"]
    frames = lines.pivot(index=keys, columns="metric", values="value")
    scores = frames.reindex(columns=[START, HEADLINE]).dropna().reset_index()
    lengths = scores.groupby("reference").frame.nunique()
    reference = next((r for r in AGAINST if lengths.get(r, 0) > 1), None)
    if reference is None:
        return None
    figure = Figure(figsize=(width_in(5.4), 2.8), layout="constrained")
    axis = figure.subplots()
    for method in methods(result):
        own = scores[(scores.reference == reference) & (scores.method == method.name)]
        draw(result, axis, method, own[START], own[HEADLINE])
    log_axis(axis, "y")
    axis.set(xlabel="start of the frame in s", ylabel=f"{result.title(HEADLINE)} in mm")
    name_all(figure, *axis.get_legend_handles_labels())
    return Picture(
        f"over_time_{capture.name}",
        f"Capture {capture.name}: mean absolute error of each frame {AGAINST[reference]}, over the "
        "time at which the frame starts.",
        f"Mean absolute error of each method over {lengths[reference]} frames of {capture.name}.",
        figure,
    )
