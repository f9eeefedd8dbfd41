"""`handbench run`, `tradeoff`, `report` and `compare`: the results of benchmarks, and what they
say."""

import argparse
import math
from pathlib import Path
from textwrap import shorten

from handbench.bench.benchmarks.benchmark_file import load_benchmark, load_tradeoff
from handbench.bench.evaluation import front
from handbench.bench.evaluation.metrics import HEADLINE, chosen
from handbench.bench.results.compare_results import compare_results
from handbench.bench.results.result_folder import Result, load
from handbench.reports.tables.comparison import WRITTEN, show, write
from handbench.reports.tables.table import best_of_ours, figures, main_lines, of_paper, settings
from handbench.reports.tables.writers import notes, terminal
from handbench.support.errors import HandbenchError
from handbench.support.files import free_folder
from handbench.support.progress import print_json, print_lines

SHOWN = 3  # of our best methods


def run(options: argparse.Namespace) -> None:
    """Run a benchmark, or resume an interrupted run, and print the main figures at the end."""
    from handbench.bench.run import runner

    result = runner.run(
        *load_benchmark(options.bench, options.only),
        options.out,
        options.overwrite,
        options.scheduler,
        f"handbench run {options.bench} -o DIR",
    )
    show_result(result, options.out)
    _require_all(result)


def _require_all(result: Result) -> None:
    """Raise a HandbenchError that names the stages that failed, if any: exit code 1."""
    if failures := result.about.failures:
        failed = ", ".join(f"{f.capture} {f.method} ({f.stage})" for f in failures)
        error = HandbenchError(shorten(f"failed: {failed}", 200, placeholder=" …"))
        error.code = 1
        raise error


def show_result(result: Result, out: Path) -> None:
    """Print the table of the paper and our best methods or, without figures of a paper, a row for
    each method; then what limits the figures, and where all of them are."""
    from handbench.reports.page.summary import limits  # imports matplotlib

    if paper := of_paper(result):
        terminal(paper)
        if best := best_of_ours(result, SHOWN):
            terminal(best)
    else:
        terminal(figures(result, main_lines(result, chosen("summary"))), f"{out}/table.csv")
    notes(*limits(result))
    notes(f"all figures: {out}/table.csv", f"report: handbench report {out} -o REPORT")


def tradeoff(options: argparse.Namespace) -> None:
    """Run the settings of a benchmark, print the front (those that no other beats) and the front of
    each method, and write its picture and the report.
    --max-mae and --max-time ask for one setting within these limits. If there is none,
    HandbenchError is raised after everything is written."""
    from handbench.bench.run import runner
    from handbench.reports.figures.fronts import pictures, ranked_methods
    from handbench.reports.figures.style import STYLE, save, styled
    from handbench.reports.page.html import build

    result = runner.run(
        *load_tradeoff(options.bench, options.only),
        options.out,
        options.overwrite,
        command=f"handbench tradeoff {options.bench} -o DIR",
    )
    methods = ranked_methods(result)
    for metric, ranked in methods.items():
        best = ranked[ranked.on_front | ranked.on_own_front]
        terminal(settings(result, metric, best, {}), f"{options.out}/report")
    with styled(STYLE):
        for picture in pictures(result):
            save(picture.figure, options.out / f"{picture.stem}.png")
    print_lines(f"report: {build(options.out, options.out / 'report')}")
    if min(options.max_mae, options.max_time) < math.inf:
        if HEADLINE not in methods:
            raise HandbenchError(f"{options.out}: no method has an error and a time to choose by")
        name = front.chosen(methods[HEADLINE], options.max_mae, options.max_time)
        print_lines(f"{name}: handbench tradeoff {options.bench} --only {name} -o AGAIN")
    _require_all(result)


def report(options: argparse.Namespace) -> None:
    """Write the report of one result folder, or of several with one page that shows all of their
    methods. Prints the path of the first page."""
    from handbench.reports.page.html import build, build_several

    one, *others = options.results
    first = build_several(options.results, options.out) if others else build(one, options.out)
    print_lines(f"report: {first}")


def compare(options: argparse.Namespace) -> None:
    """Compare two result folders and print the differences, as tables or as JSON; with -o, also
    write them into a folder."""
    if options.out:
        free_folder(options.out, options.overwrite, WRITTEN)
    compared = compare_results(load(options.a), load(options.b))
    if options.json:
        print_json(compared.content())
    else:
        show(compared, options.metric, options.method)
    if options.out:
        write(compared, options.out)
