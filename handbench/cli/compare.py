"""`handbench compare`: the differences between the figures of two results."""

import argparse
import json

from handbench.cli.options import free


def run(options: argparse.Namespace) -> str | None:
    """Compare two result folders and print the differences, as tables or as JSON; with -o, also
    write them into a folder.
    Returns a summary if files were written."""
    from handbench.bench.results.compare_results import compare_results
    from handbench.bench.results.result_folder import load
    from handbench.reports.tables.comparison import show, write

    if options.out is not None:
        free(options.out / "compare.json", options.overwrite)
    compared = compare_results(load(options.a), load(options.b))
    if options.json:
        print(json.dumps(compared.content(), indent=2))
    else:
        show(compared)
    if options.out is None:
        return None
    write(compared, options.out)
    better = int((compared.differences.better != "").sum())
    return f"{options.out}: {len(compared.differences)} figures compared, {better} shown to differ"
