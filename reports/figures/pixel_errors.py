"""The cumulative distribution of all pixels' errors. Pixels are counted map by map, so that pages
can share the work."""

from collections.abc import Iterable, Sequence
from functools import reduce

import numpy as np

from handbench.bench.evaluation.depth_errors import ErrorMap
from handbench.bench.results.about import CaptureFacts
from handbench.bench.results.result_folder import Result
from handbench.reports.figures.references import DRAWN, drawn_references
from handbench.reports.figures.style import Picture, log_axis, methods, name_all, side_by_side
from handbench.reports.tables.table import AGAINST

EDGES_MM = np.append(np.geomspace(0.02, 100, 400), np.inf)
# by method and reference: observed pixels [401] with |z − z_ref| up to each of EDGES_MM
Counts = dict[tuple[str, str], np.ndarray]


def _count(errors: ErrorMap) -> np.ndarray:
    error_mm = 1e3 * np.abs(errors.error_m[np.isfinite(errors.error_m)])
    return np.searchsorted(np.sort(error_mm), EDGES_MM, side="right")


def error_counts(result: Result, captures: Sequence[CaptureFacts]) -> Counts:
    """Count the observed pixels of several captures by their errors, for each method and
    reference."""
    counts = {}
    for method in methods(result):
        for reference in DRAWN:
            against = [c.name for c in captures if reference in c.references]
            maps = (result.errors(name, method.name, reference) for name in against)
            counts[method.name, reference] = sum(map(_count, maps), np.zeros(len(EDGES_MM), int))
    return counts


def total_counts(parts: Iterable[Counts]) -> Counts:
    """Return the sum of the pixel counts that `error_counts` gave for several groups of captures.
    The groups must not overlap, because a capture in two of them would count twice."""
    return reduce(lambda a, b: {key: a[key] + b[key] for key in a}, parts)


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
            below, observed = np.split(counts[method.name, reference], [-1])
            percent = 100 * below / (observed or np.nan)
            method.draw(axis, EDGES_MM[:-1], percent, markevery=every)
        log_axis(axis, "x")
        axis.set(xlim=EDGES_MM[[0, -2]], ylim=(0, 100), xlabel="|z − z_ref| in mm")
        axis.set_ylabel("pixels in %")
    name_all(figure)
    return Picture(
        "error_distribution",
        "Share of the observed pixels, of all captures together, whose absolute error is not "
        "above the abscissa.",
        "Cumulative distribution of the absolute errors of each method.",
        figure,
    )
