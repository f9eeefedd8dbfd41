"""`handbench run`: image all captures of a benchmark with all its methods, and score the depth
maps."""

import argparse


def run(options: argparse.Namespace) -> str:
    """Run a benchmark, or resume an interrupted run, and print the table of the main figures at the
    end.
    Returns a summary."""
    from handbench.bench.benchmarks.benchmark_file import load_benchmark
    from handbench.bench.run import runner
    from handbench.cli.options import names
    from handbench.reports.tables.result_tables import show

    bench, base = load_benchmark(options.bench, names(options.only))
    command = f"handbench run {options.bench} -o DIR"
    result = runner.run(bench, base, options.out, options.overwrite, options.scheduler, command)
    show(result)
    print(f"results: {options.out}")
    captures, methods, failed = map(len, (bench.capture, bench.method, result.about.failures))
    return f"{options.out}: captures × methods: {captures} × {methods}, failed stages: {failed}"
