"""Figures of a result by name, for `plot` of the Python interface, and those of them that no other
module draws: error over the frames, error of each capture, and Bland–Altman."""

from collections.abc import Callable

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.scale import SymmetricalLogTransform

from handbench.bench.results import HEADLINE, Result
from handbench.bench.results.derived import START
from handbench.reports.figures.charts import (
    accuracy_against_time,
    error_counts,
    error_distributions,
    repeats,
    risk_coverage,
)
from handbench.reports.figures.style import (
    COLUMN,
    Picture,
    draw,
    log_axis,
    method_styles,
    methods,
    name_all,
    narrow,
    nth_style,
    side_by_side,
    whiskers,
    width_in,
)
from handbench.reports.tables.blocks import AGAINST, DRAWN, number
from handbench.support.config import suggest
from handbench.support.errors import HandbenchError

LINEAR_MM, LARGEST_MM = 1.0, 100.0  # of the axis of errors: linear up to the first
BINS = 60
AGREE = 1.96  # standard deviations from the bias to the limits of agreement


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


def ecdf(result: Result) -> Picture:
    """Plot the cumulative distribution of |z − z_ref| of each method, over the observed pixels of
    all captures."""
    return error_distributions(result, error_counts(result, result.scored()))


def error_over_frames(result: Result) -> Picture:
    """Plot the mean absolute error of each method over the frames, with one panel for each
    reference: thin lines for the captures, and points for their mean.
    The x axis is in seconds if all captures start their frames at the same known times."""
    lines = _maes(result)
    references = [r for r in DRAWN if lines[lines.reference == r].frame.any()]
    starts = result.scores[result.scores.metric == START].groupby("frame").value
    known = starts.ngroups == lines.frame.nunique() and (starts.nunique() == 1).all()
    start_s = starts.first() if known else None
    figure, axes = side_by_side(len(references))
    for axis, reference in zip(axes, references, strict=True):
        for method in methods(result):
            mine = lines[(lines.method == method.name) & (lines.reference == reference)]
            maes_mm = mine.pivot(index="frame", columns="capture", values="value")
            x = maes_mm.index if start_s is None else start_s.reindex(maes_mm.index)
            mean_mm = maes_mm.mean(axis=1)
            draw(result, axis, method, x, mean_mm, markevery=max(len(x) // 10, 1), linewidth=1.2)
            if maes_mm.shape[1] > 1:
                colour = axis.lines[-1].get_color()
                axis.plot(x, maes_mm, color=colour, linewidth=0.5, alpha=0.5)
        log_axis(axis, "y")
        axis.set(
            xlabel="frame" if start_s is None else "time in s",
            ylabel=f"{result.title(HEADLINE)} in mm",
            title=AGAINST[reference],
        )
        if start_s is None:
            axis.xaxis.get_major_locator().set_params(integer=True)
    name_all(figure, *axes[0].get_legend_handles_labels())
    return Picture(
        "error_frames",
        "Mean absolute error over the frames: points are the mean over the captures, thin lines "
        "the captures.",
        "Mean absolute error of each method in every frame.",
        figure,
    )


def error_of_captures(result: Result) -> Picture:
    """Plot the mean absolute error of each method on each capture as points, and their mean with
    its 95 % interval, with one panel for each reference."""
    lines = _maes(result)
    lines = lines[lines.frame == 0]
    references = [r for r in DRAWN if (lines.reference == r).any()]
    captures = list(dict.fromkeys(lines.capture))
    shown = methods(result)
    look = method_styles(m.name for m in shown)
    figure, axes = side_by_side(len(references), 1.4 + 0.32 * max(len(shown), 4))
    places = dict(zip(captures, np.linspace(-0.3, 0.3, len(captures) + 2)[1:-1], strict=True))
    for axis, reference in zip(axes, references, strict=True):
        for column, method in enumerate(shown):
            colour, marker = look[method.name]
            mine = lines[(lines.method == method.name) & (lines.reference == reference)]
            at = column + mine.capture.map(places)
            style = {"color": colour, "marker": marker, "markersize": 4, "alpha": 0.6, "mew": 0}
            axis.plot(at, mine.value, linestyle="none", **style)
            if mean := result.row(HEADLINE, method.name, reference):
                bars = whiskers(mean.value, mean.low, mean.high)
                axis.hlines(mean.value, column - 0.4, column + 0.4, color=colour, linewidth=1.5)
                axis.errorbar(column, mean.value, bars, color=colour, capsize=3, elinewidth=1)
        log_axis(axis, "y")
        titles = [method.title for method in shown]
        axis.set_xticks(range(len(shown)), titles, rotation=45, ha="right", rotation_mode="anchor")
        axis.set(ylabel=f"{result.title(HEADLINE)} in mm", title=AGAINST[reference])
        axis.label_outer()
    counted = f"{len(captures)} capture{'s' * (len(captures) != 1)}"
    return Picture(
        "error_captures",
        f"Mean absolute error of each method on {counted}: points, in the order "
        f"{', '.join(captures)}; lines: their mean, with its 95 % interval.",
        "Mean absolute error of each method on each capture, and the mean.",
        figure,
    )


def bland_altman(result: Result) -> Picture:
    """Plot the agreement of each method's depth map with the reference (Bland and Altman 1986):
    z − z_ref over (z + z_ref)/2, for the observed pixels of all captures against the first
    reference, with the bias and the limits of agreement, bias ± 1.96 standard deviations."""
    reference = _references(result)[0]
    shown = methods(result)
    columns = min(len(shown), 2 if narrow() else 4)
    rows = -(-len(shown) // columns)
    size_in = width_in(1.0 + 1.9 * columns), 0.6 + (1.5 if narrow() else 1.9) * rows
    figure = Figure(figsize=size_in, layout="constrained")
    axes = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    pairs = [_pairs_mm(result, method.name, reference) for method in shown]
    everywhere = np.concatenate([mean_mm for mean_mm, _ in pairs])
    edges = np.linspace(everywhere.min(), everywhere.max() + 1e-9, BINS + 1)
    symlog = SymmetricalLogTransform(10, LINEAR_MM, 1)
    low, high = symlog.transform(np.array([-LARGEST_MM, LARGEST_MM]))
    edges_mm = symlog.inverted().transform(np.linspace(low, high, BINS + 1))
    counts = [np.histogram2d(*pair, (edges, edges_mm))[0].T for pair in pairs]
    norm = LogNorm(1, max(2, *(count.max() for count in counts)))
    for i, (axis, method, count) in enumerate(zip(axes, shown, counts, strict=False)):
        axis.pcolormesh(edges, edges_mm, np.ma.masked_equal(count, 0), norm=norm)
        error_mm = pairs[i][1]
        bias_mm, reach_mm = error_mm.mean(), AGREE * error_mm.std()
        for level_mm, line in (
            (bias_mm, "-"),
            (bias_mm - reach_mm, "--"),
            (bias_mm + reach_mm, "--"),
        ):
            axis.axhline(level_mm, color=nth_style(1)[0], linestyle=line, linewidth=1)
        axis.set_title(f"{method.title}\n{number(bias_mm, 2)} ± {number(reach_mm, 2)} mm")
        axis.set_yscale("symlog", linthresh=LINEAR_MM)
        axis.set_ylim(-LARGEST_MM, LARGEST_MM)
        axis.yaxis.set_major_formatter("{x:g}")
        axis.grid(alpha=0.25, linewidth=0.4)
    for axis in axes[len(shown) :]:
        axis.set_axis_off()
    figure.supxlabel("(z + z_ref)/2 in mm", fontsize="medium")
    figure.supylabel("z − z_ref in mm", fontsize="medium")
    scale = ScalarMappable(norm)
    bar = figure.colorbar(scale, ax=axes, label="pixels", location="top", aspect=40)
    bar.ax.xaxis.set_major_formatter("{x:g}")
    return Picture(
        "bland_altman",
        f"Agreement of the depth maps with the reference, {AGAINST[reference]} (Bland–Altman): "
        "difference over mean of both depths, for the observed pixels of all captures. Lines: the "
        "bias, and 1.96 standard deviations to either side. Differences are drawn linearly up to "
        f"{LINEAR_MM:g} mm.",
        "Difference of map and reference over their mean, for each method.",
        figure,
    )


def _maes(result: Result) -> pd.DataFrame:
    """Return the lines of the table of scores with the mean absolute errors in mm of all methods
    with their own settings."""
    scores = result.scores
    return scores[(scores.metric == HEADLINE) & (scores.treatment == "") & scores.value.notna()]


def _references(result: Result) -> list[str]:
    return [r for r in DRAWN if any(r in capture.references for capture in result.scored())]


def _pairs_mm(result: Result, method: str, reference: str) -> tuple[np.ndarray, np.ndarray]:
    """Return (z + z_ref)/2 [n] and z − z_ref [n], both in mm, at all pixels that a method observed
    on any capture."""
    maps = [
        result.errors(capture.name, method, reference)
        for capture in result.scored()
        if reference in capture.references
    ]
    error_mm = 1e3 * np.concatenate([m.error_m.ravel() for m in maps])
    mean_mm = 1e3 * np.concatenate([m.reference_z_m.ravel() for m in maps]) + error_mm / 2
    seen = np.isfinite(error_mm)
    return mean_mm[seen], error_mm[seen]


# name: whether a result has the data, what that is, and the function that draws it
KINDS: dict[str, tuple[Callable[[Result], bool], str, Callable[[Result], Picture]]] = {
    "captures": (lambda r: bool(len(_maes(r))), "errors of captures", error_of_captures),
    "ecdf": (lambda r: bool(_references(r)), "error maps", ecdf),
    "bland-altman": (lambda r: bool(_references(r)), "error maps", bland_altman),
    "frames": (lambda r: bool(_maes(r).frame.any()), "errors of several frames", error_over_frames),
    "time": (lambda r: bool(len(_maes(r))), "errors of captures", accuracy_against_time),
    "coverage": (lambda r: bool(len(r.curves)), "risk–coverage curves", risk_coverage),
    "repeats": (lambda r: bool(len(r.repeats)), "repeated frames", repeats),
}
