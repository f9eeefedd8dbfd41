"""`handbench evaluate-submission`: a foreign method's depth maps beside a benchmark's own methods."""

import argparse


def run(options: argparse.Namespace) -> None:
    """Check, score, and print the table."""
    from bench.run import runner, submitting
    from bench.run.benchmark_file import load_benchmark, submitted
    from reports.tables.result_tables import show

    bench, base = load_benchmark(options.bench)
    submitting.require_complete(options.submission, bench, base)
    entered = submitted(options.submission.resolve())
    own = () if options.alone else bench.method
    bench = bench.model_copy(update={"method": (*own, entered)})
    command = f"handbench evaluate-submission {options.submission} {options.bench} -o DIR"
    show(runner.run(bench, base, options.out, options.overwrite, command=command))
    print(f"results: {options.out}")
