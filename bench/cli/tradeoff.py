"""`handbench tradeoff`: its arguments, and what they mean to the library."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

from radar.support.errors import HandbenchError


def add_arguments(command: argparse.ArgumentParser) -> None:
    """All but --device."""
    command.add_argument("bench", metavar="BENCH.toml", help="benchmark file, or the name of an embedded one")
    command.add_argument("-o", "--out", required=True, type=Path, metavar="DIR", help="trade-off folder")
    command.add_argument("--overwrite", action="store_true", help="measure anew what DIR holds, or replace it")
    command.add_argument("--sections", metavar="A,B", help="of imaging, groundtruth, simulation, registration")
    command.add_argument("--max-mae", metavar="2mm", help="answer with the cheapest setting that is as accurate")
    command.add_argument("--max-time", metavar="33ms", help="answer with the most accurate setting that is as fast")
    command.add_argument(
        "--count-acquisition", action="store_true", help="count tones × step time among a setting's time"
    )


def run(options: argparse.Namespace) -> Callable[[], None]:
    """The sweep and its fronts; returned is what prints the answer, a HandbenchError where no setting is one: it comes
    last, when all else is there."""
    from bench.run.benchmark_file import load_benchmark
    from bench.studies.tradeoff.answer import LENGTHS, TIMES, answer, quantity
    from bench.studies.tradeoff.run import run as sweep
    from bench.studies.tradeoff.show import say_answer, show

    error_mm = None if options.max_mae is None else quantity(options.max_mae, LENGTHS, "--max-mae")
    seconds = None if options.max_time is None else quantity(options.max_time, TIMES, "--max-time")
    sections = None if options.sections is None else tuple(part.strip() for part in options.sections.split(","))
    if (error_mm or seconds) and sections is not None and "imaging" not in sections:
        raise HandbenchError("--max-mae, --max-time: choose among imaging settings; add imaging to --sections")
    bench, base = load_benchmark(options.bench)
    found = sweep(bench, base, options.out, sections, options.overwrite)
    show(found, count_acquisition=options.count_acquisition)
    print(f"trade-off: {options.out}")

    def last() -> None:
        if error_mm or seconds:
            say_answer(found, answer(found, error_mm, seconds, options.count_acquisition))

    return last
