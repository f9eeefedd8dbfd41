"""`handbench tradeoff`: measure accuracy and time of many settings of the methods, and find those
that no other setting beats."""

import argparse
import math
import re

from handbench.support.errors import HandbenchError
from handbench.support.progress import print_lines

LENGTHS = {"mm": 1.0, "um": 1e-3, "µm": 1e-3, "cm": 10.0, "m": 1e3}  # in millimetres
TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "min": 60.0}


def run(options: argparse.Namespace) -> None:
    """Run the settings of a benchmark, print the front (those that no other beats) and the front of
    each method, and write its picture and the report.
    --max-mae and --max-time ask for one setting within these limits. If there is none,
    HandbenchError is raised after everything is written."""
    from handbench.bench.benchmarks.benchmark_file import load_tradeoff
    from handbench.bench.evaluation.front import chosen
    from handbench.bench.evaluation.metrics import HEADLINE
    from handbench.bench.run import runner
    from handbench.reports.figures.fronts import pictures, ranked_methods
    from handbench.reports.figures.style import save
    from handbench.reports.page.html import build
    from handbench.reports.tables.table import settings
    from handbench.reports.tables.writers import terminal

    max_error_mm = quantity(options.max_mae, LENGTHS, "--max-mae")
    max_seconds = quantity(options.max_time, TIMES, "--max-time")
    bench, base = load_tradeoff(options.bench, options.only)
    command = f"handbench tradeoff {options.bench} -o DIR"
    result = runner.run(bench, base, options.out, options.overwrite, command=command)
    for metric, ranked in ranked_methods(result).items():
        best = ranked[ranked.on_front | ranked.on_own_front]
        terminal(settings(metric, best, {}), f"{options.out}/report")
    for picture in pictures(result):
        save(picture.figure, options.out / f"{picture.stem}.png")
    print_lines(f"report: {build(options.out, options.out / 'report')}")
    if max_error_mm < math.inf or max_seconds < math.inf:
        if HEADLINE not in ranked_methods(result):
            raise HandbenchError(f"{options.out}: no method has an error and a time to choose by")
        name = chosen(ranked_methods(result)[HEADLINE], max_error_mm, max_seconds)
        print_lines(f"{name}: handbench tradeoff {options.bench} --only {name} -o AGAIN")


def quantity(text: str | None, units: dict[str, float], option: str) -> float:
    """Return the number in a text such as "2mm" or "33 ms", multiplied by the factor of its unit;
    infinity for None.
    units: unit → factor; option: name of the option, for messages. Raises HandbenchError for any
    other text."""
    if text is None:
        return math.inf
    found = re.fullmatch(r"\s*(\d+\.?\d*(?:e[+-]?\d+)?|\.\d+)\s*([a-zA-Zµ%]+)\s*", text)
    if found is None or found[2] not in units or not 0 < float(found[1]) < math.inf:
        raise HandbenchError(
            f"{option}: is '{text}'; expected a number above 0 with its unit: {', '.join(units)}"
        )
    return float(found[1]) * units[found[2]]
