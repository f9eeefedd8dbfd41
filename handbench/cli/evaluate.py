"""`handbench evaluate`: compute the errors of a depth map against a mesh."""

from __future__ import annotations

import argparse
import sys
from typing import Any

from handbench.cli.options import free


def run(options: argparse.Namespace) -> None:
    """Compare a depth map with a mesh and print the metrics on stdout: as a table on a terminal or
    with --table, otherwise as JSON, with their definitions only if --json asks for it.
    Warnings are printed first, on stderr."""
    from handbench.bench.datasets.dataset import load_any_transform
    from handbench.bench.evaluation.metrics import definitions
    from handbench.bench.validation.checks import MAP, figure_warnings, warnings_of
    from handbench.interface import Capture, Depth
    from handbench.radar.data.depthmap import load_depthmap
    from handbench.support.progress import is_terminal, print_json, print_lines, say

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
        from handbench.reports.tables.table import of_values
        from handbench.reports.tables.writers import terminal

        table = of_values(str(options.depth), {depth.method: values}).turned
        terminal(table, "the output of --json")
        if transform.refined:
            print_lines(about["refined"])
