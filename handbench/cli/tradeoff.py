"""`handbench tradeoff`: accuracy against time."""

import argparse

from handbench.support.errors import HandbenchError


def run(options: argparse.Namespace) -> None:
    """The sweep and its fronts, their report, and the answer to what was asked: a HandbenchError where no setting is
    one, when all else is there."""
    from handbench.bench.run.benchmark_file import load_benchmark
    from handbench.bench.studies.tradeoff.answer import LENGTHS, TIMES, answer, quantity, say_answer, show
    from handbench.bench.studies.tradeoff.run import run as sweep
    from handbench.reports.page.tradeoff_section import build

    error_mm = None if options.max_mae is None else quantity(options.max_mae, LENGTHS, "--max-mae")
    seconds = None if options.max_time is None else quantity(options.max_time, TIMES, "--max-time")
    sections = None if options.sections is None else tuple(part.strip() for part in options.sections.split(","))
    if (error_mm or seconds) and sections is not None and "imaging" not in sections:
        raise HandbenchError("--max-mae, --max-time: choose among imaging settings; add imaging to --sections")
    bench, base = load_benchmark(options.bench)
    found = sweep(bench, base, options.out, sections, options.overwrite)
    show(found, count_acquisition=options.count_acquisition)
    print(f"trade-off: {options.out}")
    print(f"report: {build(options.out, options.out / 'report')}")
    if error_mm or seconds:
        say_answer(found, answer(found, error_mm, seconds, options.count_acquisition))
