"""`handbench evaluate-submission`: foreign methods' depth maps beside a benchmark's own methods."""

import argparse

from handbench.support.errors import HandbenchError


def run(options: argparse.Namespace) -> None:
    """Check, score, and print the table."""
    from handbench.bench.run import runner, submitting
    from handbench.bench.run.benchmark_file import load_benchmark, submitted
    from handbench.reports.tables.result_tables import show

    bench, base = load_benchmark(options.bench)
    for submission in options.submission:
        submitting.require_complete(submission, bench, base)
    entered = [submitted(submission.resolve()) for submission in options.submission]
    if twice := [entry.id for number, entry in enumerate(entered) if entry.id in {e.id for e in entered[:number]}]:
        raise HandbenchError(f"two submissions are of a method '{twice[0]}'; give each its own name")
    bench = bench.model_copy(update={"method": (*bench.method, *entered)})
    given = " ".join(map(str, options.submission))
    command = f"handbench evaluate-submission {given} {options.bench} -o DIR"
    show(runner.run(bench, base, options.out, options.overwrite, command=command))
    print(f"results: {options.out}")
