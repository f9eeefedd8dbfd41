"""Figures of all pixels' errors: their cumulative distribution, and the agreement of map and
reference (Bland–Altman). Pixels are counted map by map, so that pages can share the work."""

from collections import Counter
from collections.abc import Iterable, Sequence
from functools import reduce
from typing import NamedTuple

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.scale import SymmetricalLogTransform

from handbench.bench.results import CaptureFacts, ErrorMap, Result
from handbench.reports.figures.style import (
    Picture,
    log_axis,
    methods,
    name_all,
    narrow,
    nth_style,
    side_by_side,
    width_in,
)
from handbench.reports.tables.blocks import AGAINST, DRAWN, drawn_references, number

EDGES_MM = np.geomspace(0.02, 100, 400)
LINEAR_MM, LARGEST_MM = 1.0, 100.0  # of the axis of signed errors: linear up to the first
BINS = 60  # of that axis, and at most of depths
DEPTH_MM = 0.25  # steps in which depths are counted
AGREE = 1.96  # standard deviations from the bias to the limits of agreement
_SCALE = SymmetricalLogTransform(10, LINEAR_MM, 1)
_END = float(_SCALE.transform(np.array([LARGEST_MM]))[0])
SIGNED_MM = _SCALE.inverted().transform(np.linspace(-_END, _END, BINS + 1))


class ErrorCounts(NamedTuple):
    """Observed pixels by their errors z − z_ref.
    below [400]: pixels with |z − z_ref| up to each of EDGES_MM. sums [3]: pixels, and the sums of
    their errors and squared errors in mm. agreement: pixels by depth (z + z_ref)/2, in steps of
    DEPTH_MM, and by interval of SIGNED_MM, without those beyond."""

    below: np.ndarray
    sums: np.ndarray
    agreement: Counter[tuple[int, ...]]

    @classmethod
    def of(cls, errors: ErrorMap) -> "ErrorCounts":
        """Count the pixels of an error map."""
        seen = np.isfinite(errors.error_m)
        error_mm = 1e3 * errors.error_m[seen]
        depth = np.floor((1e3 * errors.reference_z_m[seen] + error_mm / 2) / DEPTH_MM)
        error = np.clip(np.searchsorted(SIGNED_MM, error_mm) - 1, 0, BINS - 1)
        pairs = np.stack([depth.astype(int), error])[:, np.abs(error_mm) <= LARGEST_MM]
        below = np.searchsorted(np.sort(np.abs(error_mm)), EDGES_MM, side="right")
        sums = np.array([len(error_mm), error_mm.sum(), (error_mm**2).sum()])
        unique, pixels = np.unique(pairs, axis=1, return_counts=True)
        agreement = zip(map(tuple, unique.T.tolist()), pixels.tolist(), strict=True)
        return cls(below, sums, Counter(dict(agreement)))

    def plus(self, other: "ErrorCounts") -> "ErrorCounts":
        """Return the counts of these and other pixels together."""
        return ErrorCounts(
            self.below + other.below, self.sums + other.sums, self.agreement + other.agreement
        )


NO_PIXELS = ErrorCounts(np.zeros(len(EDGES_MM), int), np.zeros(3), Counter())
Counts = dict[tuple[str, str], ErrorCounts]  # by method and reference


def error_counts(result: Result, captures: Sequence[CaptureFacts]) -> Counts:
    """Count the observed pixels of several captures by their errors, for each method and
    reference."""
    counts = {}
    for method in methods(result):
        for reference in DRAWN:
            against = [c.name for c in captures if reference in c.references]
            maps = (result.errors(name, method.name, reference) for name in against)
            counts[method.name, reference] = reduce(
                ErrorCounts.plus, map(ErrorCounts.of, maps), NO_PIXELS
            )
    return counts


def total_counts(parts: Iterable[Counts]) -> Counts:
    """Return the sum of the pixel counts that `error_counts` gave for several groups of captures.
    The groups must not overlap, because a capture in two of them would count twice."""
    return reduce(lambda a, b: {key: a[key].plus(b[key]) for key in a}, parts)


def error_distributions(result: Result, counts: Counts | None = None) -> Picture:
    """Plot the cumulative distribution of each method's errors, with one panel for each reference
    surface: the share in % of the observed pixels of all captures whose |z − z_ref| is at most the
    value on the x axis.
    counts: of all captures; if None, they are counted here, which reads every error map."""
    counts = counts or error_counts(result, result.scored())
    figure, axes = side_by_side({r: AGAINST[r] for r in drawn_references(result.scored())})
    for reference, axis in axes.items():
        for i, method in enumerate(methods(result)):
            every = (4 * i % 40, 40)  # markers of different methods do not fall on each other
            below, (observed, *_), _ = counts[method.name, reference]
            method.draw(axis, EDGES_MM, 100 * below / (observed or np.nan), markevery=every)
        log_axis(axis, "x")
        axis.set(xlim=EDGES_MM[[0, -1]], ylim=(0, 100), xlabel="|z − z_ref| in mm")
        axis.set_ylabel("pixels in %")
    name_all(figure)
    return Picture(
        "error_distribution",
        "Share of the observed pixels, of all captures together, whose absolute error is not "
        "above the abscissa.",
        "Cumulative distribution of the absolute errors of each method.",
        figure,
    )


def bland_altman(result: Result, counts: Counts | None = None) -> Picture:
    """Plot the agreement of each method's depth map with the reference (Bland and Altman 1986):
    z − z_ref over (z + z_ref)/2, for the observed pixels of all captures against the first
    reference, with the bias and the limits of agreement, bias ± 1.96 standard deviations.
    counts: as for `error_distributions`."""
    counts = counts or error_counts(result, result.scored())
    reference, shown = drawn_references(result.scored())[0], methods(result)
    found = [counts[method.name, reference] for method in shown]
    columns = min(len(shown), 2 if narrow() else 4)
    rows = -(-len(shown) // columns)
    size_in = width_in(1.0 + 1.9 * columns), 0.6 + (1.5 if narrow() else 1.9) * rows
    figure = Figure(figsize=size_in, layout="constrained")
    axes = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    depths = [depth for of in found for depth, _ in of.agreement] or [0]
    low, high = min(depths), max(depths) + 1
    step = -(-(high - low) // BINS)
    edges_mm = DEPTH_MM * np.arange(low, high + step, step)
    grids = [np.zeros((BINS, len(edges_mm) - 1)) for _ in shown]
    for grid, of in zip(grids, found, strict=True):
        for (depth, error), pixels in of.agreement.items():
            grid[error, (depth - low) // step] += pixels
    norm = LogNorm(1, max(2, *(grid.max() for grid in grids)))
    for axis, method, grid, of in zip(axes, shown, grids, found, strict=False):
        axis.pcolormesh(edges_mm, SIGNED_MM, np.ma.masked_equal(grid, 0), norm=norm)
        mean_mm, square_mm2 = of.sums[1:] / (of.sums[0] or np.nan)
        reach_mm = AGREE * np.sqrt(square_mm2 - mean_mm**2)
        for level_mm, line in ((0, "-"), (-reach_mm, "--"), (reach_mm, "--")):
            axis.axhline(mean_mm + level_mm, color=nth_style(1)[0], linestyle=line, linewidth=1)
        axis.set_title(f"{method.title}\n{number(mean_mm, 2)} ± {number(reach_mm, 2)} mm")
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
    bar.minorticks_off()  # their labels would cover each other
    return Picture(
        "bland_altman",
        f"Agreement of the depth maps with the reference, {AGAINST[reference]} (Bland–Altman): "
        "difference over mean of both depths, for the observed pixels of all captures. Lines, and "
        "numbers above: the bias ± 1.96 standard deviations. Differences are drawn linearly up to "
        f"{LINEAR_MM:g} mm; those beyond {LARGEST_MM:g} mm count, and are not drawn.",
        "Difference of map and reference over their mean, for each method.",
        figure,
    )
