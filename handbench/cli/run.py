"""`handbench run`: image all captures of a benchmark with all its methods, and score the depth
maps."""

from __future__ import annotations

import argparse
from pathlib import Path
from textwrap import shorten
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from handbench.bench.results.result_folder import Result

SHOWN = 3  # of our best methods


def run(options: argparse.Namespace) -> None:
    """Run a benchmark, or resume an interrupted run, and print the main figures at the end."""
    from handbench.bench.benchmarks.benchmark_file import load_benchmark
    from handbench.bench.run import runner

    bench, base = load_benchmark(options.bench, options.only)
    command = f"handbench run {options.bench} -o DIR"
    result = runner.run(bench, base, options.out, options.overwrite, options.scheduler, command)
    show(result, options.out)


def show(result: Result, out: Path) -> None:
    """Print the table of the paper and our best methods or, without figures of a paper, a row for
    each method; then what limits the figures, and where all of them are."""
    from rich.console import Console

    from handbench.bench.evaluation.metrics import chosen
    from handbench.reports.page.summary import limits
    from handbench.reports.tables.table import best_of_ours, figures, main_lines, of_paper
    from handbench.reports.tables.writers import notes, terminal
    from handbench.support.progress import print_lines

    if paper := of_paper(result):
        terminal(paper)
        if best := best_of_ours(result, SHOWN):
            terminal(best)
    else:
        terminal(figures(result, main_lines(result, chosen("summary"))), f"{out}/table.csv")
    notes(*limits(result))
    if failures := result.about.failures:
        failed = ", ".join(f"{f.capture} {f.method} ({f.stage})" for f in failures)
        print_lines(shorten(f"failed: {failed}", Console().width, placeholder=" …"))
    notes(f"all figures: {out}/table.csv", f"report: handbench report {out} -o REPORT")
