"""`handbench evaluate`: compute the errors of a depth map against a mesh."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING, Any

from handbench.cli.options import free

if TYPE_CHECKING:
    from handbench.bench.evaluation.metrics import Values


def run(options: argparse.Namespace) -> None:
    """Compare a depth map with a mesh and print the metrics on stdout: as a table on a terminal or
    with --table, otherwise as JSON, with their definitions only if --json asks for it.
    Warnings are printed first, on stderr."""
    from handbench.bench.datasets.maroon_alignment import load_any_transform
    from handbench.bench.evaluation.metrics import definitions
    from handbench.bench.validation.checks import MAP, figure_warnings, warnings_of
    from handbench.interface import Capture, Depth
    from handbench.radar.data.depthmap import load_depthmap
    from handbench.support.progress import is_terminal, print_json, say

    if options.plot is not None:
        free(options.plot, options.overwrite)
    depth, transform = load_depthmap(options.depth), load_any_transform(options.transform)
    capture = None if options.capture is None else Capture(options.capture)
    score = Depth(depth, capture).evaluate(options.mesh, transform, options.protocol)
    values = score.values
    warnings = [*warnings_of(depth, MAP), *figure_warnings(depth, values)]
    about: dict[str, Any] = {"method": depth.method}
    if options.json:
        about["definitions"] = definitions(values)
    if transform.refined:
        about["refined"] = f"{options.transform}: {transform.refined}"
    for warning in warnings:
        say(f"{options.depth}: {warning}")
    if options.plot is not None:
        from handbench.reports.figures.depth_maps import methods_figure
        from handbench.reports.figures.style import save

        save(methods_figure([(depth.method, depth.z_m, score.errors)]), options.plot)
    if options.json or not (options.table or is_terminal(sys.stdout)):
        print_json(({"warnings": warnings} if warnings else {}) | values | about)
    else:
        _table(f"{options.depth}: {depth.method}", values, about.get("refined"))


def _table(title: str, values: Values, refined: str | None) -> None:
    """Print the metrics as a table. They have no intervals, because an interval needs several
    captures.
    values: metric → figure; refined: a note below the table."""
    import pandas as pd

    from handbench.bench.evaluation.metrics import METRICS
    from handbench.reports.tables.rounding import figure
    from handbench.reports.tables.table import Table
    from handbench.reports.tables.writers import terminal
    from handbench.support.progress import print_lines

    defined = [METRICS[key] for key in values]
    texts = {
        "value": [figure(values[metric.key], unit=metric.unit) for metric in defined],
        "unit": [metric.unit for metric in defined],
        "better": [metric.better for metric in defined],
    }
    titles = pd.Index([metric.title for metric in defined], name="metric")
    terminal(Table(title, pd.DataFrame(texts, titles)), "the output of --json")
    if refined:
        print_lines(refined)
