"""The error budget of single precision: every path that uses it."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from bench.results.stability import Table
from bench.studies.stability import precision_depths as depths
from bench.studies.stability import precision_images as images
from bench.studies.stability.precision_images import Line

PATHS: tuple[Callable[[], Iterator[Line]], ...] = (
    images.of_samples,
    images.of_steering,
    images.of_exact,
    images.of_fast,
    images.of_scan,
    images.of_forward,
    depths.of_resampling,
    depths.of_fsk,
    depths.of_smoothing,
    depths.of_rays,
    depths.of_meshes,
)


def table() -> Table:
    """The budget. Phases become depths by the closest pair of tones, 119 mm/rad, which forgives least."""
    return Table(
        title="Single precision",
        text="error of every path that uses it against double precision, with the bound that roundings allow",
        columns=("path", "single precision in", "bound", "measured", "unit", "depth, mm", "within"),
        rows=tuple((*line, "yes" if line.measured <= line.bound else "no") for path in PATHS for line in path()),
    )
