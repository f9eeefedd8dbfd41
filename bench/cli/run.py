"""`handbench run`: the main job."""

from __future__ import annotations

import argparse
from pathlib import Path

from bench.cli.options import add_device

HELP = "every capture × method of a benchmark → result folder; resumes"


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Its options."""
    command.add_argument(
        "bench", metavar="BENCH.toml", help="benchmark file, or the name of an embedded one: paper_table"
    )
    command.add_argument("-o", "--out", required=True, type=Path, metavar="DIR", help="result folder")
    command.add_argument("--overwrite", action="store_true", help="replace the results of another configuration in DIR")
    command.add_argument(
        "--scheduler",
        metavar="tcp://HOST:PORT",
        help="let this Dask scheduler's workers do the stages (extra: cluster)",
    )
    add_device(command)


def run(options: argparse.Namespace) -> None:
    """Run, resume or repeat; ends with the table."""
    from bench.run import runner
    from bench.run.benchmark_file import load_benchmark
    from reports.tables.result_tables import show

    bench, base = load_benchmark(options.bench)
    command = f"handbench run {options.bench} -o DIR"
    show(runner.run(bench, base, options.out, options.overwrite, options.scheduler, command))
    print(f"results: {options.out}")
